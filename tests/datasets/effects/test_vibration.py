"""Vibration has the level, the band and the places that it is said to have."""

import numpy as np
import pytest
from scipy.signal import periodogram

from trackfg.datasets.effects.vibration import (
    AT_MPS,
    JOINT_M,
    PLACES,
    RANGE_MPS2,
    Idling,
    Rectification,
    Saturation,
    Vibration,
)
from trackfg.datasets.sensors.imu_grades import ADIS16495_1

RATE_HZ = 200.0


def added(run, effect):
    """What an effect adds to the samples, gyro and accelerometer, and the speed at each sample."""
    rough, clean = run(effect).recording, run().recording
    speed = np.abs(run().ride.motion.speed(clean.imu["t_s"].to_numpy()))
    return rough.gyro - clean.gyro, rough.accel - clean.accel, speed


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


@pytest.mark.parametrize("place", ["body", "bogie", "axle-box"])
def test_unfiltered_vibration_has_its_rms_at_speed_along_each_axis(run, place):
    _, accel, speed = added(run, Vibration(3.0, place=place, sampling="instant"))
    moving = speed > 5.0
    relative = accel[moving] * AT_MPS / speed[moving, None]
    assert rms(relative) == pytest.approx(3.0 * np.array(PLACES[place].axes), rel=0.03)
    assert np.abs(accel[speed == 0.0]).max() == 0.0


def test_unfiltered_vibration_is_white_and_a_low_pass_or_a_mean_takes_it_out(run):
    floors = {}
    for sampling in ("instant", "average", "filtered"):
        _, accel, speed = added(run, Vibration(2.0, place="axle-box", sampling=sampling))
        f, density = periodogram(accel[speed > 5.0, 2] / speed[speed > 5.0] * AT_MPS, fs=RATE_HZ)
        floors[sampling] = density[(f > 0.2) & (f < 4.0)].mean(), density[(f > 20.0) & (f < 70.0)].mean()
    # All of the power, 2^2 (m/s^2)^2, lies between 0 and 100 Hz: 0.04 everywhere.
    assert floors["instant"][0] == pytest.approx(0.04, rel=0.2)
    assert floors["instant"][1] == pytest.approx(0.04, rel=0.05)
    # Unaliased, a band of 490 Hz holds it, and the slopes of its filter, which are a tenth to a quarter wider.
    assert floors["filtered"][1] == pytest.approx(4.0 / 490.0 / 1.17, rel=0.1)
    assert floors["filtered"][0] < 0.01 * floors["instant"][0]
    assert floors["average"][0] < 0.2 * floors["instant"][0]


def test_a_vibration_turns_what_it_shakes_as_its_arm_says(run):
    gyro, _, speed = added(run, Vibration(2.0, place="bogie", sampling="instant"))
    place = PLACES["bogie"]
    low, high = place.band_hz
    # A density of 1/(high - low) over (2 pi f)^2, integrated over the band.
    expected = 2.0 / place.arm_m * np.sqrt((1.0 / low - 1.0 / high) / (high - low)) / (2.0 * np.pi)
    moving = speed > 5.0
    assert rms(gyro[moving] * AT_MPS / speed[moving, None]) == pytest.approx(np.full(3, expected), rel=0.35)


def test_the_oracle_has_vibration_declared_by_the_level_of_the_samples(run):
    effect = Vibration(2.0, place="bogie", sampling="instant")
    _, accel, _ = added(run, effect)
    oracle = run(Vibration(2.0, place="bogie", sampling="instant", for_oracle=True)).recording
    assert np.array_equal(oracle.accel, run(effect).recording.accel)
    density = np.hypot(ADIS16495_1.noise.accel_white, np.sqrt(np.mean(accel**2) / RATE_HZ))
    assert oracle.description.imu.noise.accel_white == pytest.approx(density)


def test_an_engine_shakes_at_rest_at_its_harmonics(run):
    gyro, accel, speed = added(run, Idling(1.5))
    assert rms(accel) == pytest.approx(1.5 * np.array(PLACES["body"].axes), rel=0.05)
    assert rms(accel[speed == 0.0][:, 2]) == pytest.approx(1.5, rel=0.1)
    assert np.abs(accel.mean(axis=0)).max() < 0.01
    f, density = periodogram(accel[:, 2], fs=RATE_HZ)
    assert density[f < 8.0].sum() < 1e-3 * density.sum()
    assert 0.003 < rms(gyro).max() < 0.03


def test_rectification_moves_the_mean_by_the_power(run):
    with_bias, without = Rectification(2e-3), Rectification(2e-3, for_oracle=True)
    assert run(without).recording.description.imu.noise.accel_white > ADIS16495_1.noise.accel_white
    bias = run(with_bias).recording.accel - run(without).recording.accel
    speed = np.abs(run().ride.motion.speed(run().recording.imu["t_s"].to_numpy()))
    power = (5.0 * speed[:, None] / AT_MPS * np.array(PLACES["bogie"].axes)) ** 2
    assert np.abs(bias) == pytest.approx(2e-3 * power, abs=1e-9)
    assert np.ptp(np.sign(bias[speed > 1.0]), axis=0).max() == 0.0


def test_shocks_beyond_the_range_leave_a_mean_and_others_do_not(run):
    _, oracle, _ = added(run, Saturation(200.0, for_oracle=True))
    _, clipped, speed = added(run, Saturation(200.0))
    assert np.abs(oracle.mean(axis=0)).max() < 1e-3
    assert clipped.mean(axis=0)[2] < -0.01
    assert run(Saturation(200.0)).recording.accel.max() <= RANGE_MPS2 + 1e-9
    # A joint every 25 m shakes some 0.1 s at 10 m/s and more: a share of the samples that grows with the speed.
    distance = np.ptp(run().truth["chainage_m"])
    shaken = np.abs(oracle[:, 2]) > 1.0
    starts = np.count_nonzero(np.diff(shaken.astype(int)) == 1)
    assert starts >= 0.5 * distance / JOINT_M
    assert np.abs(oracle[speed == 0.0][:, 2]).max() < 1e-3
