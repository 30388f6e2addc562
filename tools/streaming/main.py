"""Is the fixed-lag smoother as good as the batch, quick enough, and sound whatever comes in?

cost      hours of a stream at 200 Hz: latency, throughput, whether time or memory grow
accuracy  errors and sigmas at a lag of 20 s, against the batch smoother and the published systems, over seeds
faults    short streams with faults in them: what comes out is whole, in time, and right again afterwards
fallback  what takes over where a step of the smoother fails

A case of ``faults`` is a kind and a seed; ``--case KIND:SEED`` runs it again and says all about it. The measurements of
``cost`` want a machine that does nothing else.

    python tools/streaming.py [--parts cost accuracy faults fallback] [--hours 6] [--seeds 5] [--cases 1000]
                              [--kinds KIND ...] [--case KIND:SEED ...] [--first-seed 0] [--jobs 2]
                              [--out FILE] [--per-case FILE]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: a process for each case, and small matrices

import pandas as pd
from benchmark import Part, finish, printed, show, side_by_side, table_of
from rich.console import Console
from rich.progress import track as progress_over

from streaming import accuracy, cost, fallback
from streaming.fault_table import by_kind, of_case, of_quantities
from streaming.faults import CHECKS, KINDS, Outcome, outcomes

PARTS = ("cost", "accuracy", "faults", "fallback")


def cases_of(kinds: Sequence[str], count: int, first_seed: int) -> list[tuple[str, int]]:
    """So many, the kinds in turn."""
    return [(kinds[i % len(kinds)], first_seed + i // len(kinds)) for i in range(count)]


def case_of(text: str) -> tuple[str, int]:
    """``KIND:SEED``."""
    kind, _, seed = text.partition(":")
    if kind not in KINDS or not seed.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r}: expected KIND:SEED with a kind of {', '.join(KINDS)}")
    return kind, int(seed)


def run_cases(cases: Sequence[tuple[str, int]], jobs: int, per_case: Path | None) -> list[Outcome]:
    """Of all, in their order, with a progress bar on a terminal; what each gave is written as it comes."""
    console = Console(stderr=True)
    results = progress_over(
        outcomes(cases, jobs), "cases", len(cases), console=console, transient=True, disable=not console.is_terminal
    )
    by_case: dict[tuple[str, int], Outcome] = {}
    for outcome in results:
        if per_case is not None:
            of_case(outcome).to_csv(per_case, index=False, mode="a" if by_case else "w", header=not by_case)
        by_case[outcome.kind, outcome.seed] = outcome
    return [by_case[case] for case in dict.fromkeys(cases)]


def _report(part: Part, measured: pd.DataFrame) -> pd.DataFrame:
    table = table_of(part, part.figures(measured))
    show(part, printed(table))
    return table


def _report_faults(done: Sequence[Outcome], *, all_of_it: bool) -> pd.DataFrame:
    table = by_kind(done)
    print(f"\nfaults  {len(done)} cases; errors after the fault in sigmas\n")
    print(table.to_string(index=False, float_format="{:.3g}".format, na_rep="-"))
    quantities = of_quantities(done)
    if len(quantities):
        print(f"\n{quantities.to_string(index=False, float_format='{:.3g}'.format)}")
    failed = [outcome for outcome in done if outcome.failed or all_of_it]
    for outcome in failed:
        events = ", ".join(f"{count} {kind}" for kind, count in sorted(outcome.events.items())) or "no events"
        print(f"\n{outcome.kind}:{outcome.seed}  {outcome.ground}: {outcome.said}; {events}")
        for check in CHECKS:
            if check in outcome.failed:
                print(f"    {check}: {outcome.failed[check]}")
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--hours", type=float, default=6.0, help="of the stream of cost (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="of accuracy (default: %(default)s)")
    parser.add_argument("--cases", type=int, default=1000, help="of faults (default: %(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS), metavar="KIND")
    parser.add_argument("--case", nargs="+", type=case_of, default=[], metavar="KIND:SEED", help="these cases alone")
    parser.add_argument("--first-seed", type=int, default=0, metavar="SEED", help="default: %(default)s")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the lines of all tables to a CSV file")
    parser.add_argument("--per-case", type=Path, metavar="FILE", help="write what each case gave to a CSV file")
    arguments = parser.parse_args()
    counts = (arguments.cases, arguments.seeds, arguments.jobs)
    if min(counts) < 1 or arguments.first_seed < 0 or not arguments.hours >= 0.02:
        parser.error("expected one case, one seed, one process, 0.02 hours or more, and no negative seed")
    start = time.perf_counter()
    parts = ["faults"] if arguments.case else list(dict.fromkeys(arguments.parts))
    tables = []
    first, jobs = arguments.first_seed, arguments.jobs
    if "cost" in parts:
        tables.append(_report(cost.PART, pd.DataFrame([cost.measure(first, arguments.hours)])))
    if "accuracy" in parts:
        seeds = range(first, first + arguments.seeds)
        measured = side_by_side({seed: (accuracy.measure, (seed,)) for seed in seeds}, jobs)
        tables.append(_report(accuracy.PART, pd.DataFrame([measured[seed] for seed in seeds])))
    if "fallback" in parts:
        tables.append(_report(fallback.PART, pd.DataFrame([fallback.measure(first, jobs)])))
    met = not any((table["met"] == "NO").any() for table in tables)
    if "faults" in parts:
        cases = arguments.case or cases_of(arguments.kinds, arguments.cases, first)
        done = run_cases(cases, jobs, arguments.per_case)
        tables.append(_report_faults(done, all_of_it=bool(arguments.case)))
        met &= not any(outcome.failed for outcome in done)
    finish(tables, arguments.out, start)
    return 0 if met else 1
