"""Maps of rough rides: do the curve points lie within their sigmas?

A sensor on springs has no track geometry, of which maps are made. So the rides are those of ``rough-ride`` with one
that follows the track: without the effects that put it on a car body. Points are held against the designed line as in
``tools/positioning.py --parts map``.
"""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
from accuracy.curves import designed_curves
from positioning.map import landmark_errors

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.mounting import LeverArm, SpringRoll
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import simulate
from trackfg.evaluation.scores import rms
from trackfg.mapping import build_map
from trackfg.maps.feature_map import CURVE_POINTS
from trackfg.smoothing.smoother import smooth

COUNTS = (1, 3, 10)
"""Runs that a map is made of."""
COVERAGE = (0.90, 0.98)
MIDDLES = ("middle in", "middle out")


def measured_maps(seed: int, duration_s: float) -> pd.DataFrame:
    """Return the errors of curve points, a row each, of maps of :data:`COUNTS` runs of a seed."""
    plan, results, errors = _ride(duration_s), [], []
    for number in range(max(COUNTS)):
        run = simulate(plan, seed=seed, run=number)
        results.append(smooth(run.recording))
        if len(results) in COUNTS:
            made = build_map(results, name=f"rough {seed}")
            scores = landmark_errors(made.landmarks, made.covariance, designed_curves(run.track.line))
            errors.append(scores.errors.assign(runs=len(results), seed=seed))
    return pd.concat(errors, ignore_index=True)


def as_table(errors: pd.DataFrame) -> str:
    """Return what maps of so many runs err by as a table in Markdown."""
    lines = [
        "| map of | points | number | error, m | sigma, m | within 1.96 sigma | met |",
        "|---|---|---|---|---|---|---|",
    ]
    for runs, of_map in errors.groupby("runs"):
        for name, points in (("begin and end of curves", CURVE_POINTS), ("middle of transitions", MIDDLES)):
            of = of_map[of_map["point"].isin(points)]
            share = float((of["error_m"].abs() <= 1.96 * of["sd_m"]).mean())
            met = "yes" if COVERAGE[0] <= share <= COVERAGE[1] else "NO"
            numbers = f"{len(of)} | {rms(of['error_m']):.2f} | {rms(of['sd_m']):.2f} | {share:.2f}"
            lines.append(f"| {runs} | {name} | {numbers} | {met} |")
    return "\n".join(lines)


def _ride(duration_s: float) -> Scenario:
    """Return the rough ride with a sensor that follows the track."""
    plan = scenario("rough-ride")
    effects = tuple(effect for effect in plan.effects if not isinstance(effect, LeverArm | SpringRoll))
    return replace(plan, name="rough-ride-rigid", duration_s=duration_s, effects=effects)
