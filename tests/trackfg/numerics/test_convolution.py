"""Convolution by FFT, and the lengths at which it is fast."""

import numpy as np
import pytest
from scipy.fft import next_fast_len

from trackfg.numerics.convolution import convolve_inside, fast_length


@pytest.mark.parametrize("least", [1, 2, 7, 11, 97, 360, 719_999, 720_001, 17_280_037])
def test_a_fast_length_is_the_one_that_scipy_takes(least: int) -> None:
    assert fast_length(least) == next_fast_len(least, real=True)


@pytest.mark.parametrize(("size", "taps"), [(500, 41), (41, 41), (500, 1), (50_001, 41), (50_001, 4_000)])
def test_a_kernel_is_applied_where_it_fits(size: int, taps: int) -> None:
    rng = np.random.default_rng(0)
    y, kernel = rng.standard_normal((3, size)), rng.standard_normal(taps)
    expected = [np.convolve(row, kernel, mode="valid") for row in y]
    np.testing.assert_allclose(convolve_inside(y, kernel), expected, atol=1e-11)
