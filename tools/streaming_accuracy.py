"""What a stream's estimates are worth once the lag is over: against the batch smoother, and the published systems.

Errors of cross-level (its offset removed), twist and the distance of each kilometre, scored by the same code for all. A
ratio is that of the errors' root mean squares over all seeds; the best baseline is the one with the smallest error in
that quantity. The place along the track counts from where a stream says that it knows it: up to the first fix it does
not. Coverage is the share of errors within the interval of 95 %, the mean over seeds; a quantity whose error
is one offset for the whole run throws the dice once a run.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from positioning_table import Figure, Part, at_most, between
from stream_tables import tables_of

from trackfg import FixedLagSmoother
from trackfg.compare_case import Case, run_case
from trackfg.comparison import QUANTITIES, REFERENCE
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.evaluate_geometry import geometry_errors
from trackfg.evaluate_trajectory import distance_errors, from_the_true_start, trajectory_errors
from trackfg.scores import rms, score_run
from trackfg.streaming.sources import RecordingSource

LAG_S = 20.0
SCENARIOS = {"mainline": 1200.0, "trolley": 1200.0, "slippery-line": 1200.0, "shuttle": 1000.0}
"""And how long a run of each is, s."""

COMPARED = ("cross_level_mm", "twist_mm", "distance_percent")
COVERED = ("cross_level_mm", "twist_mm", "along_track_m", "speed_kmh", "roll_mrad", "pitch_mrad")
TO_BATCH, TO_BASELINE, COVERAGE = 1.3, 0.7, (0.90, 0.98)
KNOWN_M = 100.0
STREAM, FILTERED = "stream", "filtered"


def measure(seed: int) -> dict[str, float]:
    """Per scenario, estimator and quantity the error, and of the stream the coverage: ``scenario/estimator/quantity``
    and ``scenario/stream/quantity/coverage``.
    """
    out: dict[str, float] = {}
    for name, duration_s in SCENARIOS.items():
        compared = run_case(Case(name, seed, duration_s), peers=False, keep=False).scores
        scores = pd.concat([compared, _streamed(simulate(name, seed=seed, duration_s=duration_s))])
        for row in scores[scores["from_kmh"].isna() & (scores["places"] > 0)].itertuples():
            key = f"{name}/{row.estimator}/{row.quantity}"
            if row.quantity in COMPARED:
                out[key] = float(getattr(row, QUANTITIES[row.quantity].statistic))
            if row.quantity in COVERED and row.estimator in (STREAM, FILTERED):
                out[f"{key}/coverage"] = float(row.coverage)
    return out


def _streamed(run: Simulation) -> pd.DataFrame:
    """The scores of the stream, with ``estimator``: smoothed and filtered."""
    smoother = FixedLagSmoother(run.recording.description, lag_s=LAG_S)
    tables, _ = tables_of(RecordingSource(run.recording), smoother)
    scores = []
    for estimator, name in ((STREAM, "smoothed"), (FILTERED, "filtered")):
        own = tables[name]
        trajectory = own[own["chainage_m_sd"] < KNOWN_M]
        if run.recording.fixes is None:
            trajectory = from_the_true_start(trajectory, run.truth)
        scored = [score_run(trajectory_errors(trajectory, run.truth), band_kmh=None)]
        if estimator == STREAM:
            scored.append(score_run(distance_errors(trajectory, run.truth), band_kmh=None))
            if "geometry" in tables:
                errors = geometry_errors(tables["geometry"], own, run.truth, run.truth_geometry)
                scored.append(score_run(errors, band_kmh=None))
        scores += [table.assign(estimator=estimator) for table in scored]
    return pd.concat(scores, ignore_index=True)


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    return [line for name in SCENARIOS for line in (*_compared(measured, name), *_covered(measured, name))]


def _compared(measured: pd.DataFrame, scenario: str) -> list[Figure]:
    lines = []
    for quantity in COMPARED:
        own = {
            str(column).split("/")[1]: measured[column]
            for column in measured
            if str(column).startswith(f"{scenario}/") and str(column).endswith(f"/{quantity}")
        }
        if STREAM not in own:
            continue
        error = {name: rms(values.dropna()) for name, values in own.items()}
        baselines = {name: value for name, value in error.items() if name not in (STREAM, REFERENCE)}
        meaning = QUANTITIES[quantity]
        label = f"{scenario}: {meaning.label}, {meaning.unit}"
        lines.append(Figure(label, error[STREAM], own[STREAM]))
        ratio = error[STREAM] / error[REFERENCE]
        lines.append(at_most(f"{label}: over batch", ratio, TO_BATCH, own[STREAM] / own[REFERENCE]))
        if baselines:
            best = min(baselines, key=baselines.__getitem__)
            ratio = error[STREAM] / error[best]
            lines.append(at_most(f"{label}: over {best}", ratio, TO_BASELINE, own[STREAM] / own[best]))
    return lines


def _covered(measured: pd.DataFrame, scenario: str) -> list[Figure]:
    lines = []
    for estimator in (STREAM, FILTERED):
        for quantity in COVERED:
            column = f"{scenario}/{estimator}/{quantity}/coverage"
            if column in measured and measured[column].notna().any():
                said = f"{scenario}: coverage of {QUANTITIES[quantity].label}" + (
                    ", filtered" if estimator == FILTERED else ""
                )
                share = float(np.nanmean(measured[column]))
                judged = estimator == STREAM
                lines.append(
                    between(said, share, *COVERAGE, measured[column])
                    if judged
                    else Figure(said, share, measured[column])
                )
    return lines


PART = Part(
    name="accuracy",
    title=f"Estimates after a lag of {LAG_S:g} s, against the batch smoother and the published systems",
    measure=measure,
    figures=figures,
)
