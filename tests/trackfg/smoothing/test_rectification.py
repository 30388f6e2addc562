"""An accelerometer whose bias grows with vibration: found where it does, and nothing said where it does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.factors.bias import RECTIFICATION
from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import KEYFRAME_DIM, Kind, offset_in_keyframe
from trackfg.smoothing.reassessment import Reassessment
from trackfg.smoothing.rectification import rectification
from trackfg.smoothing.smoother import SmoothedStates, smooth_states


def shaken(name: str, magnitude: float) -> Simulation:
    train: Scenario = replace(scenario("slippery-line"), adhesion=None)
    return simulate(replace(train, effects=(effect(name, magnitude),)), seed=1, duration_s=200.0)


def tilt_error(run: Simulation, smoothed: SmoothedStates) -> np.ndarray:
    table, truth = smoothed.trajectory, run.truth
    errors = [table[name] - np.interp(table["t_s"], truth["t_s"], truth[name]) for name in ("roll_rad", "pitch_rad")]
    return np.sqrt(np.mean(np.square(errors), axis=1))


def test_a_large_one_is_found_and_takes_its_tilt_along() -> None:
    run = shaken("rectification", 6.5e-3)
    smoothed = smooth_states(run.recording, SmoothConfig())
    # 5 m/s^2 of vibration at 20 m/s, of which a filter leaves a quarter of the power: up to 0.16 m/s^2, 16 mrad.
    assert np.abs(smoothed.solution.states.imu[0, RECTIFICATION]).min() > 0.01
    assert tilt_error(run, smoothed).max() < 4e-3
    assert "vibration-rectification" in [finding.code for finding in smoothed.findings]


def test_without_it_the_prior_stays(smoothed: Callable[..., SmoothedStates]) -> None:
    run = smoothed("mainline", seed=3, duration_s=260.0)
    reassessment = rectification(run)
    assert reassessment.problem is run.problem
    assert reassessment.findings == ()
    assert np.abs(run.solution.states.imu[0, RECTIFICATION]) == pytest.approx(np.zeros(3), abs=1e-3)


def with_coefficient(run: SmoothedStates, k: float) -> SmoothedStates:
    """Return the run as if its solution had said k along x, beyond doubt."""
    imu = run.solution.states.imu.copy()
    imu[0, RECTIFICATION.start] = k
    states = replace(run.solution.states, imu=imu)
    of_shared = run.covariance.of_shared.copy()
    at = offset_in_keyframe(Kind.IMU) - KEYFRAME_DIM + RECTIFICATION.start
    of_shared[at, at] = 1e-12
    covariance = replace(run.covariance, of_shared=of_shared)
    return replace(run, solution=replace(run.solution, states=states), covariance=covariance)


def sigma_of(reassessment: Reassessment) -> np.ndarray:
    prior = reassessment.problem.family(FactorType.PRIOR_IMU)
    assert prior is not None
    return np.asarray(prior.sigma[0, RECTIFICATION])


def test_the_prior_follows_the_data_up_and_down_and_no_further_than_any_sensor(
    smoothed: Callable[..., SmoothedStates],
) -> None:
    run = smoothed("mainline", seed=3, duration_s=260.0)
    first = sigma_of(rectification(run))
    wide = rectification(with_coefficient(run, 0.03))
    assert sigma_of(wide) == pytest.approx(0.03, rel=1e-3)
    assert wide.doubts == ()
    widened = replace(run, problem=wide.problem)
    assert sigma_of(rectification(with_coefficient(widened, 0.01))) == pytest.approx(0.01, rel=1e-3)
    assert sigma_of(rectification(with_coefficient(widened, 1e-4))) == pytest.approx(first)
    beyond = rectification(with_coefficient(run, 1.0))
    assert sigma_of(beyond) == pytest.approx(0.065)
    assert [doubt.factor for doubt in beyond.doubts] == [pytest.approx(1.0 / 0.065, rel=1e-3)]
