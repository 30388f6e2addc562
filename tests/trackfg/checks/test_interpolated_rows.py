"""Rows by which a hole of the IMU's record was filled are told from measurements."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.checks.inertial.interpolated_rows import InterpolatedRows, interpolated_times
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu

RATE_HZ = 100.0
IMU = Imu(file="imu.csv", time="t", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
SIGMA = np.repeat([IMU.noise.gyro_white, IMU.noise.accel_white], 3) * np.sqrt(RATE_HZ)
FIRST, END = 400, 560
"""Rows of the hole: 1.6 s of them."""


def riding(noise: float = 1.0, seed: int = 0) -> Array:
    """Rows (n, 7) of 10 s: a curve begins and ends, a vehicle brakes, with noise of so many declared sigmas."""
    rng, t = np.random.default_rng(seed), np.arange(1000) / RATE_HZ
    values = noise * rng.normal(0.0, SIGMA, (1000, 6))
    values += np.outer(np.sin(0.5 * t), [0.02, 0.01, 0.3, -1.0, 3.0, 0.4])
    values[:, 5] += 9.81
    return np.column_stack([t, values])


def filled(rows: Array, first: int = FIRST, end: int = END) -> Array:
    """Rows from ``first`` to before ``end`` interpolated between their neighbours."""
    out, t = rows.copy(), rows[:, 0]
    for channel in range(1, 7):
        kept = np.delete(rows[:, channel], slice(first, end))
        out[:, channel] = np.interp(t, np.delete(t, slice(first, end)), kept)
    return out


def taken(rows: Array, cuts: list[int]) -> tuple[Array, Array]:
    """What is left of rows that come in groups, and the times of the others."""
    detector = InterpolatedRows.of(IMU, is_canonical=True)
    pieces = [detector.take(group) for group in np.split(rows, cuts)]
    return np.concatenate([*(kept for kept, _ in pieces), detector.finish()]), np.concatenate([t for _, t in pieces])


@pytest.mark.parametrize("digits", [None, 6])
def test_a_filled_hole_is_found_but_for_its_first_row(digits: int | None) -> None:
    rows = filled(riding())
    rows = rows if digits is None else np.round(rows, digits)
    np.testing.assert_array_equal(interpolated_times(IMU, [rows]), rows[FIRST + 1 : END, 0])


@given(st.lists(st.integers(0, 1000), max_size=30))
@settings(max_examples=60, deadline=None)
def test_how_rows_are_grouped_makes_no_difference(cuts: list[int]) -> None:
    rows = filled(filled(riding()), 700, 760)
    whole, grouped = taken(rows, []), taken(rows, sorted(cuts))
    for ours, theirs in zip(grouped, whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(np.sort(np.concatenate([whole[0][:, 0], whole[1]])), rows[:, 0])
    assert len(whole[1]) == END - FIRST - 1 + 59


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03, 1.0, 10.0])
def test_measurements_pass_at_once(noise: float) -> None:
    rows = riding(noise)
    assert not interpolated_times(IMU, [rows]).size
    kept, _ = taken(rows, list(range(1, 1000)))
    np.testing.assert_array_equal(kept, rows)


def test_rows_do_not_wait_where_nothing_is_in_line() -> None:
    detector = InterpolatedRows.of(IMU, is_canonical=True)
    for row in riding():
        assert len(detector.take(row[None])[0]) == 1
        assert np.isinf(detector.waiting_since_s)


def test_what_stays_where_it_was_is_not_interpolated() -> None:
    """A sensor whose steps are coarser than its noise at rest, and one that is stuck, are no holes."""
    rows = riding()
    rows[FIRST:, 1:] = rows[FIRST, 1:]
    assert not interpolated_times(IMU, [rows]).size


def test_a_slow_sensor_at_a_higher_rate_is_none_either() -> None:
    rows = riding()
    for first in range(1, 990, 10):
        rows = filled(rows, first, first + 9)
    assert not interpolated_times(IMU, [rows]).size


def test_a_short_hole_stays_filled() -> None:
    assert not interpolated_times(IMU, [filled(riding(), FIRST, FIRST + 2)]).size


def test_a_record_that_ends_in_a_hole_keeps_its_last_row() -> None:
    rows = filled(riding())[: FIRST + 100]
    kept, times = taken(rows, [FIRST + 3, FIRST + 50])
    np.testing.assert_array_equal(times, rows[FIRST + 1 : -1, 0])
    np.testing.assert_array_equal(kept[-1], rows[-1])


def test_rows_in_the_sensors_units_are_judged_alike() -> None:
    imu = IMU.model_copy(update={"gyro_unit": "deg/s", "accel_unit": "g"})
    rows = filled(riding())
    rows[:, 1:] *= np.repeat([180.0 / np.pi, 1.0 / 9.80665], 3)
    times = InterpolatedRows.of(imu, is_canonical=False).take(rows)[1]
    np.testing.assert_array_equal(times, rows[FIRST + 1 : END, 0])
