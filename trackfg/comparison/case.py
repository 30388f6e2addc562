"""One run of a comparison: a scenario or a recording through every estimator, and the scores of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from trackfg.baselines.result import BaselineResult
from trackfg.comparison.estimators import Estimator, estimators, friction_estimators
from trackfg.comparison.table import BAND_KMH, BANDED, QUANTITIES, SCORE_COLUMNS, TRUTH
from trackfg.datasets.j_turn import j_turn
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import TrackfgError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import quantities, score_run
from trackfg.evaluation.trajectory_errors import distance_errors, from_the_true_start, trajectory_errors
from trackfg.io.reader import read_recording
from trackfg.io.truth import has_truth, read_truth, read_truth_geometry
from trackfg.recording.model import Recording

J_TURN = "j-turn"
"""The case of tyre friction: a car's J-turn, no recording of a railway."""

_POSITIONS_S = 1.0
"""Step in time of the errors that are kept to be drawn."""

Progress = Callable[[str, float], None]

_Input = TypeVar("_Input")
_Output = TypeVar("_Output")


@dataclass(frozen=True)
class Case:
    """A run to be: of a scenario by its seed, or of a recording in a folder. ``name`` is that of the table."""

    name: str
    seed: int = 0
    duration_s: float | None = None
    folder: Path | None = None


@dataclass(frozen=True)
class CaseRun:
    """What one run gave. ``seconds`` that each estimator took; ``left_out``: why others could not.

    ``scores`` with :data:`trackfg.comparison.table.SCORE_COLUMNS` (empty without a truth); ``geometry`` and
    ``positions`` as in :mod:`trackfg.comparison.table`, where they are kept: always without a truth.
    """

    case: Case
    summary: str
    duration_s: float
    distance_km: float
    against_truth: bool
    seconds: Mapping[str, float]
    left_out: Mapping[str, str]
    scores: pd.DataFrame = field(default_factory=pd.DataFrame)
    geometry: pd.DataFrame = field(default_factory=pd.DataFrame)
    positions: pd.DataFrame = field(default_factory=pd.DataFrame)


@dataclass(frozen=True)
class _Truth:
    trajectory: pd.DataFrame
    geometry: pd.DataFrame | None

    @property
    def distance_km(self) -> float:
        return _km(self.trajectory["chainage_m"])


def run_case(case: Case, *, peers: bool = True, keep: bool = True, progress: Progress | None = None) -> CaseRun:
    """One run through every estimator, other packages with ``peers``. ``keep``: its curves too.

    ``progress(estimator, fraction)`` is called before each. Raises :class:`~trackfg.errors.TrackfgError` where the
    recording cannot be read.
    """
    show = progress or (lambda what, done: None)
    if case.name == J_TURN and case.folder is None:
        return _friction(case, show)
    if case.folder is not None:
        recording, summary = read_recording(case.folder), f"recording in {case.folder.name}"
        truth = None
        if has_truth(case.folder):
            truth = _Truth(read_truth(case.folder), read_truth_geometry(case.folder))
    else:
        show("simulation", 0.0)
        run = simulate(case.name, seed=case.seed, duration_s=case.duration_s)
        recording, summary = run.recording, scenario(case.name).summary
        truth = _Truth(run.truth, run.truth_geometry)
    known = estimators(peers=peers)
    estimates, seconds, left_out = _run_all({name: one.run for name, one in known.items()}, recording, show)
    clock = recording.imu["t_s"].to_numpy()
    duration = float(clock[-1] - clock[0])
    if truth is None:
        km = max((_km(one.trajectory["chainage_m"]) for one in estimates.values()), default=np.nan)
        geometry = joined(one.geometry.assign(estimator=name) for name, one in estimates.items())
        return CaseRun(
            case, summary, duration, km, False, seconds, left_out, geometry=_first("case", case.name, geometry)
        )
    scored = [_scored(name, known[name], one, recording, truth) for name, one in estimates.items()]
    scores = _score_table(case, joined(one.scores for one in scored), seconds, truth.distance_km)
    geometry, positions = pd.DataFrame(), pd.DataFrame()
    if keep:
        true = [] if truth.geometry is None else [truth.geometry.assign(estimator=TRUTH)]
        geometry = _first("case", case.name, joined([*true, *(one.geometry for one in scored)]))
        positions = _first("case", case.name, joined(one.positions for one in scored))
    return CaseRun(case, summary, duration, truth.distance_km, True, seconds, left_out, scores, geometry, positions)


