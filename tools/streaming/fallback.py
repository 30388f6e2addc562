"""What takes over where a step of the smoother fails, and that it does so without a loss.

Two kinds of streams: some start with GNSS on an unknown heading, which the first steps do not settle; and in
some a step is made to throw, as that of an undetermined graph does, or the step of what takes over for it as well.
Counted are the events that say what took over; everything that :mod:`streaming.faults` checks must hold.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from benchmark import Figure, Part, at_least, at_most

from streaming.base_cases import BASE_CASES
from streaming.faults import CHECKS, Outcome, outcomes

THROWN = 10
TOOK_OVER = ("by-window", "by-batch", "restarted")


def cases(first_seed: int) -> list[tuple[str, int]]:
    """Steps that throw, on every base case; and the start with GNSS."""
    start = first_seed + (BASE_CASES.index("gnss") - first_seed) % len(BASE_CASES)
    return [("none", start), *(("throw", first_seed + i) for i in range(THROWN))]


def measure(first_seed: int, jobs: int) -> dict[str, float]:
    """How many cases of each kind, how many times something took over, and how many checks failed."""
    done = list(outcomes(cases(first_seed), jobs))
    by_kind = {kind: [outcome for outcome in done if outcome.kind == kind] for kind in ("none", "throw")}
    return {f"{kind} {what}": value for kind, of in by_kind.items() for what, value in _counted(of).items()}


def _counted(done: Sequence[Outcome]) -> dict[str, float]:
    taken = {name: float(sum(outcome.events.get(name, 0) for outcome in done)) for name in TOOK_OVER}
    fewest = min(sum(outcome.events.get(name, 0) for name in TOOK_OVER) for outcome in done)
    failed = sum(check in outcome.failed for outcome in done for check in CHECKS)
    return {"cases": float(len(done)), "fewest": float(fewest), "failed": float(failed), **taken}


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    of, lines = measured.iloc[0], []
    for kind, text in (("none", "start with GNSS"), ("throw", "steps that throw")):
        lines += [
            Figure(f"{text}: streams", of[f"{kind} cases"]),
            at_least(f"{text}: fewest times that something took over", of[f"{kind} fewest"], 1.0),
            *(Figure(f"{text}: {name}", of[f"{kind} {name}"]) for name in TOOK_OVER),
            at_most(f"{text}: checks failed", of[f"{kind} failed"], 0.0),
        ]
    return lines


PART = Part(
    name="fallback",
    title="A window, a batch or a new beginning takes over where a step fails",
    measure=lambda seed: measure(seed, 2),
    figures=figures,
)
