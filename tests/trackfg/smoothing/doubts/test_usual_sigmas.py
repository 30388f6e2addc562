"""The usual sigma of a column, which holes hardly change, and what it makes of an error."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.smoothing.doubts.usual_sigmas import WaveSums, inverse_squares, usual_sigma


def test_holes_hardly_change_the_usual_sigma() -> None:
    sd = np.full(100, 0.2)
    sd[:10] = 50.0
    assert usual_sigma(*inverse_squares(sd)) == pytest.approx(0.2, rel=0.06)


def test_rows_without_a_sigma_do_not_count() -> None:
    assert inverse_squares(np.array([0.5, np.nan, np.inf, 0.5])) == (2.0, 8.0)


def test_an_error_as_large_as_the_usual_sigma_widens_by_the_root_of_two() -> None:
    sums = WaveSums.of(np.array([3.0, -3.0, np.nan]), np.full(5, 0.2))
    assert sums.rms == 3.0
    assert sums.widening(0.2) == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize(("bends", "sd"), [([], [0.2]), ([1.0], []), ([np.nan], [0.2]), ([1.0], [np.nan])])
def test_sums_without_bends_or_sigmas_are_empty(bends: list[float], sd: list[float]) -> None:
    assert WaveSums.of(np.array(bends), np.array(sd)).is_empty