def _run_all(
    known: Mapping[str, Callable[[_Input], _Output]], given: _Input, show: Progress
) -> tuple[dict[str, _Output], dict[str, float], dict[str, str]]:
    """What each gives, the seconds that it took, and why the others gave nothing."""
    given_back: dict[str, _Output] = {}
    seconds: dict[str, float] = {}
    left_out: dict[str, str] = {}
    for number, (name, run) in enumerate(known.items()):
        show(name, number / len(known))
        start = time.perf_counter()
        try:
            given_back[name] = run(given)
        except TrackfgError as error:
            left_out[name] = str(error)
        else:
            seconds[name] = time.perf_counter() - start
    show("scores", 1.0)
    return given_back, seconds, left_out


@dataclass(frozen=True)
class _Scored:
    scores: pd.DataFrame
    geometry: pd.DataFrame
    positions: pd.DataFrame


def _scored(name: str, estimator: Estimator, estimate: BaselineResult, recording: Recording, truth: _Truth) -> _Scored:
    """One estimator's scores and curves, with ``estimator``."""
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
        _first("estimator", name, table[table["quantity"].isin(of_tasks)].reset_index(drop=True)),
        _first("estimator", name, geometry),
        _first("estimator", name, over_time.iloc[:: max(1, round(_POSITIONS_S / rate))]),
    )


def _friction(case: Case, show: Progress) -> CaseRun:
    """The J-turn."""
    drive = j_turn(case.seed)
    known = {name: one.run for name, one in friction_estimators().items()}
    estimates, seconds, left_out = _run_all(known, drive.measured, show)
    true, t = drive.truth, drive.truth["t_s"].to_numpy()
    distance = 1e-3 * drive.distance_m
    scores, positions = [], []
    for name, estimate in estimates.items():
        errors = pd.DataFrame(
            {
                "t_s": t,
                "slip_angle_mrad": 1e3 * (estimate["slip_angle_rad"] - true["slip_angle_rad"]),
                "slip_angle_mrad_sd": 1e3 * estimate["slip_angle_rad_sd"],
                "friction": estimate["friction"] - true["friction"],
                "friction_sd": estimate["friction_sd"],
            }
        )
        scores.append(_first("estimator", name, score_run(errors, band_kmh=None)))
        positions.append(_first("estimator", name, errors))
    return CaseRun(
        case,
        "a car's J-turn on a road that becomes slippery",
        float(t[-1] - t[0]),
        distance,
        True,
        seconds,
        left_out,
        _score_table(case, joined(scores), seconds, distance),
        positions=_first("case", case.name, joined(positions)),
    )


def _score_table(case: Case, scores: pd.DataFrame, seconds: Mapping[str, float], km: float) -> pd.DataFrame:
    scores = scores[scores["quantity"].isin(QUANTITIES) & (scores["places"] > 0)]
    table = scores.assign(case=case.name, seed=case.seed, seconds=scores["estimator"].map(seconds), distance_km=km)
    return table.reindex(columns=list(SCORE_COLUMNS)).reset_index(drop=True)


def joined(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Those with rows under each other; columns that one has and another has not are NaN there."""
    kept = [table.dropna(axis="columns", how="all") for table in tables if len(table)]
    return pd.concat(kept, ignore_index=True) if kept else pd.DataFrame()


def _first(name: str, value: str, table: pd.DataFrame) -> pd.DataFrame:
    """With this column in front."""
    table = table.drop(columns=name, errors="ignore")
    table.insert(0, name, value)
    return table


def _km(chainage: pd.Series[float]) -> float:
    return 1e-3 * float(chainage.diff().abs().sum())
