"""One run of a railway recording, simulated or read, through every estimator, and the scores of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.baselines.result import BaselineResult
from trackfg.comparison.case import (
    Case,
    CaseRun,
    Progress,
    distance_km,
    joined,
    largest_distance_km,
    run_all,
    score_table,
    with_first_column,
)
from trackfg.comparison.differences import differences
from trackfg.comparison.estimators import SMOOTHER, Estimator, estimators, with_own
from trackfg.comparison.table import BAND_KMH, BANDED, QUANTITIES, TRUTH
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import quantities, score_run
from trackfg.evaluation.trajectory_errors import distance_errors, from_the_true_start, trajectory_errors
from trackfg.io.reader import read_recording
from trackfg.io.truth import has_truth, read_truth, read_truth_geometry
from trackfg.recording.model import Recording

_POSITIONS_S = 1.0
"""Step of the errors over time that are kept to be drawn, s. Chosen so that a run of 15 min keeps 900 rows."""


@dataclass(frozen=True)
class _Truth:
    trajectory: pd.DataFrame
    geometry: pd.DataFrame | None

    @property
    def distance_km(self) -> float:
        return distance_km(self.trajectory)


def run_railway_case(case: Case, *, peers: bool, keep: bool, show: Progress, own: Mapping[str, Estimator]) -> CaseRun:
    """Run every estimator, other packages with ``peers`` and a user's ``own``, and score it. ``keep``: keep its curves.

    Raises :class:`~trackfg.errors.TrackfgError` where the recording cannot be read.
    """
    recording, summary, truth = _measured(case, show)
    catalogue = with_own(estimators(peers=peers), own)
    estimates, seconds, left_out = run_all(
        {name: estimator.run for name, estimator in catalogue.items()}, recording, show
    )
    clock = recording.imu["t_s"].to_numpy()
    duration = float(clock[-1] - clock[0])
    if truth is None:
        km = largest_distance_km(estimate.trajectory for estimate in estimates.values())
        run = CaseRun(case, summary, duration, km, "repeatability", seconds, left_out)
        if case.kind == "alone" and SMOOTHER in estimates:
            return _held_against_the_smoother(run, recording, catalogue, estimates)
        curves = joined(estimate.geometry.assign(estimator=name) for name, estimate in estimates.items())
        return replace(run, geometry=with_first_column("case", case.name, curves))
    scored = [_scored(name, catalogue[name], estimate, recording, truth) for name, estimate in estimates.items()]
    scores = score_table(case, joined(scored_run.scores for scored_run in scored), seconds, truth.distance_km)
    geometry, positions = pd.DataFrame(), pd.DataFrame()
    if keep:
        true = [] if truth.geometry is None else [truth.geometry.assign(estimator=TRUTH)]
        geometry = with_first_column(
            "case", case.name, joined([*true, *(scored_run.geometry for scored_run in scored)])
        )
        positions = with_first_column("case", case.name, joined(scored_run.positions for scored_run in scored))
    return CaseRun(case, summary, duration, truth.distance_km, "truth", seconds, left_out, scores, geometry, positions)


def _held_against_the_smoother(
    run: CaseRun, recording: Recording, catalogue: Mapping[str, Estimator], estimates: Mapping[str, BaselineResult]
) -> CaseRun:
    """Return the run with the curves of all estimators and their differences from the smoother, and no score."""
    smoother = estimates[SMOOTHER]
    columns = ["chainage_m", *(name for name in QUANTITIES if name in smoother.geometry)]
    held = smoother.geometry[columns].dropna()
    truth = _Truth(smoother.trajectory, held if len(held) else None)
    others = {
        name: _scored(name, catalogue[name], estimate, recording, truth)
        for name, estimate in estimates.items()
        if name != SMOOTHER
    }
    curves = [smoother.geometry.assign(estimator=SMOOTHER), *(scored_run.geometry for scored_run in others.values())]
    case = run.case.name
    return replace(
        run,
        distance_km=truth.distance_km,
        basis="smoother",
        geometry=with_first_column("case", case, joined(curves)),
        positions=with_first_column("case", case, joined(scored_run.positions for scored_run in others.values())),
        differences=tuple(
            difference
            for name, scored_run in others.items()
            for difference in differences(
                catalogue[name].tasks,
                with_first_column("case", case, scored_run.geometry),
                with_first_column("case", case, scored_run.positions),
                smoother.trajectory,
            )
        ),
    )


def _measured(case: Case, show: Progress) -> tuple[Recording, str, _Truth | None]:
    """Return the recording, a line on it, and its truth where it has one."""
    if case.kind in ("recording", "alone"):
        recording, summary = read_recording(case.folder), f"recording, folder {case.folder.name}"
        if not has_truth(case.folder):
            return recording, summary, None
        return recording, summary, _Truth(read_truth(case.folder), read_truth_geometry(case.folder))
    show("simulation", 0.0)
    run = simulate(case.name, seed=case.seed, duration_s=case.duration_s)
    return run.recording, scenario(case.name).summary, _Truth(run.truth, run.truth_geometry)


@dataclass(frozen=True)
class _Scored:
    scores: pd.DataFrame
    geometry: pd.DataFrame
    positions: pd.DataFrame


def _scored(name: str, estimator: Estimator, estimate: BaselineResult, recording: Recording, truth: _Truth) -> _Scored:
    """Return one estimator's scores and curves, with ``estimator``."""
    trajectory = estimate.trajectory
    if not estimator.anchored or recording.fixes is None:
        trajectory = from_the_true_start(trajectory, truth.trajectory)
    over_time = trajectory_errors(trajectory, truth.trajectory)
    if recording.gnss is None:  # east and north are counted from anywhere then
        over_time = over_time.drop(columns=["east_m", "east_m_sd", "north_m", "north_m_sd"], errors="ignore")
    distance = distance_errors(trajectory, truth.trajectory)
    scores = [score_run(over_time, band_kmh=None), score_run(distance, band_kmh=None)]
    geometry = estimate.geometry
    if truth.geometry is not None and len(geometry):
        # By the estimator's own chainage, which its geometry table has too; then both are drawn from the true start.
        errors = geometry_errors(geometry, estimate.trajectory, truth.trajectory, truth.geometry)
        scored = score_run(errors, band_kmh=BAND_KMH)
        scores.append(scored[scored["from_kmh"].isna() | scored["quantity"].isin(BANDED)])
        errors = errors[[q for q in quantities(errors) if errors[q].notna().any()]]
        geometry = geometry.join(errors.add_suffix("_error"))
        shift = float(trajectory["chainage_m"].iloc[0] - estimate.trajectory["chainage_m"].iloc[0])
        geometry = geometry.assign(chainage_m=geometry["chainage_m"] + shift)
    of_tasks = [q for q, meaning in QUANTITIES.items() if meaning.task in estimator.tasks]
    table = pd.concat(scores, ignore_index=True)
    rate = np.median(np.diff(over_time["t_s"])) if len(over_time) > 1 else _POSITIONS_S
    return _Scored(
        with_first_column("estimator", name, table[table["quantity"].isin(of_tasks)].reset_index(drop=True)),
        with_first_column("estimator", name, geometry),
        with_first_column("estimator", name, over_time.iloc[:: max(1, round(_POSITIONS_S / rate))]),
    )
