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
    run = smoothed("mainline", seed=3, duration_s=300.0)
    reassessment = rectification(run)
    assert reassessment.problem is run.problem
    assert reassessment.findings == ()
    assert np.abs(run.solution.states.imu[0, RECTIFICATION]) == pytest.approx(np.zeros(3), abs=1e-3)
