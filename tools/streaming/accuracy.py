"""What a stream's estimates are worth once the lag is over: against the batch smoother, and the published systems.

Errors of cross-level, twist and the distance of each kilometre, scored by the same code for all. A ratio is that of the
errors' root mean squares over all seeds; the best baseline is the one with the smallest error in that quantity. What is
unknown of a sensor's roll is an offset of the cross-level, which the published systems leave as it is. Without its
offset their cross-level is judged by its shape alone, and that of a stream, which finds out about it in its first
minutes, by this change as well.

The place along the track counts from where a stream says that it knows it: up to the first fix it does not. Coverage is
the share of errors within the interval of 95 %, the mean over seeds; a quantity whose error is one offset for the whole
run throws the dice once a run.

All runs are scored as a whole, and in their second half. A batch judges the first minutes by what the sensor showed
later, its biases and the wheel's scale; a stream knows of these, then, what its description says, and its sigmas say
so. How much of it is due to what has not come yet is shown by the batch smoother on the rows up to three moments of the
run: by how many of its sigmas the stream differs from it in the seconds that leave the lag then.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_most, between

from streaming.run_tables import tables_of
from trackfg import FixedLagSmoother, smooth
from trackfg.comparison.estimators import estimators
from trackfg.comparison.table import QUANTITIES, REFERENCE, Task
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import TrackfgError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import rms, score_run
from trackfg.evaluation.trajectory_errors import distance_errors, from_the_true_start, trajectory_errors
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.streaming.sources.source import RecordingSource

LAG_S = 20.0
SCENARIOS = {"mainline": 2400.0, "trolley": 2400.0, "slippery-line": 2400.0, "shuttle": 2000.0}
"""And how long a run of each is, s."""
LATE = ", second half"

COMPARED = {
    "cross-level, mm": ("cross_level_mm", "rms"),
    "cross-level, offset removed, mm": ("cross_level_mm", "sd"),
    "twist, mm": ("twist_mm", "rms"),
    "distance of each km, %": ("distance_percent", "rms"),
}
"""The quantities and their statistics."""
LIKE_BATCH = {"roll_rad": "roll", "pitch_rad": "pitch", "speed_mps": "speed", "chainage_m": "place along the track"}
MOMENTS, LEAVING_S = (0.25, 0.5, 0.75), 5.0
COVERED = ("cross_level_mm", "twist_mm", "along_track_m", "speed_kmh", "roll_mrad", "pitch_mrad")
TO_BATCH, TO_BASELINE, COVERAGE = 1.3, 0.7, (0.90, 0.98)
KNOWN_M = 100.0
STREAM, FILTERED = "stream", "filtered"


@dataclass(frozen=True)
class _Estimate:
    """What one estimator says of a run. ``tasks``: what it is judged by; ``anchored``: its chainage is the line's."""

    name: str
    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    tasks: Collection[str]
    anchored: bool = True


def measure(seed: int) -> dict[str, float]:
    """Per scenario, estimator and what is compared the error, and of the stream the coverage of quantities:
    ``scenario/estimator/compared`` and ``scenario/stream/quantity/coverage``; the scenario's name with ``LATE`` where
    the first half does not count.
    ``scenario/column/away/moment``: by how many sigmas the stream differs from a batch of what had come.
    """
    out: dict[str, float] = {}
    for name, duration_s in SCENARIOS.items():
        run = simulate(name, seed=seed, duration_s=duration_s)
        half_s = 0.5 * float(run.truth["t_s"].iloc[0] + run.truth["t_s"].iloc[-1])
        streamed = tuple(_streamed(run))
        for moment in MOMENTS:
            for column, away in _away(run, streamed[0].trajectory, moment * duration_s).items():
                out[f"{name}/{column}/away/{moment}"] = away
        for estimate in (*_known(run), *streamed):
            for label, since_s in ((name, -np.inf), (name + LATE, half_s)):
                scores = _scores(estimate, run, since_s).set_index("quantity")
                for what, (quantity, statistic) in COMPARED.items():
                    if quantity in scores.index:
                        out[f"{label}/{estimate.name}/{what}"] = float(scores.loc[quantity, statistic])
                if estimate.name in (STREAM, FILTERED):
                    for quantity in scores.index.intersection(COVERED):
                        out[f"{label}/{estimate.name}/{quantity}/coverage"] = float(scores.loc[quantity, "coverage"])
    return out


def _known(run: Simulation) -> Iterator[_Estimate]:
    """The batch smoother and the published systems, as far as they can use the recording."""
    for name, estimator in estimators(peers=False).items():
        with contextlib.suppress(TrackfgError):
            result = estimator.run(run.recording)
            yield _Estimate(name, result.trajectory, result.geometry, estimator.tasks, estimator.anchored)


def _streamed(run: Simulation) -> Iterator[_Estimate]:
    smoother = FixedLagSmoother(run.recording.description, lag_s=LAG_S)
    tables, _ = tables_of(RecordingSource(run.recording), smoother)
    tasks, none = get_args(Task), pd.DataFrame()
    for name, table, geometry in ((STREAM, "smoothed", tables.get("geometry", none)), (FILTERED, "filtered", none)):
        rows = tables[table]
        yield _Estimate(name, rows[rows["chainage_m_sd"] < KNOWN_M], geometry, tasks)


