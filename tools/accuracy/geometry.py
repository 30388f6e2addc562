"""How accurate is the track geometry, how honest are its sigmas, and how well do runs repeat?

Accuracy: seeds of each scenario are simulated, smoothed with the default settings and scored against the true geometry
at the place where the vehicle was. Per column: rms of the error, and its standard deviation about the run's mean (sd:
the constant offset removed, which cross-level has from the mounting and the accelerometer's bias, and gradient from the
bias), each the mean over runs with half the width of its 95 % interval (margin); the largest error; the mean sigma; the
rms of error / sigma; the share of errors within 1.96 sigma, in per cent, and whether it lies in 90-98 %. Then the
same by speed. A column whose error is one offset for the whole run throws the dice once a run: the coverage of 20 runs
is then known to 10 %, and the rms of error / sigma says more.

Targets: cross-level with its offset removed (sd); everything else as it is (rms).

Repeatability: runs on one track at different speeds are compared with the first by the standard deviation of the
difference per section of 200 m, after one shift in chainage for the whole run, and again after one for each section.

    python tools/geometry_accuracy.py [--seeds 20] [--jobs 2] [--scenario mainline trolley] [--duration 600]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from benchmark import Call, side_by_side

from trackfg.config import GeometryConfig, SmoothConfig
from trackfg.datasets.line.truth_geometry import OperatorLengths, truth_geometry
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import quantities, score_bands, score_run, score_runs
from trackfg.geometry.repeatability import section_repeatability
from trackfg.numerics.units import KMH
from trackfg.results.columns import RAIL_COLUMNS
from trackfg.smoothing.smoother import smooth_states

DURATIONS_S = {
    "mainline": 1800.0,
    "trolley": 1200.0,
    "measuring-car": 900.0,
    "measuring-car-b": 900.0,
    "axle-box": 300.0,
    "shuttle": 1000.0,
}
"""The scenarios and how long a run of each is: 20 seeds of all take a quarter of an hour on two cores."""

SHORT_BASE_M = 3.0
"""Curvature over this base too, as a column of its own: it holds what the default base of 10 m averages away."""

SHORT_CURVATURE = "curvature_3m_1pm"
SHORT_SEEDS = 5
"""The short base is another setting, for which a run is smoothed once more: only so many seeds."""

TARGETS = {
    "curvature_1pm": 1e-5,
    SHORT_CURVATURE: 1e-5,
    "gradient_permille": 0.05,
    "cross_level_mm": 0.3,
    "twist_mm": 0.15,
    "versine_level_mm": 0.25,
    "versine_alignment_mm": 0.25,
}
COVERAGE = (0.90, 0.98)

BANDED = ("cross_level_mm", "twist_mm", "versine_level_mm", "versine_alignment_mm")
LEAST_PLACES = 400
"""A speed band with less than 100 m is not shown."""

REPEATED = {"shuttle": (0, 2, 4, 1), "measuring-car": (0, 1, 2)}
"""Runs of seed 0 per scenario; the others are held against the first. Odd runs of the shuttle go back."""
SECTION_LIMITS_MM = (0.5, 0.2)


def score(scenario: str, seed: int, duration_s: float) -> pd.DataFrame:
    """The scores of one simulated run."""
    run = simulate(scenario, seed=seed, duration_s=duration_s)
    smoothed = smooth_states(run.recording, SmoothConfig())
    errors = geometry_errors(smoothed.geometry, smoothed.trajectory, run.truth, run.truth_geometry)
    if seed < SHORT_SEEDS:
        errors = errors.join(_short_curvature(run))
    return score_run(errors).assign(scenario=scenario, seed=seed)


def _short_curvature(run: Simulation) -> pd.DataFrame:
    """Error and sigma of the curvature over the short base."""
    config = SmoothConfig(geometry=GeometryConfig(curvature_base_m=SHORT_BASE_M))
    smoothed = smooth_states(run.recording, config)
    origin, direction = run.ride.chainage_origin_m, run.ride.direction
    s = np.sort(direction * (run.truth_geometry["chainage_m"].iloc[[0, -1]].to_numpy() - origin))
    true = truth_geometry(
        run.track,
        chainage_origin_m=origin,
        direction=direction,
        s_from=float(s[0]),
        s_to=float(s[1]),
        lengths=OperatorLengths(curvature_base_m=SHORT_BASE_M),
    )
    errors = geometry_errors(smoothed.geometry, smoothed.trajectory, run.truth, true[["chainage_m", "curvature_1pm"]])
    names = {"curvature_1pm": SHORT_CURVATURE, "curvature_1pm_sd": f"{SHORT_CURVATURE}_sd"}
    return errors[list(names)].rename(columns=names)


def geometry_of(scenario: str, run: int, duration_s: float) -> pd.DataFrame:
    """The smoothed geometry of a run on the track of seed 0."""
    return smooth_states(simulate(scenario, seed=0, run=run, duration_s=duration_s).recording, SmoothConfig()).geometry


def judged(scores: pd.DataFrame) -> pd.DataFrame:
    """Scores with the target, whether rms and sd meet it, and whether the coverage is in its bounds."""
    target = scores["quantity"].map(TARGETS)
    return scores.assign(
        target=target,
        rms_met=_yes(scores["rms"] <= target, target.notna() & scores["rms"].notna()),
        sd_met=_yes(scores["sd"] <= target, target.notna() & scores["sd"].notna()),
        covered=_yes(scores["coverage"].between(*COVERAGE), scores["coverage"].notna()),
    )


def _yes(holds: pd.Series, known: pd.Series) -> pd.Series:
    return holds.map({True: "yes", False: "NO"}).where(known, "")


def repeatability_table(scenario: str, geometry: dict[int, pd.DataFrame]) -> pd.DataFrame:
    """Per compared run, kind of shift and column: sections, the worst, the shares that keep the limits."""
    first, *others = REPEATED[scenario]
    reference = geometry[first]
    columns = [*BANDED, *(name for name in quantities(reference) if name in RAIL_COLUMNS)]
    rows = []
    for run in others:
        compared = geometry[run]
        for each in (False, True):
            sections = section_repeatability(reference, compared, columns, each_section=each)
            for name in columns:
                sd = sections[name].dropna()
                shares = {f"within_{limit:g}_mm": (sd <= limit).mean() for limit in SECTION_LIMITS_MM}
                rows.append(
                    {
                        "run": run,
                        "kmh": compared["speed_mps"].mean() / KMH,
                        "shift": "per section" if each else "whole run",
                        "shift_mean_m": sections["shift_m"].mean(),
                        "shift_from_m": sections["shift_m"].min(),
                        "shift_to_m": sections["shift_m"].max(),
                        "quantity": name,
                        "sections": len(sd),
                        "median_sd": sd.median(),
                        "worst_sd": sd.max(),
                        **shares,
                    }
                )
    return pd.DataFrame(rows)


def _show(title: str, table: pd.DataFrame) -> None:
    print(f"\n{title}")
    if table.empty:
        print("nothing to show")
        return
    percent = [name for name in table if name.startswith(("coverage", "within"))]
    shown = table.assign(**{name: 100.0 * table[name] for name in percent})
    print(shown.to_string(index=False, float_format="{:.3g}".format, na_rep="-"))


def _report_accuracy(scenario: str, runs: pd.DataFrame) -> list[pd.DataFrame]:
    columns, bands = judged(score_runs(runs)), judged(score_bands(runs))
    present = columns["runs"] > 0
    count = runs["seed"].nunique()
    _show(f"{scenario}: {count} seeds of {runs['duration_s'].iloc[0]:g} s", columns[present])
    if (~present).any():
        print(f"absent: {', '.join(columns['quantity'][~present])}")
    shown = bands["quantity"].isin(BANDED) & (bands["places"] >= LEAST_PLACES)
    _show(f"{scenario}, by speed", bands[shown])
    return [columns.assign(scenario=scenario, table="column"), bands.assign(scenario=scenario, table="speed band")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="runs of each scenario (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, choices=(1, 2), help="processes (default: %(default)s)")
    parser.add_argument("--scenario", nargs="+", choices=DURATIONS_S, default=list(DURATIONS_S), metavar="NAME")
    parser.add_argument("--duration", type=float, metavar="S", help="length of every run (default: by scenario)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write every figure to a CSV file")
    arguments = parser.parse_args()
    start = time.perf_counter()
    durations = {name: arguments.duration or DURATIONS_S[name] for name in arguments.scenario}
    calls: dict[tuple[str, str, int], Call] = {}
    for name, duration in durations.items():
        calls |= {("scored", name, seed): (score, (name, seed, duration)) for seed in range(arguments.seeds)}
        calls |= {("repeated", name, run): (geometry_of, (name, run, duration)) for run in REPEATED.get(name, ())}
    tables = side_by_side(calls, arguments.jobs, "runs")
    runs = pd.concat([table for (kind, *_), table in tables.items() if kind == "scored"])
    runs["duration_s"] = runs["scenario"].map(durations)
    written = []
    with pd.option_context("display.width", 250):
        for name in durations:
            written += _report_accuracy(name, runs[runs["scenario"] == name])
        for name in [name for name in REPEATED if name in durations]:
            geometry = {run: tables["repeated", name, run] for run in REPEATED[name]}
            table = repeatability_table(name, geometry)
            speed = geometry[REPEATED[name][0]]["speed_mps"].mean() / KMH
            _show(f"{name}, seed 0: sd of the difference from run 0 ({speed:.1f} km/h) per section of 200 m", table)
            written.append(table.assign(scenario=name, table="repeatability"))
    print(f"\n{time.perf_counter() - start:.0f} s in all", file=sys.stderr)
    if arguments.out is not None:
        table = pd.concat(written, ignore_index=True)
        table.insert(0, "scenario", table.pop("scenario"))
        table.insert(1, "table", table.pop("table"))
        table.to_csv(arguments.out, index=False)
