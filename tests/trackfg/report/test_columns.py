from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from trackfg.report.columns import Column, packed, packed_sigma, packed_value


def unpacked(column: Column) -> np.ndarray:
    """What columns.js does."""
    content = np.frombuffer(zlib.decompress(base64.b64decode(column.text)), dtype=np.uint8).reshape(
        -1, len(column.numbers)
    )
    folded = sum(content[p].astype(np.int64) << (8 * p) for p in range(column.planes))
    whole = (folded >> 1) ^ -(folded & 1)
    for _ in range(column.order):
        whole = np.cumsum(whole)
    return np.where(content[-1] == 1, np.nan, whole * column.step) if column.gaps else whole * column.step


VALUES = arrays.arrays(
    np.float64,
    st.integers(1, 60),
    elements=st.one_of(st.floats(-1e6, 1e6), st.just(np.nan), st.just(np.inf)),
)


@given(VALUES, st.sampled_from([0.0, 1e-9, 0.003, 1.0, 70.0]))
def test_values_come_back(values: np.ndarray, accuracy: float) -> None:
    column = packed(values, accuracy)
    again = unpacked(column)
    known = np.isfinite(values)
    np.testing.assert_array_equal(np.isfinite(again), known)
    np.testing.assert_allclose(again[known], values[known], rtol=0.0, atol=0.5001 * column.step)


@pytest.mark.parametrize(("accuracy", "step"), [(0.003, 0.001), (0.001, 0.001), (1.0, 1.0), (70.0, 10.0)])
def test_steps_are_decimal(accuracy: float, step: float) -> None:
    assert packed(np.array([1.5, 2.5]), accuracy).step == pytest.approx(step)


def test_large_numbers_take_a_coarser_step() -> None:
    column = packed(np.array([-1e12, 1e12]), 1e-3)
    np.testing.assert_allclose(unpacked(column), [-1e12, 1e12], rtol=1e-8)


def test_no_values() -> None:
    assert unpacked(packed(np.full(5, np.nan), 0.1)).tolist() == pytest.approx([np.nan] * 5, nan_ok=True)
    assert len(packed(np.empty(0), 0.1).numbers) == 0
    assert packed_value(np.full(3, np.nan)).gaps


def test_accuracy_follows_the_sigmas() -> None:
    values = np.array([0.0, 10.0, 5.0])
    assert packed_value(values, np.array([0.1, 0.2, np.nan])).step <= 0.15 / 20.0
    assert packed_value(values, np.zeros(3)).step <= 1e-4
    sigmas = np.array([0.1, 0.2, 50.0])
    np.testing.assert_allclose(unpacked(packed_sigma(sigmas)), sigmas, rtol=0.01)


@pytest.mark.parametrize("sigma", [20.0, 1000.0])
def test_a_curve_is_drawn_however_wide_its_sigma(sigma: float) -> None:
    waves = 3.0 * np.sin(np.arange(500) / 7.0)
    np.testing.assert_allclose(unpacked(packed_value(waves, np.full(500, sigma))), waves, atol=0.006)
    assert unpacked(packed_value(np.full(3, 2.0), np.full(3, 0.1))).tolist() == pytest.approx([2.0] * 3, abs=0.005)


def test_a_uniform_chainage_takes_no_room_and_a_smooth_curve_little() -> None:
    chainage = 0.25 * np.arange(100_000)
    assert len(packed(chainage, 1e-3).text) < 1000
    rng = np.random.default_rng(0)
    waves = 3.0 * np.sin(chainage / 3.0) + 0.05 * rng.normal(size=chainage.size)
    assert len(packed_value(waves, np.full(chainage.size, 0.05)).text) < 1.6 * chainage.size


@pytest.mark.parametrize("accuracy", [0.0, 5e-324, 1.0])
def test_the_least_numbers_there_are(accuracy: float) -> None:
    column = packed(np.array([0.0, 5e-324]), accuracy)
    assert column.step > 0.0
    np.testing.assert_allclose(column.numbers, 0.0, atol=1e-299)
