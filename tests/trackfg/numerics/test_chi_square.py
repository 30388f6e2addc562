"""Chi-square tests: quantiles as printed in tables, and the number of independent values."""

import numpy as np
import pytest

from trackfg.numerics.chi_square import exceeds_chance, independent_number


def test_the_limit_is_the_quantile_over_the_degrees_of_freedom() -> None:
    limits = np.array([29.588, 18.307]) / 10.0  # of 10 degrees, at 0.001 and at 0.05
    for limit, probability in zip(limits, (0.001, 0.05), strict=True):
        assert exceeds_chance(np.array([limit - 1e-4, limit + 1e-4]), 10.0, probability).tolist() == [False, True]


def test_correlated_values_count_as_fewer() -> None:
    assert independent_number(300.0, 0.0) == 300.0
    assert independent_number(300.0, 0.5) == pytest.approx(100.0)
    assert independent_number(3.0, 0.999) == 1.0