def _away(run: Simulation, smoothed: pd.DataFrame, until_s: float) -> dict[str, float]:
    """The mean difference from the batch smoother on the rows up to then, in what has just left the lag, by column of
    the trajectory, in its mean sigmas; NaN where the stream does not state its place.
    """
    batch = smooth(_up_to(run.recording, until_s)).trajectory
    leaving = [table[table["t_s"].between(until_s - LAG_S - LEAVING_S, until_s - LAG_S)] for table in (smoothed, batch)]
    rows, batch_rows = (table.set_index(table["t_s"].round(6)) for table in leaving)
    # Of the mean sigma: at rest a single row of speed may have one of almost nothing.
    return {
        name: float((rows[name] - batch_rows[name]).mean() / batch_rows[f"{name}_sd"].mean()) for name in LIKE_BATCH
    }


def _up_to(recording: Recording, until_s: float) -> Recording:
    tables = {name: getattr(recording, name) for name in ("imu", "tach", "fixes", "gnss")}
    return replace(
        recording, **{name: table[table["t_s"] <= until_s] for name, table in tables.items() if table is not None}
    )


def _scores(estimate: _Estimate, run: Simulation, since_s: float) -> pd.DataFrame:
    """Of what was passed from ``since_s`` on."""
    truth = run.truth[run.truth["t_s"] >= since_s]
    trajectory = estimate.trajectory[estimate.trajectory["t_s"] >= since_s]
    if not estimate.anchored or run.recording.fixes is None:
        trajectory = from_the_true_start(trajectory, truth)
    errors = [trajectory_errors(trajectory, truth)]
    if estimate.name != FILTERED:
        errors.append(distance_errors(trajectory, truth))
    if len(estimate.geometry):
        of_places = geometry_errors(estimate.geometry, estimate.trajectory, run.truth, run.truth_geometry)
        errors.append(of_places[_passed_s(estimate, run) >= since_s])
    scores = pd.concat([score_run(table, band_kmh=None) for table in errors], ignore_index=True)
    scores = scores[scores["quantity"].isin(QUANTITIES) & (scores["places"] > 0)]
    return scores[[QUANTITIES[name].task in estimate.tasks for name in scores["quantity"]]]


def _passed_s(estimate: _Estimate, run: Simulation) -> Array:
    """When the rows of the geometry were passed; NaN where that is more than one time."""
    if "t_s" in estimate.geometry:
        return estimate.geometry["t_s"].to_numpy()
    way = run.truth["chainage_m"].to_numpy()
    steps = np.diff(way)
    if steps.min() < 0.0 < steps.max():
        return np.full(len(estimate.geometry), np.nan)
    sense = 1.0 if steps.max() > 0.0 else -1.0
    return np.interp(sense * estimate.geometry["chainage_m"], sense * way, run.truth["t_s"])


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    labels = [name + when for name in SCENARIOS for when in ("", LATE)]
    lines = [line for label in labels for line in (*_compared(measured, label), *_covered(measured, label))]
    return [*lines, *(line for name in SCENARIOS for line in _like_batch(measured, name))]


def _like_batch(measured: pd.DataFrame, scenario: str) -> list[Figure]:
    lines = []
    for column, label in LIKE_BATCH.items():
        away = measured.filter(like=f"{scenario}/{column}/away/")
        if away.notna().any(axis=None):
            text = f"{scenario}: {label}: away from a batch of what had come, sigmas"
            by_seed = [rms(row.dropna()) for _, row in away.iterrows()]
            lines.append(Figure(text, rms(away.melt()["value"].dropna()), by_seed))
    return lines


def _compared(measured: pd.DataFrame, scenario: str) -> list[Figure]:
    lines = []
    for what in COMPARED:
        by_estimator = {
            str(column).split("/")[1]: measured[column]
            for column in measured
            if str(column).startswith(f"{scenario}/") and str(column).endswith(f"/{what}")
        }
        if STREAM not in by_estimator:
            continue
        error = {name: rms(values.dropna()) for name, values in by_estimator.items()}
        baselines = {name: value for name, value in error.items() if name not in (STREAM, REFERENCE)}
        label = f"{scenario}: {what}"
        lines.append(Figure(label, error[STREAM], by_estimator[STREAM]))
        ratio = error[STREAM] / error[REFERENCE]
        lines.append(at_most(f"{label}: over batch", ratio, TO_BATCH, by_estimator[STREAM] / by_estimator[REFERENCE]))
        if baselines:
            best = min(baselines, key=baselines.__getitem__)
            ratio = error[STREAM] / error[best]
            lines.append(
                at_most(f"{label}: over {best}", ratio, TO_BASELINE, by_estimator[STREAM] / by_estimator[best])
            )
    return lines


def _covered(measured: pd.DataFrame, scenario: str) -> list[Figure]:
    lines = []
    for estimator in (STREAM, FILTERED):
        for quantity in COVERED:
            column = f"{scenario}/{estimator}/{quantity}/coverage"
            if column in measured and measured[column].notna().any():
                text = f"{scenario}: coverage of {QUANTITIES[quantity].label}" + (
                    ", filtered" if estimator == FILTERED else ""
                )
                share = float(np.nanmean(measured[column]))
                judged = estimator == STREAM
                lines.append(
                    between(text, share, *COVERAGE, measured[column])
                    if judged
                    else Figure(text, share, measured[column])
                )
    return lines


PART = Part(
    name="accuracy",
    title=f"Estimates after a lag of {LAG_S:g} s, against the batch smoother and the published systems",
    measure=measure,
    figures=figures,
)
