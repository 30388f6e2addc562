"""Sums of rows are those of a dense product and of numpy's running sum, compiled or not."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.sums_of_rows import add_up_rows, add_weighted_rows


@pytest.mark.usefixtures("kernels")
def test_weighted_sums_are_the_product_with_a_matrix() -> None:
    rng = np.random.default_rng(0)
    rows, before = rng.standard_normal((7, 5)), rng.standard_normal((20, 5))
    index, weights = rng.integers(0, 7, (20, 3)), rng.standard_normal((20, 3))
    dense = np.zeros((20, 7))
    np.add.at(dense, (np.arange(20)[:, None], index), weights)
    out = before.copy()
    add_weighted_rows(rows, index, weights, out)
    np.testing.assert_allclose(out, before + dense @ rows, atol=1e-14)


@pytest.mark.usefixtures("kernels")
def test_a_row_without_weight_is_not_read() -> None:
    """What is not known there does not spoil the sum."""
    rows, out = np.array([[1.0], [np.nan]]), np.zeros((1, 1))
    add_weighted_rows(rows, np.array([[0, 1]]), np.array([[2.0, 0.0]]), out)
    assert out == 2.0


@pytest.mark.usefixtures("kernels")
def test_running_sums_take_the_place_of_the_rows() -> None:
    rows = np.random.default_rng(1).standard_normal((30, 4))
    expected = np.cumsum(rows, axis=0)
    assert add_up_rows(rows) is rows
    np.testing.assert_allclose(rows, expected, atol=1e-14)
