from __future__ import annotations

import numpy as np

from trackfg.numerics.hermite import hermite_rates, hermite_weights

T = 1.7


def test_a_cubic_is_its_end_values_and_slopes() -> None:
    cubic = np.polynomial.Polynomial([2.0, -1.0, 0.7, 0.3])
    ends = np.array([cubic(0.0), cubic(T), cubic.deriv()(0.0), cubic.deriv()(T)])
    f = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(ends @ np.array(hermite_weights(f, np.full(11, T))), cubic(f * T), atol=1e-12)
    np.testing.assert_allclose(ends @ np.array(hermite_rates(f, np.full(11, T))), cubic.deriv()(f * T), atol=1e-12)
