"""Noise levels from the residuals: right where the declared ones are right, found where they are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from trackfg.config import NoiseConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.smoothing.smoother import smooth, smooth_states
from trackfg.solver.variance_components import adapted, noise_findings

DURATION_S = 300.0


def test_true_densities_give_ratios_near_one(simulated: Callable[..., Simulation]) -> None:
    """The simulated vehicle follows its track exactly: the sway that the motion factors allow for is not there, and a
    little of the accelerometer's noise goes into it."""
    recording = simulated("mainline-gnss", seed=3, duration_s=DURATION_S).recording
    ratios = smooth_states(recording, SmoothConfig()).noise_ratios
    assert ratios["gyro"] == pytest.approx(1.0, abs=0.15)
    assert 0.7 < ratios["accel"] < 1.15
    assert ratios["gnss"] == pytest.approx(1.0, abs=0.15)
    assert ratios["motion"] < 0.5
    assert noise_findings(ratios) == ()


def test_sigmas_declared_too_small_are_found(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline-gnss", seed=3, duration_s=DURATION_S).recording
    assert recording.gnss is not None
    gnss = recording.gnss.copy()
    gnss[["east_sd_m", "north_sd_m", "up_sd_m"]] /= 4.0
    optimist = replace(recording, gnss=gnss)
    warned = smooth(optimist, SmoothConfig()).summary
    assert [finding.code for finding in warned.findings] == ["noise-level"]
    assert "'gnss'" in warned.findings[0].message
    smoothed = smooth_states(optimist, SmoothConfig(noise=NoiseConfig(adapt=True)))
    assert smoothed.config.noise.gnss == pytest.approx(4.0, rel=0.15)
    assert smoothed.config.noise.gyro == pytest.approx(1.0, rel=0.15)
    assert smoothed.noise_ratios["gnss"] == pytest.approx(1.0, abs=0.1)


def test_levels_never_go_below_what_is_declared() -> None:
    config = SmoothConfig(noise=NoiseConfig(gyro=3.0))
    factors = adapted(config, {"gyro": 0.5, "accel": 0.1, "gnss": 2.0}).noise.factors()
    assert factors == {"gyro": 1.5, "accel": 1.0, "motion": 1.0, "path": 1.0, "tach": 1.0, "gnss": 2.0}
