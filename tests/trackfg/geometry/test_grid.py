"""Lengths in steps, weighted neighbours and window sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.geometry.grid import steps, weighted_neighbours, window_sums


def test_a_length_is_a_whole_number_of_steps() -> None:
    assert steps(5.0, 0.25, "chord") == 20
    assert steps(0.3, 0.1, "chord") == 3


@pytest.mark.parametrize(
    ("length", "step"), [(4.7244, 0.25), (0.0, 0.25), (-5.0, 0.25), (np.nan, 0.25), (np.inf, 0.25)]
)
def test_other_lengths_are_refused_by_name(length: float, step: float) -> None:
    with pytest.raises(BadInputError, match=r"behind_m is .* expected a whole multiple of the step of 0.25 m"):
        steps(length, step, "behind_m")


@pytest.mark.parametrize("step", [0.0, -0.25, np.nan, np.inf])
def test_a_step_is_a_length(step: float) -> None:
    with pytest.raises(BadInputError, match="step_m"):
        steps(5.0, step, "behind_m")


def test_neighbours_beyond_the_ends_are_unknown() -> None:
    y = np.arange(6.0) ** 2
    out = weighted_neighbours(np.stack([y, -y]), {-2: 1.0, 0: 2.0, 1: -1.0})
    assert np.isnan(out[:, [0, 1, 5]]).all()
    np.testing.assert_array_equal(out[0, 2:5], y[:3] + 2.0 * y[2:5] - y[3:])
    np.testing.assert_array_equal(out[1], -out[0])
    assert np.isnan(weighted_neighbours(y, {-6: 1.0})).all()


@given(st.integers(1, 40), st.integers(1, 60))
def test_window_sums_add_every_window(count: int, n: int) -> None:
    y = np.random.default_rng(count).integers(-9, 9, n).astype(float)
    expected = [y[i : i + count].sum() for i in range(n - count + 1)]
    np.testing.assert_array_equal(window_sums(y, count), expected)


def test_a_hole_stays_in_its_windows() -> None:
    y = np.ones(50)
    y[20] = np.nan
    assert np.flatnonzero(np.isnan(window_sums(y, 7))).tolist() == list(range(14, 21))
