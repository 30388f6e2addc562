"""Noise levels from residuals: nothing where what is declared is true, and more where and of what is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri, ndtr

from trackfg.config import NoiseConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.recording.model import IMU_COLUMNS
from trackfg.smoothing.noise_levels import levels, levels_over_time, levels_seen, noise_levels, raised_level
from trackfg.smoothing.reassessment import SolvedRun
from trackfg.smoothing.smoother import SmoothedStates, smooth, smooth_states
from trackfg.solver.variance_components import Residuals

DURATION_S = 260.0
ACCEL = list(IMU_COLUMNS[4:])
FIXED = SmoothConfig(noise=NoiseConfig(adapt=False))


def swayed(run: Simulation, begin_s: float, end_s: float) -> Any:
    """The recording with accelerations of 1 m/s^2 below 2 Hz that are none: no spectrum shows that."""
    imu = run.recording.imu.copy()
    t = imu["t_s"].to_numpy()
    sway = uniform_filter1d(np.random.default_rng(0).standard_normal((len(t), 3)), 50, axis=0)
    imu[ACCEL] += sway / sway.std() * ((t > begin_s) & (t < end_s))[:, None]
    return replace(run.recording, imu=imu)


def test_what_is_declared_stays_where_it_is_true(smoothed: Callable[..., SmoothedStates]) -> None:
    run = smoothed("mainline", seed=3, duration_s=DURATION_S)
    reassessment = noise_levels(run)
    assert reassessment.problem is run.problem
    assert not reassessment.changed
    assert set(levels(run.declared, run.problem).values()) == {1.0}


def test_a_stretch_of_bad_samples_has_a_level_of_its_own(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=3, duration_s=DURATION_S)
    recording = swayed(run, 200.0, 240.0)
    found = smooth_states(recording, SmoothConfig())
    raised = found.problem.run.noise.accel[:, 2] / found.declared.run.noise.accel[:, 2]
    t = found.problem.t[:-1]
    assert np.median(raised[(t > 205.0) & (t < 235.0)]) > 10.0
    assert np.median(raised[t < 180.0]) < 1.5
    assert "noise-level-raised" in [f.code for f in found.findings if "accelerometer" in f.message]
    assert roll_over_sigma(run, found) < 0.5 * roll_over_sigma(run, smooth_states(recording, FIXED))


def test_a_walk_that_hardly_shows_is_as_much_faster_as_that_of_the_other_triad(
    smoothed: Callable[..., SmoothedStates],
) -> None:
    """Of a gyro whose bias walks far more than declared residuals show it; the accelerometer beside it is no better."""
    run = smoothed("mainline", seed=3, duration_s=DURATION_S)

    def slow(walk: Family) -> Family:
        sigma = walk.sigma.copy()
        sigma[:, 3:] /= 30.0
        return replace(walk, sigma=sigma)

    families = changed(run.problem.families, FactorType.BIAS_WALK, slow)
    problem = replace(run.problem, families=families)
    optimist: SolvedRun = replace(run, problem=problem, declared=problem)
    seen = levels(problem, noise_levels(optimist).problem)
    assert seen["gyro_walk"] > 3.0
    assert seen["gyro_walk"] / 3.0 < seen["accel_walk"] < 3.0 * seen["gyro_walk"]


def roll_over_sigma(run: Simulation, smoothed: SmoothedStates) -> float:
    table = smoothed.trajectory
    error = table["roll_rad"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["roll_rad"])
    return float(np.sqrt(np.mean((error / table["roll_rad_sd"]) ** 2)))


def test_levels_are_not_judged_before_the_others_have_done(smoothed: Callable[..., SmoothedStates]) -> None:
    """Else a wrong fix would pass for noise of the sensors that contradict it."""
    run = smoothed("mainline", seed=3, duration_s=DURATION_S)
    families = changed(run.problem.families, FactorType.BIAS_WALK, lambda walk: replace(walk, sigma=walk.sigma / 30.0))
    optimist: SolvedRun = replace(run, problem=replace(run.problem, families=families))
    assert noise_levels(optimist).changed
    assert not noise_levels(replace(optimist, is_changing=True)).changed


def test_the_summary_has_the_levels_that_were_used(simulated: Callable[..., Simulation]) -> None:
    recording = swayed(simulated("mainline", seed=3, duration_s=120.0), 70.0, 90.0)
    summary = smooth(recording, SmoothConfig()).summary
    noise: Any = summary.configuration["noise"]
    assert noise["accel"] > 3.0
    fixed: Any = smooth(recording, FIXED).summary.configuration["noise"]
    assert fixed["accel"] == pytest.approx(1.0)


def test_chance_raises_no_stretch_of_a_long_run() -> None:
    """Of 4 h with the declared noise some 1000 stretches are tested: three sigmas of one are nothing for the largest,
    and a shock of three times the noise is still seen.
    """
    raised = 0
    for seed in range(10):
        values = np.random.default_rng(seed).standard_normal((16_000, 3))
        usual = Residuals(np.arange(16_000), values, np.ones_like(values))
        raised += np.count_nonzero(levels_over_time(usual, np.ones(16_000))[0] > 1.0)
    assert raised < 30  # intervals: two stretches of 15 in 160 000
    values[8000:8015] *= 3.0
    shaken = Residuals(np.arange(16_000), values, np.ones_like(values))
    assert (levels_over_time(shaken, np.ones(16_000))[0][8005:8010] > 1.5).all()


def test_a_noisy_sensor_that_little_checks_has_the_level_of_all_its_stretches() -> None:
    """Each stretch alone says little: ten times the noise, of which the graph sees a hundredth part."""
    seen = np.full((600, 3), 0.01)
    values = 10.0 * np.sqrt(seen) * np.random.default_rng(1).standard_normal(seen.shape)
    level, usual = levels_over_time(Residuals(np.arange(600), values, seen), np.ones(600))
    assert np.count_nonzero(~usual) > 400
    assert np.median(level[~usual]) > 7.0


@pytest.mark.parametrize("redundancy", [3.0, 10.0, 30.0])
def test_stretches_that_little_checks_are_raised_by_chance_as_rarely_as_others(redundancy: float) -> None:
    """Sums of few squares are far more often far off than normal values of their variance; a day has 6000 stretches."""
    limit = chdtri(redundancy, ndtr(-3.0) / 6000.0)
    assert levels_seen(0.99 * limit, redundancy, tests=6000.0) == 1.0
    assert levels_seen(1.01 * limit, redundancy, tests=6000.0) > 1.0


def test_a_level_that_no_noise_explains_names_the_unit() -> None:
    assert "unit" in raised_level("accel", 177.0)
    assert "unit" not in raised_level("accel", 9.0)
    assert "unit" not in raised_level("motion", 177.0)
