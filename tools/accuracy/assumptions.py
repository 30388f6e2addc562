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

from accuracy.changes import compared, defects, near_defects
from accuracy.curves import (
    LAWS,
    TRACKS,
    designed_curves,
    matched,
    profile,
    straight_line,
    value,
    value_of,
    with_half_sines,
)
from trackfg.config import SmoothConfig
from trackfg.curves import find_curves
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.line.built_in_lines import MAIN_LINE
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.vehicle.vehicle import CarBody
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.slip_scores import score_slips
from trackfg.mapping import build_map
from trackfg.mapping.recognition.conventions import recognised_near
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.result import Result
from trackfg.smoothing.localisation import SURE
from trackfg.smoothing.smoother import smooth

FACTORS = (0.5, 1.0, 2.0)
COLUMNS = ("lower", "as it is", "higher")
Figures = dict[str, float]

_DEFECT_M, _DEFECT_MM = 10.0, 2.0
_SCALE_SD = 1e-3


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


def axles(seed: int, config: SmoothConfig) -> Figures:
    """Measure distance by two axles that slip independently."""
    run = simulate("slippery-line-two-axles", seed=seed, duration_s=600.0)
    return _trajectory(run, smooth(run.recording, config), "chainage_m", "chainage, m")


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


def curves(seed: int, _: SmoothConfig) -> Figures:
    """Measure the curves found on 40 km of good and worn track, and on as much straight track."""
    missed = false = wrong_law = 0
    middles: list[Figures] = []
    for model in TRACKS.values():
        for law in LAWS:
            line = random_line(MAIN_LINE, 10e3, np.random.default_rng(seed))
            designed = designed_curves(line)
            estimates = find_curves(profile(with_half_sines(line) if law == "half-sine" else line, model, seed))
            pairs = list(matched(designed, estimates))
            missed += len(designed) - len(pairs)
            false += len(estimates) - len(pairs)
            for row, curve in pairs:
                wrong_law += (curve.law_in != law) + (curve.law_out != law)
                error = np.array([value(curve, name) - value_of(row, name) for name in ("middle_in_m", "btc_m")])
                sd = np.array([curve.sd("middle_in_m"), curve.sd("btc_m")])
                middles.append(_mean_squares("start of a curve, m", error, sd))
        false += len(find_curves(profile(straight_line(20e3), model, seed)))
    counts = {"curves missed": missed, "curves that are none": false, "laws that are wrong": wrong_law}
    return {name: float(np.mean([m[name] for m in middles])) for name in middles[0]} | {
        name: float(count) ** 2 for name, count in counts.items()
    }


@cache
def _smoothed(seed: int, run: int, *, defective: bool = False) -> tuple[Simulation, Result]:
    placed = defects(seed, _DEFECT_M, _DEFECT_MM) if defective else ()
    simulation = simulate(replace(scenario("shuttle"), defects=placed), seed=seed, run=run)
    return simulation, smooth(simulation.recording)


def _true_chainage(simulation: Simulation, result: Result, chainage_m: np.ndarray) -> np.ndarray:
    estimate = result.trajectory.sort_values("chainage_m")
    true = np.interp(estimate["t_s"], simulation.truth["t_s"], simulation.truth["chainage_m"])
    return np.asarray(np.interp(chainage_m, estimate["chainage_m"], true))


def recognised(seed: int, _: SmoothConfig) -> Figures:
    """Measure the places of a run on another one of the line, without a fix, and of one on a foreign line."""
    (base, reference), (later, run) = _smoothed(seed, 0), _smoothed(seed, 6)
    foreign, grid = _smoothed(seed + 1000, 6)[1], reference.geometry.assign(observations=1)
    figures: Figures = {}
    for name, result in (("sections unsure, %", run), ("foreign sections sure, %", foreign)):
        assert result.summary.run is not None
        match = recognised_near(
            result.geometry, grid, None, rate_sd=_SCALE_SD, direction=result.summary.run.direction
        ).sections
        sure = (match["probability"] >= SURE).to_numpy()
        figures[name] = (100.0 * float(np.mean(sure if result is foreign else ~sure))) ** 2
        if result is run:
            at_reference, at_run = (match[column].to_numpy()[sure] for column in ("reference_m", "run_m"))
            error = _true_chainage(base, reference, at_reference) - _true_chainage(later, run, at_run)
            figures |= _mean_squares("place, m", error, match["match_sd_m"].to_numpy()[sure])
    return figures


