"""Noise does not pull the scales of an inertial sensor whose calibration is hardly known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.inertial import LOW_COST
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.imu_errors import ImuResponse
from trackfg.factors.bias import OF_ACCELEROMETER, OF_GYRO_RATE
from trackfg.factors.states import Kind
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.smoothing import noisy_response
from trackfg.smoothing.smoother import smooth_states


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A recording of a noisy sensor whose scale factors are exact; the declared sigma of its scale factors is 1 %."""
    plan = scenario("mainline")
    run = simulate(
        replace(plan, imu=replace(plan.imu, noise=LOW_COST, response=ImuResponse())), seed=3, duration_s=300.0
    )
    declared = run.recording.description
    noise = declared.imu.noise.model_copy(update={"gyro_scale_sd": 0.01, "accel_scale_sd": 0.01})
    imu = declared.imu.model_copy(update={"noise": noise})
    return replace(run.recording, description=declared.model_copy(update={"imu": imu}))


def scales(recording: Recording) -> Array:
    """Return by how many of their sigmas the scales of accelerometer and gyro are off, (6,)."""
    smoothed = smooth_states(recording, SmoothConfig())
    sigmas = smoothed.solution.states.imu[0] / np.sqrt(np.diagonal(smoothed.covariance.of(Kind.IMU)[0]))
    return np.concatenate([np.diagonal(sigmas[part].reshape(3, 3)) for part in (OF_ACCELEROMETER, OF_GYRO_RATE)])


def test_noise_does_not_pull_all_scales_one_way(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    found = scales(recording).mean()
    assert abs(found) < 0.5
    monkeypatch.setattr(noisy_response, "_PULLED", np.inf)
    assert scales(recording).mean() > found + 0.5
