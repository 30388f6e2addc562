from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.numerics.robust import cauchy_fit, median


@pytest.mark.parametrize("count", [1, 2, 3, 4, 17, 100])
def test_the_median_is_that_of_numpy_to_the_last_bit(count: int) -> None:
    x = np.random.default_rng(count).standard_cauchy(count)
    assert median(x) == np.median(x)
    assert median(np.arange(count)) == np.median(np.arange(count))
    x[count // 2] = np.nan
    assert np.isnan(median(x))


@pytest.mark.parametrize("count", [3, 40, 1001])
@pytest.mark.parametrize("prior_sd", [np.inf, 0.3])
def test_the_kernel_fits_as_numpy_does(
    with_both: Callable[[Callable[[], Any]], tuple[Any, Any]], count: int, prior_sd: float
) -> None:
    rng = np.random.default_rng(count)
    t = np.linspace(0.0, 300.0, count)
    rows = np.stack([np.ones(count), t, np.sin(t)], axis=1)
    right = rows @ [0.1, 1e-3, 0.02] + 0.01 * rng.standard_cauchy(count)
    prior = np.array([np.inf, np.inf, prior_sd])
    ours, theirs = with_both(lambda: cauchy_fit(rows, right, prior, 1e-3, 2.0))
    for fitted, wanted in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(fitted, wanted, rtol=1e-9)


def test_the_kernel_leaves_what_has_no_solution_to_numpy(
    with_both: Callable[[Callable[[], Any]], tuple[Any, Any]],
) -> None:
    def fit() -> tuple[bool, bool]:
        coefficients, sd = cauchy_fit(np.ones((4, 1)), np.array([1.0, np.nan, 2.0, 3.0]), np.ones(1), 0.1)
        with pytest.raises(np.linalg.LinAlgError):
            cauchy_fit(np.zeros((4, 1)), np.arange(4.0), np.full(1, np.inf), 0.1)
        return bool(np.isnan(coefficients).all()), bool(np.isnan(sd).all())

    assert with_both(fit) == ((True, True), (True, True))
