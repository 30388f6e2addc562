"""One run through the smoother, the oracle and dead reckoning, and how far each is off, in metres and in sigmas."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from streaming.run_tables import tables_of

from trackfg import FixedLagSmoother
from trackfg.comparison.estimators import estimators
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import TrackfgError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import score_run
from trackfg.evaluation.trajectory_errors import from_the_true_start, trajectory_errors
from trackfg.numerics.arrays import Array
from trackfg.results.events import DOUBT
from trackfg.smoothing.smoother import smooth
from trackfg.streaming.sources.source import RecordingSource

SMOOTHER, ORACLE, FLOOR, STREAM = "smoother", "oracle", "dead-reckoning", "stream"

QUANTITIES = {
    "along_track_m": "chainage",
    "speed_kmh": "speed",
    "roll_mrad": "roll",
    "pitch_mrad": "pitch",
    "cross_level_mm": "cross_level",
    "twist_mm": "twist",
    "versine_level_mm": "level",
    "versine_alignment_mm": "alignment",
    "plan_m": "position",
}
"""The names of the errors, and of the verdicts on them. ``plan_m`` is the horizontal error after a rigid fit."""
FAR_SIGMAS = 4.0
"""An error beyond so many sigmas is not chance: 6e-5 of a normal distribution."""
LAG_S = 20.0
"""Lag of the streams, s."""
PLACED_M = 100.0
"""A stream knows its place once its sigma is below this, m."""
NONE = "none"
"""The verdict where none was given."""


@dataclass(frozen=True)
class Estimate:
    """What an estimator says of a run. ``verdicts``: the status by quantity."""

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    verdicts: dict[str, str] = field(default_factory=dict)
    converged: bool = True
    findings: tuple[str, ...] = ()


def smoothed(run: Simulation) -> Estimate:
    """Return what the default smoother says."""
    result = smooth(run.recording)
    summary = result.summary
    return Estimate(
        result.trajectory,
        result.geometry,
        {verdict.quantity: verdict.status for verdict in summary.verdicts},
        summary.converged,
        tuple(sorted({finding.code for finding in summary.findings if finding.level != "info"})),
    )


def streamed(run: Simulation) -> Estimate:
    """Return what a stream says once the lag is over."""
    smoother = FixedLagSmoother(run.recording.description, lag_s=LAG_S)
    tables, _ = tables_of(RecordingSource(run.recording), smoother)
    rows, events = tables["smoothed"], tables.get("events", pd.DataFrame(columns=["kind", "detail"]))
    named = [detail.partition(":")[0].split(", ") for detail in events.loc[events["kind"] == DOUBT, "detail"]]
    doubted = {quantity: "not_trusted" for quantities in named for quantity in quantities}
    return Estimate(rows[rows["chainage_m_sd"] < PLACED_M], tables.get("geometry", pd.DataFrame()), doubted)


def floor(run: Simulation) -> Estimate | None:
    """Return what dead reckoning says; None where it is not there, or cannot use the recording."""
    catalogue = estimators(peers=False)
    if FLOOR not in catalogue:
        return None
    try:
        result = catalogue[FLOOR].run(run.recording)
    except TrackfgError:
        return None
    return Estimate(result.trajectory, result.geometry)


def scored(name: str, estimate: Estimate, run: Simulation) -> Iterator[dict[str, object]]:
    """Yield a row per quantity: estimator, quantity, verdict, rms, mean_sd, ratio, coverage and far, the share beyond
    :data:`FAR_SIGMAS`.
    """
    for table in _errors(estimate, run):
        scores = score_run(table, band_kmh=None)
        for row in scores[scores["quantity"].isin(list(QUANTITIES)) & (scores["places"] > 0)].itertuples():
            error, sd = table[row.quantity], table[f"{row.quantity}_sd"]
            known = error.notna() & sd.notna()
            yield {
                "estimator": name,
                "quantity": row.quantity,
                "verdict": estimate.verdicts.get(QUANTITIES[row.quantity], NONE),
                "rms": row.rms,
                "mean_sd": row.mean_sd,
                "ratio": row.ratio,
                "coverage": row.coverage,
                "far": float((error.abs() > FAR_SIGMAS * sd)[known].mean()) if known.any() else np.nan,
                "converged": estimate.converged,
                "findings": ", ".join(estimate.findings),
            }


def measured(run: Simulation, of_oracle: Simulation | None) -> pd.DataFrame:
    """Return the scores of the smoother, of the oracle on its own run ``of_oracle``, and of dead reckoning.

    A smoother that refuses a recording has one row, its quantity empty and the message under ``findings``.
    """
    rows = list(_tried(SMOOTHER, smoothed, run))
    if of_oracle is not None:
        rows += scored(ORACLE, smoothed(of_oracle), of_oracle)
    reckoned = floor(run)
    if reckoned is not None:
        rows += scored(FLOOR, reckoned, run)
    return pd.DataFrame(rows)


def measured_stream(run: Simulation) -> pd.DataFrame:
    """Return the scores of a stream; where it refuses the rows, as of a smoother."""
    return pd.DataFrame(list(_tried(STREAM, streamed, run)))


def _tried(name: str, estimator: Callable[[Simulation], Estimate], run: Simulation) -> Iterator[dict[str, object]]:
    start = time.perf_counter()
    try:
        estimate = estimator(run)
    except TrackfgError as error:
        yield {"estimator": name, "quantity": "", "findings": str(error)}
        return
    seconds = time.perf_counter() - start
    for row in scored(name, estimate, run):
        yield {**row, "seconds": seconds}


def _errors(estimate: Estimate, run: Simulation) -> Iterator[pd.DataFrame]:
    """Yield the errors over time, in plan, and over the track's geometry."""
    trajectory = estimate.trajectory
    unanchored = run.recording.fixes is None
    placed = from_the_true_start(trajectory, run.truth) if unanchored else trajectory
    over_time = trajectory_errors(placed, run.truth)
    if unanchored:
        # Counted from where the run begins there is neither an error nor a sigma before the first motion.
        begins = run.truth["t_s"][(run.truth["chainage_m"] != run.truth["chainage_m"].iloc[0]).idxmax()]
        over_time.loc[over_time["t_s"] < begins, "along_track_m"] = np.nan
    yield over_time
    yield _plan_errors(trajectory, run.truth)
    if len(estimate.geometry):
        yield geometry_errors(estimate.geometry, trajectory, run.truth, run.truth_geometry)


def _plan_errors(trajectory: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """Return the horizontal error after a rotation and a shift that make it least; its sigma is not known."""
    clock = truth["t_s"].to_numpy()
    inside = trajectory[trajectory["t_s"].between(clock[0], clock[-1])]
    estimate = inside["east_m"].to_numpy() + 1j * inside["north_m"].to_numpy()
    t = inside["t_s"].to_numpy()
    true = np.interp(t, clock, truth["east_m"]) + 1j * np.interp(t, clock, truth["north_m"])
    return pd.DataFrame({"t_s": t, "plan_m": plan_error(estimate, true), "plan_m_sd": np.nan})


def plan_error(estimate: Array, true: Array) -> Array:
    """Return how far points of the complex plane (n,) are from the true ones (n,) after the rotation and the shift that
    make it least.
    """
    return np.asarray(np.abs(rigidly_fitted(estimate, true) - (true - true.mean())))


def rigidly_fitted(estimate: Array, true: Array) -> Array:
    """Return points of the complex plane (n,) about their mean, turned to lie as the true ones (n,) do about theirs."""
    centred = estimate - estimate.mean()
    turn = np.vdot(centred, true - true.mean())
    return np.asarray(centred * turn / abs(turn)) if abs(turn) > 0.0 else centred
