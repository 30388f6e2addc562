"""What the estimator assumes of vehicles and track, and what happens where an assumption is off by a factor of two.

Constants and defaults that were chosen on simulated runs, or that equal what the simulator does, are halved and
doubled, one at a time. Each table row is one figure over all seeds: error (rms) of a quantity, and the rms of error
over sigma, which is 1 where sigmas are honest. The simulated worlds stay as they are.

    python tools/assumptions.py [--seeds 4] [--only NAME ...]
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from types import ModuleType

import numpy as np
import pandas as pd
from benchmark import add_seed_arguments, seeds_of, side_by_side

from trackfg.config import SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.vehicle.vehicle import CarBody
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.slip_scores import score_slips
from trackfg.mapping import build_map
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

FACTORS = (0.5, 1.0, 2.0)
COLUMNS = ("lower", "as it is", "higher")
Figures = dict[str, float]


@dataclass(frozen=True)
class Assumption:
    """A constant ``module:NAME``, or a setting ``section.key``, with the measurement that depends on it."""

    name: str
    says: str
    measure: Callable[[int, SmoothConfig], Figures]
    factors: tuple[float, float, float] = FACTORS


def _mean_squares(name: str, error: np.ndarray, sd: np.ndarray) -> Figures:
    known = np.isfinite(error) & np.isfinite(sd)
    return {name: float(np.mean(error[known] ** 2)), f"{name} / sigma": float(np.mean((error[known] / sd[known]) ** 2))}


def _trajectory(run: Simulation, result: Result, column: str, label: str) -> Figures:
    estimate = result.trajectory
    true = np.interp(estimate["t_s"], run.truth["t_s"], run.truth[column])
    return _mean_squares(label, (estimate[column] - true).to_numpy(), estimate[f"{column}_sd"].to_numpy())


def slips(seed: int, config: SmoothConfig) -> Figures:
    """Measure distance and slip events on `slippery-line-leaves`."""
    run = simulate("slippery-line-leaves", seed=seed, duration_s=900.0)
    assert run.slips is not None
    result = smooth(run.recording, config)
    score = score_slips(result.events, run.slips, run.truth)
    counts = {"slips missed": len(score.missed), "events that are none": len(score.false), "events": score.events}
    removed = score.distances
    return {
        **_trajectory(run, result, "chainage_m", "chainage, m"),
        **_mean_squares(
            "distance removed, m",
            (removed["removed_m"] - removed["true_m"]).to_numpy(),
            removed["removed_m_sd"].to_numpy(),
        ),
        **{name: float(count) ** 2 for name, count in counts.items()},
    }


def line(seed: int, config: SmoothConfig) -> Figures:
    """Measure speed and distance on `mainline`."""
    run = simulate("mainline", seed=seed, duration_s=600.0)
    result = smooth(run.recording, config)
    return _trajectory(run, result, "chainage_m", "chainage, m") | _trajectory(run, result, "speed_mps", "speed, m/s")


def lasers(seed: int, config: SmoothConfig) -> Figures:
    """Measure curvature by displacement sensors on `measuring-car`."""
    run = simulate("measuring-car", seed=seed, duration_s=240.0)
    result = smooth(run.recording, config)
    assert run.truth_geometry is not None
    errors = geometry_errors(result.geometry, result.trajectory, run.truth, run.truth_geometry)
    name = "curvature_1pm"
    return _mean_squares("curvature, 1/km", 1e3 * errors[name].to_numpy(), 1e3 * errors[f"{name}_sd"].to_numpy())


@cache
def _map(seed: int) -> FeatureMap:
    return build_map([smooth(_shuttle(seed, run, rigid=True).recording) for run in range(2)], name="line")


@cache
def _shuttle(seed: int, run: int, *, rigid: bool) -> Simulation:
    plan = scenario("shuttle")
    return simulate(plan if rigid else replace(plan, vehicle=CarBody()), seed=seed, run=run)


def _on_map(seed: int, config: SmoothConfig, *, rigid: bool) -> Figures:
    run = _shuttle(seed, 2, rigid=rigid)
    assert run.recording.fixes is not None
    recording = replace(run.recording, fixes=run.recording.fixes.iloc[:1])
    result = smooth(recording, config, feature_map=_map(seed))
    return _trajectory(run, result, "chainage_m", "chainage, m")


def located(seed: int, config: SmoothConfig) -> Figures:
    """Measure the place of a run that a map locates after its first fix."""
    return _on_map(seed, config, rigid=True)


def located_on_springs(seed: int, config: SmoothConfig) -> Figures:
    """Measure the same of a body on springs."""
    return _on_map(seed, config, rigid=False)


ASSUMPTIONS = (
    Assumption("tach.creep_m_per_sqrt_m", "how much a rolling wheel creeps at random", line),
    Assumption("tach.creep_per_traction", "how much a wheel creeps per force", line),
    Assumption("motion.sd_per_speed", "how far a body moves other than where it points", line),
    Assumption("trackfg.factors.switching:_LASTS_S", "how long a slip lasts", slips),
    # Doubled, a lasting error would be a slip later than a lone one, which is at 3.5 sigmas.
    Assumption(
        "trackfg.factors.switching:_LASTING",
        "from how many sigmas on a lasting error is a slip",
        slips,
        (0.7, 1.0, 1.4),
    ),
    Assumption("trackfg.graph.wheel_slip:_ACCELERATION_SD", "accelerometer's error before the graph", slips),
    Assumption("trackfg.graph.wheel_slip:_ERROR_WALK", "walk of that error", slips),
    Assumption("trackfg.output.slip_events:_RELEASE_S", "how long slide protection releases a brake", slips),
    Assumption("trackfg.output.slip_events:_EDGE_CREEP", "creep at the edges of an event", slips),
    Assumption("trackfg.output.track_geometry:_SHORT_WAVES", "short waves that the heading misses", lasers),
    Assumption("trackfg.mapping.recognition.fine_match:_CURVES_SD", "sigma of a match by curves alone", located),
    Assumption(
        "trackfg.smoothing.localisation:_ON_SPRINGS_SD_M", "place of what a body on springs shows", located_on_springs
    ),
)


def _set(home: ModuleType, constant: str, value: float) -> None:
    """Change a constant, and forget what functions of its module have computed from it."""
    setattr(home, constant, value)
    for function in vars(home).values():
        if hasattr(function, "cache_clear"):
            function.cache_clear()


def measured(assumption: Assumption, factor: float, seed: int) -> Figures:
    """Measure with one assumption multiplied by ``factor``; runs in a process of its own."""
    module, _, constant = assumption.name.partition(":")
    if constant:
        home = importlib.import_module(module)
        value = getattr(home, constant)
        _set(home, constant, factor * value)
        try:
            return assumption.measure(seed, SmoothConfig())
        finally:
            _set(home, constant, value)
    section, key = assumption.name.split(".")
    settings = SmoothConfig().model_dump()
    settings[section][key] *= factor
    return assumption.measure(seed, SmoothConfig.model_validate(settings))


def table(assumptions: list[Assumption], seeds: range, jobs: int) -> pd.DataFrame:
    """One row per assumption and figure, a column per factor: root mean squares over the seeds."""
    keys = [(i, factor, seed) for i in range(len(assumptions)) for factor in assumptions[i].factors for seed in seeds]
    calls = {key: (measured, (assumptions[key[0]], *key[1:])) for key in keys}
    results = side_by_side(calls, jobs, "runs")
    rows = []
    for i, assumption in enumerate(assumptions):
        for figure in results[i, 1.0, seeds[0]]:
            squares = [[results[i, factor, seed][figure] for seed in seeds] for factor in assumption.factors]
            values = [float(np.sqrt(np.nanmean(of_seeds))) for of_seeds in squares]
            row = {"assumption": assumption.name.rpartition(":")[2], "figure": figure}
            rows.append(row | dict(zip(COLUMNS, values, strict=True)))
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_seed_arguments(parser)
    parser.set_defaults(seeds=4)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="assumptions whose name contains one of these")
    arguments = parser.parse_args()
    seeds = seeds_of(parser, arguments)
    chosen = [a for a in ASSUMPTIONS if not arguments.only or any(name in a.name for name in arguments.only)]
    if not chosen:
        parser.error("no assumption has such a name")
    for assumption in chosen:
        print(f"{assumption.name.rpartition(':')[2]}: {assumption.says}; {assumption.measure.__doc__}")
    with pd.option_context("display.width", 120, "display.float_format", "{:.4g}".format):
        print(table(chosen, seeds, arguments.jobs).to_string(index=False))
