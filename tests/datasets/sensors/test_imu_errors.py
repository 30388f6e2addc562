"""The errors of an IMU are those asked for."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets import tables
from trackfg.datasets.sensors.imu_errors import ImuModel, ImuResponse, apply_errors, draw_errors
from trackfg.datasets.sensors.imu_grades import ADIS16480, ADIS16495_1

NOISE = ADIS16480.noise


def _silent(response=None, **mounting):
    """An IMU with next to no noise and bias."""
    nothing = dict.fromkeys(type(NOISE).model_fields, 1e-30)  # less than a recording may declare
    return ImuModel(10.0, type(NOISE).model_construct(**nothing), response=response or ImuResponse(), **mounting)


def _out(model, gyro, accel, seed=0):
    n = len(gyro)
    return apply_errors(gyro, accel, draw_errors(model, tables.clock(n / 10.0, 10.0), np.random.default_rng(seed)))


def test_white_noise_has_its_density(allan_deviation):
    rate, seconds = 200.0, 600.0
    errors = draw_errors(ImuModel(rate, NOISE), tables.clock(seconds, rate), np.random.default_rng(1))
    for noise, density in ((errors.gyro_noise, NOISE.gyro_white), (errors.accel_noise, NOISE.accel_white)):
        for averaging in (1, 20, 200):
            expected = density / np.sqrt(averaging / rate)
            tolerance = 4 / np.sqrt(seconds * rate / averaging)
            np.testing.assert_allclose(allan_deviation(noise, averaging), expected, rtol=tolerance)


def test_biases_start_and_walk_as_asked():
    model = ImuModel(50.0, NOISE)
    edges = tables.clock(100.0, 50.0)
    drawn = [draw_errors(model, edges, np.random.default_rng(seed)) for seed in range(200)]
    for name, start_sd, walk in (
        ("gyro_bias", NOISE.gyro_bias_sd, NOISE.gyro_bias_walk),
        ("accel_bias", NOISE.accel_bias_sd, NOISE.accel_bias_walk),
    ):
        bias = np.stack([getattr(errors, name) for errors in drawn])
        assert bias[:, 0].std() == pytest.approx(start_sd, rel=0.15)
        walked = bias[:, -1] - bias[:, 0]
        assert walked.std() == pytest.approx(walk * np.sqrt(100.0), rel=0.15)


def test_a_walking_bias_has_its_allan_deviation(allan_deviation):
    rate, seconds = 50.0, 20_000.0
    errors = draw_errors(ImuModel(rate, NOISE), tables.clock(seconds, rate), np.random.default_rng(4))
    # Rate random walk: K sqrt(tau / 3).
    for averaging in (500, 2500):
        tau = averaging / rate
        tolerance = 4 / np.sqrt(seconds / tau)
        expected = NOISE.gyro_bias_walk * np.sqrt(tau / 3)
        np.testing.assert_allclose(allan_deviation(errors.gyro_bias, averaging), expected, rtol=tolerance)


def test_mounting_turns_the_sensor():
    model = ImuModel(10.0, NOISE, mount_sd_rad=0.01)
    edges = tables.clock(1.0, 10.0)
    errors = draw_errors(model, edges, np.random.default_rng(2))
    roll, pitch, yaw = errors.mount_rpy_rad
    assert roll == 0
    assert pitch != 0
    assert yaw != 0
    silent = apply_errors(np.zeros((10, 3)), np.zeros((10, 3)), errors)
    _, accel = apply_errors(np.zeros((10, 3)), np.tile([0.0, 0.0, 9.8], (10, 1)), errors)
    # A sensor that sits nose-down measures gravity on its x axis as a vehicle that is nose-down does.
    np.testing.assert_allclose((accel - silent[1])[:, 0], -9.8 * np.sin(pitch), rtol=1e-6)
    mounts = [draw_errors(model, edges, np.random.default_rng(seed)).mount_rpy_rad[1:] for seed in range(300)]
    assert np.std(mounts) == pytest.approx(0.01, rel=0.12)


def test_mounting_rolls_by_a_sigma_of_its_own():
    model = _silent(mount_roll_sd_rad=0.02)
    edges = tables.clock(1.0, 10.0)
    mounts = np.array([draw_errors(model, edges, np.random.default_rng(seed)).mount_rpy_rad for seed in range(300)])
    assert mounts[:, 0].std() == pytest.approx(0.02, rel=0.12)
    assert not mounts[:, 1:].any()
    _, accel = _out(model, np.zeros((1, 3)), np.array([[0.0, 0.0, 9.8]]))
    roll = draw_errors(model, tables.clock(0.1, 10.0), np.random.default_rng(0)).mount_rpy_rad[0]
    np.testing.assert_allclose(accel[0], [0.0, 9.8 * np.sin(roll), 9.8 * np.cos(roll)], atol=1e-12)


def test_what_an_imu_keeps_has_a_stream_of_its_own():
    model, edges = replace(ADIS16480.imu(200.0), mount_roll_sd_rad=0.02), tables.clock(0.1, 200.0)
    one, two = (draw_errors(model, edges, np.random.default_rng(seed), np.random.default_rng(5)) for seed in (1, 2))
    own = draw_errors(model, edges, np.random.default_rng(1))
    for name in ("mount_rpy_rad", "gyro_matrix", "accel_matrix", "g_sensitivity"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
        assert not np.array_equal(getattr(one, name), getattr(own, name)), name
    for name in ("gyro_noise", "accel_noise", "gyro_bias", "accel_bias"):
        assert not np.array_equal(getattr(one, name), getattr(two, name)), name
        assert np.array_equal(getattr(one, name), getattr(own, name)), name


def test_scale_and_misalignment_act_on_each_axis_with_their_sigmas():
    response = ImuResponse(
        gyro_scale_sd=1e-3, accel_scale_sd=2e-3, gyro_misalignment_sd_rad=3e-3, accel_misalignment_sd_rad=4e-3
    )
    each_axis, nothing = np.eye(3), np.zeros((3, 3))
    gyros, accels = [], []
    for seed in range(300):
        gyros.append(_out(_silent(response), each_axis, nothing, seed)[0] - np.eye(3))
        accels.append(_out(_silent(response), nothing, each_axis, seed)[1] - np.eye(3))
    diagonal = np.eye(3, dtype=bool)
    for matrices, scale, misalignment in ((gyros, 1e-3, 3e-3), (accels, 2e-3, 4e-3)):
        stack = np.array(matrices)
        assert stack[:, diagonal].std() == pytest.approx(scale, rel=0.1)
        assert stack[:, ~diagonal].std() == pytest.approx(misalignment, rel=0.1)
        # Each of the nine is drawn on its own.
        correlation = np.corrcoef(stack.reshape(300, 9).T)
        assert np.abs(correlation - np.eye(9)).max() < 0.3


def test_the_gyro_measures_specific_force():
    response = ImuResponse(g_sensitivity_sd=1e-5)
    each_axis, nothing = np.eye(3), np.zeros((3, 3))
    sensed = np.array([_out(_silent(response), nothing, each_axis, seed)[0] for seed in range(300)])
    assert sensed.std() == pytest.approx(1e-5, rel=0.06)
    one = _out(_silent(response), nothing, 9.8 * each_axis, 7)
    np.testing.assert_allclose(one[0], 9.8 * sensed[7], rtol=1e-9)
    np.testing.assert_allclose(one[1], 9.8 * each_axis, rtol=0, atol=1e-15)


def test_saturation_is_exact():
    response = ImuResponse(gyro_range_radps=0.5, accel_range_mps2=20.0)
    gyro = np.array([[0.4, 0.6, -0.7], [-0.5, 0.0, 10.0]])
    accel = np.array([[19.0, 21.0, -30.0], [0.0, -20.0, 9.8]])
    felt_gyro, felt_accel = _out(_silent(response), gyro, accel)
    np.testing.assert_allclose(felt_gyro, [[0.4, 0.5, -0.5], [-0.5, 0.0, 0.5]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(felt_accel, [[19.0, 20.0, -20.0], [0.0, -20.0, 9.8]], rtol=0, atol=1e-14)


def test_quantisation_is_exact_and_comes_last():
    response = ImuResponse(gyro_resolution_radps=1e-3, accel_resolution_mps2=0.25, accel_range_mps2=10.1)
    truth = np.random.default_rng(0).uniform(-15.0, 15.0, (1000, 3))
    gyro, accel = _out(_silent(response), 0.01 * truth, truth)
    np.testing.assert_array_equal(gyro, np.rint(0.01 * truth / 1e-3) * 1e-3)
    # 10.1 is no multiple of the resolution: what saturates is rounded afterwards.
    np.testing.assert_array_equal(accel, np.rint(np.clip(truth, -10.1, 10.1) / 0.25) * 0.25)
    noisy = ImuModel(10.0, NOISE, response=response)
    gyro, _ = _out(noisy, 0.01 * truth, truth)
    np.testing.assert_allclose(gyro / 1e-3, np.rint(gyro / 1e-3), atol=1e-9)


def test_a_response_leaves_noise_and_bias_as_they_are():
    edges = tables.clock(10.0, 200.0)
    plain = draw_errors(ImuModel(200.0, NOISE), edges, np.random.default_rng(5))
    full = draw_errors(ImuModel(200.0, NOISE, response=ADIS16480.response), edges, np.random.default_rng(5))
    for name in ("gyro_noise", "accel_noise", "gyro_bias", "accel_bias"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(full, name))
    np.testing.assert_array_equal(plain.gyro_matrix, np.eye(3))
    assert plain.mount_rpy_rad == full.mount_rpy_rad


@pytest.mark.parametrize("grade", [ADIS16480, ADIS16495_1])
def test_a_seed_repeats_two_differ_and_a_longer_run_begins_alike(grade):
    model = ImuModel(200.0, grade.noise, mount_sd_rad=0.01, response=grade.response)
    rng = np.random.default_rng(0)
    gyro, accel = 0.1 * rng.standard_normal((4000, 3)), rng.normal([0.0, 0.0, 9.8], 1.0, (4000, 3))

    def run(seed, seconds):
        n = int(200 * seconds)
        errors = draw_errors(model, tables.clock(seconds, 200.0), np.random.default_rng(seed))
        return np.hstack(apply_errors(gyro[:n], accel[:n], errors))

    long = run(3, 20.0)
    np.testing.assert_array_equal(run(3, 20.0), long)
    np.testing.assert_allclose(run(3, 10.0), long[:2000], rtol=0, atol=1e-13)
    assert (run(4, 20.0) != long).all()


def test_grades_are_those_of_the_data_sheets():
    degree = np.pi / 180
    assert ADIS16480.noise.gyro_white == pytest.approx(0.3 * degree / 60, rel=1e-3)
    assert ADIS16495_1.noise.gyro_white == pytest.approx(0.09 * degree / 60, rel=1e-3)
    # What the walk of the bias does in 400 s is the in-run stability.
    assert ADIS16480.noise.gyro_bias_walk * np.sqrt(400) == pytest.approx(6 * degree / 3600, rel=0.05)
    assert ADIS16495_1.noise.gyro_bias_walk * np.sqrt(400) == pytest.approx(0.8 * degree / 3600, rel=0.05)
    own = replace(ADIS16480, response=replace(ADIS16480.response, gyro_resolution_radps=1e-4))
    gyro, _ = _out(ImuModel(10.0, own.noise, response=own.response), np.zeros((5, 3)), np.zeros((5, 3)))
    np.testing.assert_allclose(gyro / 1e-4, np.rint(gyro / 1e-4), atol=1e-9)
