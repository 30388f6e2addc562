"""Run every applicable estimator on the same recordings, and score all of them by one code.

A case is a scenario with a seed, which has a truth, a recording, or a drive of a car on a road (tyre friction).
Recordings without a truth are held against each other: the first of them is the reference of the rest
(:mod:`trackfg.geometry.repeatability`). Of a single one a part of the measurements is withheld
(:mod:`trackfg.comparison.withholding`). Runs go into processes of their own; a run of one seed is the same for every
estimator, so that differences are paired.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.comparison.case import Case, CaseKind, CaseRun, Progress, joined
from trackfg.comparison.estimators import Estimator, estimators, with_own
from trackfg.comparison.friction_case import FRICTION_DRIVES, FrictionEstimator, friction_estimators, run_friction_case
from trackfg.comparison.railway_case import run_railway_case
from trackfg.comparison.table import QUANTITIES, SCORE_COLUMNS, About, ComparedCase, Comparison, LeftOut, rows_of
from trackfg.comparison.withheld_case import run_withheld_case
from trackfg.comparison.withholding import FOLDS, divisible
from trackfg.datasets.scenarios import scenario
from trackfg.errors import BadInputError
from trackfg.evaluation.scores import STATISTICS
from trackfg.geometry.repeatability import section_repeatability
from trackfg.io.reader import read_recording
from trackfg.io.truth import has_truth

STANDARD_S = {
    "trolley": 600.0,
    "axle-box": 300.0,
    "measuring-car": 600.0,
    "mainline": 900.0,
    "slippery-line": 900.0,
    "j-turn": None,
}
"""What is compared unless something else is named, and for how long."""
NONE_OWN: Mapping[str, Estimator] = {}
"""No estimator of a user's own."""


def cases_of(
    recordings: Sequence[str | os.PathLike[str]] = (),
    scenarios: Sequence[str] = (),
    *,
    seeds: int = 3,
    duration_s: float | None = None,
) -> list[Case]:
    """Return the runs of a comparison.

    Parameters
    ----------
    recordings
        Folders of recordings.
    scenarios
        Names of scenarios that are simulated; the standard ones where there are neither recordings nor names.
    seeds
        How many runs of each scenario.
    duration_s
        Length of each simulated run, s, instead of the scenario's own.

    Returns
    -------
    list of trackfg.comparison.case.Case
        The runs in order. A single recording without a truth has one with each third of its measurements withheld.

    Raises
    ------
    BadInputError
        For an unknown scenario, a recording that cannot be read, and two of one id.
    TypeError
        For a name in the place of a list.

    Examples
    --------
    >>> from trackfg.comparison import cases_of
    >>> [case.seed for case in cases_of(scenarios=["trolley"], seeds=2)]
    [0, 1]
    """
    for given in (recordings, scenarios):
        if isinstance(given, str | os.PathLike):
            raise TypeError(f"cases_of takes lists of recordings and of scenarios: expected [{str(given)!r}]")
    folders = [Path(folder) for folder in recordings]
    named = dict.fromkeys(scenarios, duration_s)
    if not folders and not scenarios:
        named = {name: duration_s or standard for name, standard in STANDARD_S.items()}
    for name in named:
        if name not in FRICTION_DRIVES:
            scenario(name)
    ids = [read_recording(folder).description.id for folder in folders]
    if twice := [name for name in ids if ids.count(name) > 1]:
        raise BadInputError(f"two recordings have the id {twice[0]!r}; expected a different one each")
    alone = [folder for folder in folders if not has_truth(folder)]
    cases = []
    for name, folder in zip(ids, folders, strict=True):
        cases += _alone(name, folder) if alone == [folder] else [Case(name, "recording", folder=folder)]
    for name, length in named.items():
        kind: CaseKind = "friction" if name in FRICTION_DRIVES else "scenario"
        cases += [Case(name, kind, seed, length) for seed in range(seeds)]
    return cases


def _alone(name: str, folder: Path) -> list[Case]:
    """Return the cases of a recording that nothing is held against: as it is, and with a part of it withheld."""
    recording = read_recording(folder)
    cases = [Case(name, "alone", folder=folder)]
    for what in divisible(recording):
        cases += [Case(f"{name}, {what}", "withheld", part, folder=folder, withheld=what) for part in range(FOLDS)]
    if len(cases) == 1:
        raise BadInputError(
            f"{folder}: nothing to compare with: expected [truth], another recording of the track, or measurements to "
            f"withhold (six fixes, or two minutes of GNSS or of a tachometer)"
        )
    return cases


def run_case(
    case: Case,
    *,
    peers: bool = True,
    keep: bool = True,
    progress: Progress | None = None,
    own: Mapping[str, Estimator] = NONE_OWN,
) -> CaseRun:
    """Run every estimator of the case's kind once, other packages with ``peers``. ``keep``: keep its curves too.

    ``progress(estimator, fraction)`` is called before each; ``own`` are a user's estimators of a railway recording.
    Raises :class:`~trackfg.errors.TrackfgError` where the recording cannot be read.
    """
    show = progress or (lambda what, done: None)
    if case.kind == "friction":
        return run_friction_case(case, show=show)
    if case.kind == "withheld":
        return run_withheld_case(case, peers=peers, show=show, own=own)
    return run_railway_case(case, peers=peers, keep=keep, show=show, own=own)