def changed(seed: int, _: SmoothConfig) -> Figures:
    """Measure the share of 18 defects of 10 m and 2 mm that is found, and what is found besides."""
    reference = _smoothed(seed, 0)[1]
    shown, _ = compared(reference, _smoothed(seed, 6, defective=True)[1])
    near = near_defects(shown.table, defects(seed, _DEFECT_M, _DEFECT_MM))
    false = np.sum(~near.any(axis=1))
    return {"defects missed": float(np.sum(~near.any(axis=0))) ** 2, "changes that are none": float(false) ** 2}


_CURVES, _RECOGNITION, _CHANGES = "trackfg.curves", "trackfg.mapping.recognition", "trackfg.mapping.changes"

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
    Assumption("trackfg.graph.forward_force:_ACCELERATION_SD", "accelerometer's error before the graph", slips),
    Assumption("trackfg.graph.wheel_slip:_ERROR_WALK", "walk of that error", slips),
    Assumption("trackfg.graph.creeping_wheel:_LASTS_S", "how long a wheel creeps by more than another", axles),
    Assumption("trackfg.output.slip_events:_RELEASE_S", "how long slide protection releases a brake", slips),
    Assumption("trackfg.output.slip_events:_EDGE_CREEP", "creep at the edges of an event", slips),
    Assumption("trackfg.output.track_geometry:_SHORT_WAVES", "short waves that the heading misses", lasers),
    Assumption("trackfg.mapping.recognition.fine_match:_CURVES_SD", "sigma of a match by curves alone", located),
    Assumption(
        "trackfg.smoothing.localisation:_ON_SPRINGS_SD_M", "place of what a body on springs shows", located_on_springs
    ),
    Assumption(f"{_CURVES}.structure:_PER_PLACE", "price of a curve's place", curves),
    Assumption(f"{_CURVES}.structure:_PER_LEVEL", "price of a curve", curves),
    Assumption(f"{_CURVES}.structure:_USUAL_SCALE", "scale of residuals above which they are no noise", curves),
    Assumption(f"{_CURVES}.segments:_PER_CONSTANT", "price of a constant piece", curves),
    Assumption(f"{_CURVES}.segments:_PER_LINEAR", "price of a linear piece", curves),
    Assumption(f"{_CURVES}.structure:PER_DISTURBANCE", "price of a disturbance", curves),
    Assumption(f"{_CURVES}.fit:_PRIOR_CELLS", "weight of the whole line's noise", curves),
    Assumption(f"{_CURVES}.cells:_LEAST_TURN_RAD", "least turn of a defect", curves),
    Assumption(f"{_RECOGNITION}.curve_likelihood:_RADIUS_CHANGE", "what maintenance does to a radius", recognised),
    Assumption(f"{_RECOGNITION}.short_wave_likelihood:_FLOOR", "residuals that are equally good", recognised),
    Assumption(f"{_RECOGNITION}.short_wave_likelihood:_TEMPERING", "weight of short waves", recognised),
    Assumption(f"{_RECOGNITION}.short_wave_likelihood:_LEAST_NOISE", "noise of short waves", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_TO_CHANGED", "how often track has changed", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_CREEP", "how often a place creeps", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_SLIP", "how often a slip was not seen", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_LEAVE", "how often a run leaves the reference", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_RETURN", "how often it returns", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_TO_OTHER", "how often a foreign line is alike another place", recognised),
    Assumption(f"{_RECOGNITION}.place_hmm:_GREATEST_LOG_RATIO", "what one section can say at most", recognised),
    Assumption(f"{_RECOGNITION}.fine_match:_CURVES_SCALE", "scale error of a match by curves", recognised),
    Assumption(f"{_RECOGNITION}.fine_match:_WALK_REST", "walk of the wheel within a section", recognised),
    # Perfect agreement is 1.
    Assumption(f"{_RECOGNITION}.section_fit:_LEAST_SHARED", "least agreement of a match", recognised, (0.5, 1.0, 1.2)),
    Assumption(f"{_CHANGES}.changes:_SLOW_M", "window of the slow difference", changed),
    Assumption(f"{_CHANGES}.changes:_SMOOTHED_M", "smoothing of the slow difference", changed),
    Assumption(f"{_CHANGES}.change_noise:_FREEDOM", "residuals from which a sigma is known", changed),
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
