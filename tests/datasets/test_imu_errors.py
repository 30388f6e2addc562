"""The errors of an IMU are those asked for."""

import numpy as np
import pytest

from trackfg.datasets import tables
from trackfg.datasets.catalogue import ADIS16480
from trackfg.datasets.imu_errors import ImuModel, apply_errors, draw_errors


def test_white_noise_has_its_density(allan_deviation):
    rate, seconds = 200.0, 600.0
    errors = draw_errors(ImuModel(rate, ADIS16480), tables.clock(seconds, rate), np.random.default_rng(1))
    for noise, density in ((errors.gyro_noise, ADIS16480.gyro_white), (errors.accel_noise, ADIS16480.accel_white)):
        for averaging in (1, 20, 200):
            expected = density / np.sqrt(averaging / rate)
            tolerance = 4 / np.sqrt(seconds * rate / averaging)
            np.testing.assert_allclose(allan_deviation(noise, averaging), expected, rtol=tolerance)


def test_biases_start_and_walk_as_asked():
    model = ImuModel(50.0, ADIS16480)
    edges = tables.clock(100.0, 50.0)
    drawn = [draw_errors(model, edges, np.random.default_rng(seed)) for seed in range(200)]
    for name, start_sd, walk in (
        ("gyro_bias", ADIS16480.gyro_bias_sd, ADIS16480.gyro_bias_walk),
        ("accel_bias", ADIS16480.accel_bias_sd, ADIS16480.accel_bias_walk),
    ):
        bias = np.stack([getattr(errors, name) for errors in drawn])
        assert bias[:, 0].std() == pytest.approx(start_sd, rel=0.15)
        walked = bias[:, -1] - bias[:, 0]
        assert walked.std() == pytest.approx(walk * np.sqrt(100.0), rel=0.15)


def test_mounting_turns_the_sensor():
    model = ImuModel(10.0, ADIS16480, mount_sd_rad=0.01)
    edges = tables.clock(1.0, 10.0)
    errors = draw_errors(model, edges, np.random.default_rng(2))
    _, pitch, yaw = errors.mount_rpy_rad
    assert pitch != 0
    assert yaw != 0
    silent = apply_errors(np.zeros((10, 3)), np.zeros((10, 3)), errors)
    _, accel = apply_errors(np.zeros((10, 3)), np.tile([0.0, 0.0, 9.8], (10, 1)), errors)
    # A sensor that sits nose-down feels gravity on its x axis as a vehicle that is nose-down does.
    np.testing.assert_allclose((accel - silent[1])[:, 0], -9.8 * np.sin(pitch), rtol=1e-6)
    mounts = [draw_errors(model, edges, np.random.default_rng(seed)).mount_rpy_rad[1:] for seed in range(300)]
    assert np.std(mounts) == pytest.approx(0.01, rel=0.12)