def compare(
    cases: Sequence[Case],
    *,
    own: Mapping[str, Estimator] = NONE_OWN,
    peers: bool = True,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Comparison:
    """Run and score all cases.

    Parameters
    ----------
    cases
        What :func:`cases_of` gives.
    own
        Estimators of your own, by their names: they run beside the others on the same recordings.
    peers
        Whether other packages run too, where they are installed.
    jobs
        Processes. With more than one the functions of ``own`` have to be importable: those of a notebook are not.
    progress
        Called as ``progress(what, fraction)`` whenever a run is done, in one process whenever an estimator is.

    Returns
    -------
    Comparison
        The scores, the curves of the first run of each case, and what was left out with its reason.

    Raises
    ------
    TrackfgError
        Where a recording cannot be read or nothing can be scored, and for a name of ``own`` that another estimator has.

    Examples
    --------
    >>> from trackfg.baselines import dead_reckoning
    >>> from trackfg.comparison import Estimator, cases_of, compare
    >>> mine = Estimator("wheel and gyro", "own", dead_reckoning.run, ("distance and position",))
    >>> comparison = compare(cases_of(["run1"]), own={"mine": mine}, peers=False)
    >>> {"mine", "smoother", "composite"} <= set(comparison.scores["estimator"])
    True
    """
    start = time.perf_counter()
    with_own(estimators(peers=peers), own)
    runs = list(_runs(cases, additions=own, peers=peers, jobs=jobs, progress=progress))
    scores = joined(
        [*(run.scores for run in runs), *_repeatability([run for run in runs if run.basis == "repeatability"])]
    )
    if scores.empty:
        reasons = "".join(f"; {name}: {reason}" for run in runs for name, reason in run.left_out.items())
        raise BadInputError(f"nothing to compare with: no estimator could be scored{reasons}")
    scores = scores.reindex(columns=list(SCORE_COLUMNS))
    catalogue: dict[str, Estimator | FrictionEstimator] = {**friction_estimators(), **estimators(), **own}
    compared = tuple(difference for run in runs for difference in run.differences)
    present = {*scores["estimator"], *(difference.estimator for difference in compared)}
    about = About(
        seconds=time.perf_counter() - start,
        cases=_lines(runs),
        estimators={name: f"{each.title} ({each.source})" for name, each in catalogue.items() if name in present},
        left_out=_left_out(runs),
        rows=rows_of(scores),
        differences=compared,
    )
    return Comparison(
        about,
        scores,
        joined(run.geometry for run in runs),
        joined(run.positions for run in runs),
    )


def _runs(
    cases: Sequence[Case], *, additions: Mapping[str, Estimator], peers: bool, jobs: int, progress: Progress | None
) -> Iterator[CaseRun]:
    """Run the cases in their order. The curves of the first run of each name are kept."""
    keep = [case.name not in {earlier.name for earlier in cases[:number]} for number, case in enumerate(cases)]
    if jobs == 1 or len(cases) == 1:
        for number, case in enumerate(cases):

            def show(what: str, done: float, number: int = number, name: str = case.name) -> None:
                if progress is not None:
                    progress(f"{name}: {what}", (number + done) / len(cases))

            yield run_case(case, peers=peers, keep=keep[number], progress=show, own=additions)
        return
    # Spawned, not forked: a fork of a process whose libraries have threads may hang.
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures = [
            pool.submit(run_case, case, peers=peers, keep=kept, own=additions)
            for case, kept in zip(cases, keep, strict=True)
        ]
        try:
            for done, future in enumerate(as_completed(futures), start=1):
                future.result()  # a failure ends the comparison at once
                if progress is not None:
                    progress(f"{done} of {len(cases)} runs", done / len(cases))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    yield from (future.result() for future in futures)


def _repeatability(runs: Sequence[CaseRun]) -> Iterator[pd.DataFrame]:
    """Return scores of every run but the first: ``sd``, the rms over sections of the standard deviation of the
    difference.
    """
    if len(runs) < 2:
        return
    reference, *others = runs
    for run in others:
        for name, geometry in run.geometry.groupby("estimator"):
            first = reference.geometry[reference.geometry["estimator"] == name]
            shared = [q for q in QUANTITIES if q in first and q in geometry and geometry[q].notna().any()]
            if first.empty or not shared:
                continue
            sections = section_repeatability(first, geometry, shared, each_section=False)
            yield pd.DataFrame(
                {
                    "case": run.case.name,
                    "seed": 0,
                    "estimator": name,
                    "quantity": shared,
                    "from_kmh": np.nan,
                    "places": [int(sections[q].count()) for q in shared],
                    **dict.fromkeys(STATISTICS, np.nan),
                    "sd": [float(np.sqrt((sections[q] ** 2).mean())) for q in shared],
                    "max": [float(sections[q].max()) for q in shared],
                    "seconds": run.seconds[str(name)],
                    "distance_km": run.distance_km,
                }
            )


def _lines(runs: Sequence[CaseRun]) -> tuple[ComparedCase, ...]:
    by_name: dict[str, list[CaseRun]] = {}
    for run in runs:
        by_name.setdefault(run.case.name, []).append(run)
    return tuple(
        ComparedCase(
            name=name,
            summary=same[0].summary,
            basis=same[0].basis,
            seeds=tuple(run.case.seed for run in same),
            duration_s=float(np.mean([run.duration_s for run in same])),
            distance_km=float(np.mean([run.distance_km for run in same])),
        )
        for name, same in by_name.items()
    )


def _left_out(runs: Sequence[CaseRun]) -> tuple[LeftOut, ...]:
    """Return what was left out, once per case and estimator, with the first reason."""
    first = {(run.case.name, name): reason for run in reversed(runs) for name, reason in run.left_out.items()}
    return tuple(LeftOut(case=case, estimator=name, reason=reason) for (case, name), reason in reversed(first.items()))
