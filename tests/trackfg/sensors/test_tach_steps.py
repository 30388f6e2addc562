"""Coarse tachs read at their steps: one pulse per revolution, speeds in whole km/h."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.sensors.tach import Wheel
from trackfg.sensors.tach_steps import at_steps, speed_rows

KMH = 1.0 / 3.6


def counter(t: Array, distance: Array, quantum: float) -> Wheel:
    count = quantum * np.floor(distance / quantum)
    return Wheel(t, count, quantum / np.sqrt(12.0), quantum, False, np.zeros((0, 2)))


def speedometer(t: Array, speed: Array) -> Wheel:
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    return Wheel(t, distance, 1e-4, 0.0, True, np.zeros((0, 2)))


def braked(t: Array) -> Array:
    """Distance of a vehicle that brakes from 20 m/s by 0.5 m/s^2, to a stop after 40 s and 400 m."""
    t = np.minimum(t, 40.0)
    return 20.0 * t - 0.25 * t**2


def test_a_pulse_per_revolution_is_read_at_its_steps() -> None:
    """At 20 m/s a row is 0.4 m long: 0.4 / sqrt(12) = 0.115 m, where the count is known to 2.7 / sqrt(12) = 0.78 m."""
    t = np.arange(0.0, 60.0, 0.02)
    wheel = at_steps(counter(t, braked(t), 2.7))
    fast, late = np.arange(1.0, 30.0, 0.37), np.array([42.0, 50.0, 58.0])
    error = wheel.at(fast) - braked(fast)
    # Half a quantum is the count's own, and the same all the time.
    assert error.mean() == pytest.approx(-1.35, abs=0.02)
    assert np.abs(error + 1.35).max() < 0.25
    sd = wheel.reading_sd(fast)
    assert sd[0] == pytest.approx(0.115, rel=0.1)
    assert np.std(error) < 1.2 * sd.mean()
    np.testing.assert_allclose(wheel.reading_sd(late), 2.7 / np.sqrt(12.0))
    assert np.abs(wheel.at(late) - braked(late) + 1.35).max() < 1.35


def test_a_fine_count_stays_as_it_is() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    wheel = counter(t, braked(t), 0.03)
    assert at_steps(wheel) is wheel


def test_speeds_come_back_from_their_integral() -> None:
    """Rows of 3, 3, 4, 5, 5, 5, 4 km/h, 0.2 s apart: neighbours add up to 6, 7, 9, 10, 10, 9 km/h."""
    shown = np.repeat([3.0, 4.0, 5.0, 4.0, 3.0], [4, 3, 6, 3, 2]) * KMH
    wheel = speedometer(0.2 * np.arange(len(shown)), shown)
    rows = speed_rows(wheel.t, wheel.distance)
    assert rows is not None
    np.testing.assert_allclose(rows[0], shown, atol=1e-9)
    assert rows[1] == pytest.approx(KMH)


def test_a_speed_without_steps_stays_as_it_is() -> None:
    rng = np.random.default_rng(0)
    wheel = speedometer(0.2 * np.arange(500), 10.0 + 0.1 * rng.standard_normal(500))
    assert at_steps(wheel) is wheel


@pytest.mark.parametrize(("rounded", "offset"), [(np.round, 0.0), (np.floor, -0.5 * KMH)])
def test_whole_kmh_are_exact_where_they_step(rounded: np.ufunc, offset: float) -> None:
    """A vehicle that speeds up by 0.05 m/s^2 shows each km/h for 5.6 s; where it steps, the speed is between the two.
    The speed is right to some 0.1 km/h then, besides the half km/h of values that are cut off.
    """
    t = np.arange(0.0, 200.0, 0.2)
    true = 5.01 + 0.05 * t
    wheel = at_steps(speedometer(t, rounded(true / KMH) * KMH))
    middle = np.arange(20.0, 180.0, 1.0)
    speed = wheel.at(middle + 0.5) - wheel.at(middle - 0.5)
    np.testing.assert_allclose(speed - (5.01 + 0.05 * middle), offset, atol=0.1 * KMH)
    assert wheel.offset_sd_mps == pytest.approx(0.5 * KMH)


def test_a_speed_that_stays_is_off_by_the_same_all_the_time() -> None:
    """20 km/h for 100 s, between two steps: the true speed is anywhere within half a km/h, the distance within 100 s x
    1 km/h / sqrt(12) = 8.02 m (1 sigma). Where the speed steps every second, it is far better.
    """
    shown = np.concatenate(
        [np.repeat(np.arange(10.0, 20.0), 5), np.full(500, 20.0), np.repeat(np.arange(21.0, 30.0), 5)]
    )
    wheel = at_steps(speedometer(0.2 * np.arange(len(shown)), shown * KMH))
    constant = np.sqrt(wheel.variance_gained(np.array([10.0, 110.0]), 0.0))
    assert constant.item() == pytest.approx(100.0 * KMH / np.sqrt(12.0), rel=0.05)
    changing = np.sqrt(wheel.variance_gained(np.array([0.0, 9.0]), 0.0))
    assert changing.item() < 0.2
