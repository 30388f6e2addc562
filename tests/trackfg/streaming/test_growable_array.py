"""Arrays that grow at their ends."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from trackfg.sensors.imu_intervals import Intervals
from trackfg.streaming.growable_array import GrowableArray, GrowableIntervals


@given(st.lists(st.integers(0, 90), max_size=8))
def test_rows_come_one_after_the_other_and_what_was_there_stays(counts: list[int]) -> None:
    pieces = [np.random.default_rng(i).normal(size=(count, 3)) for i, count in enumerate(counts)]
    growing, seen = GrowableArray(np.ones((2, 3))), []
    given_first = growing.rows
    for i, piece in enumerate(pieces):
        growing.append(piece)
        seen.append((growing.rows, np.concatenate([np.ones((2, 3)), *pieces[: i + 1]])))
    for rows, expected in seen:
        np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(given_first, np.ones((2, 3)))


def test_two_that_begin_alike_grow_apart() -> None:
    rows = GrowableArray(np.arange(3.0))
    rows.append(np.arange(2.0))
    one, other = GrowableArray(rows.rows), GrowableArray(rows.rows)
    one.append(np.array([7.0]))
    other.append(np.array([8.0]))
    assert one.rows[-1] == 7.0
    assert other.rows[-1] == 8.0


def test_intervals_go_on_where_the_others_end() -> None:
    first = Intervals(np.array([0.0, 1.0, 2.0]), np.zeros((2, 3)), np.ones((2, 3)), np.zeros(2, dtype=bool))
    then = Intervals(np.array([2.0, 4.0]), np.full((1, 3), 5.0), np.full((1, 3), 6.0), np.ones(1, dtype=bool))
    growing = GrowableIntervals.of(first)
    growing.append(then)
    both = growing.intervals
    np.testing.assert_array_equal(both.edges, [0.0, 1.0, 2.0, 4.0])
    np.testing.assert_array_equal(both.gyro[:, 0], [0.0, 0.0, 5.0])
    np.testing.assert_array_equal(both.accel[:, 0], [1.0, 1.0, 6.0])
    assert both.bridged.tolist() == [False, False, True]
    assert len(first) == 2
