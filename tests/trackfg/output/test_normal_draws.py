from __future__ import annotations

import numpy as np

from trackfg.output.normal_draws import NormalDraws


def test_numbers_are_those_of_the_generator_in_any_portions() -> None:
    sizes = [(3, 4), (), (700, 500), (300, 2, 200), (0, 5), (1000, 7)]
    draws, rng = NormalDraws(), np.random.default_rng(0)
    for size in sizes:
        np.testing.assert_array_equal(draws.standard_normal(size), rng.standard_normal(size))


def test_numbers_may_be_written_over() -> None:
    draws = NormalDraws()
    first = draws.standard_normal((2, 600_000))
    again = first.copy()
    first *= 0.0
    np.testing.assert_array_equal(NormalDraws().standard_normal((2, 600_000)), again)
