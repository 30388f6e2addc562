"""Rows of a stream that repeat samples of a slow inertial sensor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.checks.inertial.repeated_rows import repeated_rows
from trackfg.numerics.arrays import Array
from trackfg.streaming.intake.repeated_rows import RepeatedRows

SAMPLES = np.random.default_rng(0).standard_normal((400, 6))


def rows_of(channels: Array) -> Array:
    return np.column_stack([0.005 * np.arange(len(channels)), channels])


def taken(rows: Array, sizes: list[int]) -> tuple[Array, Array]:
    """Put rows through in batches of some sizes, again and again."""
    stage, parts, first, number = RepeatedRows(), [], 0, 0
    while first < len(rows):
        size = sizes[number % len(sizes)]
        parts.append(stage.take(rows[first : first + size]))
        first, number = first + size, number + 1
    kept, left_out = zip(*parts, strict=True)
    return np.concatenate(kept), np.concatenate(left_out)


@pytest.mark.parametrize("count", [2, 5, 20])
def test_after_a_block_samples_that_stay_are_left_out(count: int) -> None:
    rows = rows_of(np.repeat(SAMPLES, count, axis=0))
    kept, left_out = taken(rows, [100])
    assert len(kept) + len(left_out) == len(rows)
    later = rows[33 * count, 0]
    np.testing.assert_array_equal(kept[kept[:, 0] >= later], rows[33 * count :: count])
    assert (left_out >= rows[32 * count, 0]).all()


def test_measurements_pass() -> None:
    rows = rows_of(SAMPLES)
    kept, left_out = taken(rows, [7, 50])
    np.testing.assert_array_equal(kept, rows)
    assert not len(left_out)
    assert not len(RepeatedRows().take(rows[:0])[0])


def test_a_value_that_stays_is_measured_again() -> None:
    """At rest, by a sensor of coarse steps: no hole is longer than two of its intervals."""
    channels = np.concatenate([SAMPLES, np.tile(SAMPLES[-1], (40, 1)), SAMPLES])
    kept, _ = taken(rows_of(np.repeat(channels, 5, axis=0)), [64])
    assert np.diff(kept[kept[:, 0] > 5.0, 0]).max() == pytest.approx(0.05)


def test_a_sensor_that_gets_faster_is_followed() -> None:
    rows = rows_of(np.concatenate([np.repeat(SAMPLES, 5, axis=0), SAMPLES]))
    kept, _ = taken(rows, [50])
    np.testing.assert_array_equal(kept[-300:], rows[-300:])


@given(
    st.lists(st.integers(1, 7), min_size=1, max_size=5),
    st.lists(st.integers(1, 90), min_size=1, max_size=6),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_how_rows_are_grouped_makes_no_difference(stays: list[int], sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    channels = np.repeat(SAMPLES, rng.choice(stays, len(SAMPLES)), axis=0)
    whole, pieces = taken(rows_of(channels), [len(channels)]), taken(rows_of(channels), sizes)
    np.testing.assert_array_equal(whole[0], pieces[0])
    np.testing.assert_array_equal(whole[1], pieces[1])


def test_stream_and_batch_agree_where_runs_are_equal() -> None:
    channels = np.repeat(SAMPLES, 4, axis=0)
    kept, _ = taken(rows_of(channels), [33])
    expected = rows_of(channels)[~repeated_rows(channels.T)]
    np.testing.assert_array_equal(kept[-300:], expected[-300:])
