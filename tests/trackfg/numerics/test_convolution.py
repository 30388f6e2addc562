"""Convolution by FFT, and the lengths at which it is fast."""

import numpy as np
import pytest
from scipy.fft import next_fast_len

from trackfg.numerics.convolution import convolve_inside, fast_length


@pytest.mark.parametrize("least", [1, 2, 7, 11, 97, 360, 719_999, 720_001, 17_280_037])
def test_a_fast_length_is_the_one_that_scipy_takes(least: int) -> None:
    assert fast_length(least) == next_fast_len(least, real=True)


def test_a_long_kernel_is_applied_where_it_fits() -> None:
    rng = np.random.default_rng(0)
    y, kernel = rng.standard_normal((3, 500)), rng.standard_normal(41)
    expected = [np.convolve(row, kernel, mode="valid") for row in y]
    np.testing.assert_allclose(convolve_inside(y, kernel), expected, atol=1e-12)
