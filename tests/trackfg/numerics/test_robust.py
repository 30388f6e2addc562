from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.robust import median


@pytest.mark.parametrize("count", [1, 2, 3, 4, 17, 100])
def test_the_median_is_that_of_numpy_to_the_last_bit(count: int) -> None:
    x = np.random.default_rng(count).standard_cauchy(count)
    assert median(x) == np.median(x)
    assert median(np.arange(count)) == np.median(np.arange(count))
    x[count // 2] = np.nan
    assert np.isnan(median(x))
