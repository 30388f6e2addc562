"""The level of leave-one-out errors: gross ones apart, lasting ones counted as fewer."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.solver.prediction_level import level


def test_errors_within_their_sigmas_are_no_doubt() -> None:
    seen = level(np.random.default_rng(0).standard_normal((200, 1)))
    assert seen.ratio == pytest.approx(1.0, abs=0.15)
    assert (seen.number, seen.far) == (200, False)


def test_one_gross_error_does_not_count() -> None:
    sigmas = np.array([[1.0], [-1.0], [0.5], [50.0], [-0.5], [1.0]])
    seen = level(sigmas)
    assert seen.number == 5
    assert seen.ratio == pytest.approx(np.sqrt(3.5 / 5.0))


def test_where_most_are_large_none_is_gross() -> None:
    sigmas = np.array([[20.0], [-18.0], [-25.0], [15.0], [22.0], [-30.0]])
    seen = level(sigmas)
    assert (seen.number, seen.far) == (6, True)
    assert seen.ratio == pytest.approx(np.sqrt(np.mean(sigmas**2)))


def test_errors_that_last_are_as_good_as_fewer() -> None:
    """Five blocks of one value each: 1.7 sigmas of 100 independent errors are far off, of five they are not."""
    signs = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    lasting = 1.7 * np.repeat(signs, 20)[:, None]
    assert not level(lasting).far
    assert level(1.7 * np.tile([1.0, -1.0], 50)[:, None]).far


def test_too_few_say_nothing() -> None:
    assert level(np.zeros((0, 1))) == (1.0, 0, False)
    assert level(np.array([[100.0]])).far is False
