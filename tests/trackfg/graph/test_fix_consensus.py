"""Which fixes agree with each other and with the wheel."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.graph.fix_consensus import Passages, consensus, wrong_is_likelier
from trackfg.numerics.arrays import Array


def passages(place: Array, rolled: Array, sd: float = 0.3, unknown: Array | None = None) -> Passages:
    zeros = np.zeros(len(place))
    return Passages(
        place, np.full(len(place), sd), rolled, 1e-6 * rolled, rolled, zeros if unknown is None else unknown
    )


@pytest.mark.parametrize("seed", range(40))
def test_the_right_fixes_are_found(seed: int) -> None:
    """Spacings of 50 m to 3 km, sigmas of 5 cm to 3 m that may be 5 times too small, a wheel that is 2 % off, creeps
    and slips once; up to one fix in five is wrong: the chainage of another one, or by 100 m to 1 km.
    """
    rng = np.random.default_rng(seed)
    n, spacing, sd = int(rng.integers(5, 60)), 10.0 ** rng.uniform(1.7, 3.5), 10.0 ** rng.uniform(-1.3, 0.5)
    level = rng.choice([1.0, 5.0])
    way = np.cumsum(spacing * rng.uniform(0.3, 1.7, n))
    rolled = np.cumsum(np.diff(way, prepend=0.0) * (1.0 + 0.002 * rng.standard_normal(n))) * rng.uniform(0.98, 1.02)
    rolled[rng.integers(n) :] += rng.uniform(0.0, 0.03) * spacing
    place = 3000.0 + way + sd * level * rng.standard_normal(n)
    wrong = rng.choice(n, int(rng.integers(0, n // 5 + 1)), replace=False)
    moved = rng.choice([-1.0, 1.0], len(wrong)) * rng.uniform(100.0, 1000.0, len(wrong))
    another = place[(wrong + rng.integers(1, n, len(wrong))) % n]
    place[wrong] = np.where(rng.random(len(wrong)) < 0.5, another, place[wrong] + moved)
    found = consensus(passages(place, rolled, sd), scale_sd=0.01)
    error = np.abs(place - 3000.0 - way)
    assert not found.right[error > max(0.15 * spacing, 5.0 * sd * level)].any()
    assert np.count_nonzero(~np.delete(found.right, wrong)) <= 1
    assert not found.is_undecided


def test_the_first_fix_may_be_wrong() -> None:
    rolled = np.array([0.0, 1000.0, 2000.0, 3000.0, 4000.0])
    place = 500.0 + rolled
    place[0] += 800.0
    assert consensus(passages(place, rolled), 0.01).right.tolist() == [False, True, True, True, True]


def test_after_a_slip_fixes_go_on() -> None:
    """The wheel slipped by 300 m in a kilometre of which it is said that it slips: no fix is wrong."""
    rolled = np.array([0.0, 1000.0, 2300.0, 3300.0, 4300.0])
    place = np.array([0.0, 1000.0, 2000.0, 3000.0, 4000.0])
    unknown = np.array([0.0, 0.0, 500.0, 500.0, 500.0])
    assert consensus(passages(place, rolled, unknown=unknown), 0.01).right.all()


def test_two_against_two_are_undecided() -> None:
    rolled = np.array([0.0, 1000.0, 2000.0, 3000.0])
    place = rolled + np.array([0.0, 700.0, 0.0, 700.0])
    found = consensus(passages(place, rolled), 0.01)
    assert found.votes == (2, 2)
    assert found.is_undecided


def test_one_place_read_again_and_again_has_one_vote() -> None:
    """A vehicle stands on a balise that is wrong, and reads it four times."""
    rolled = np.array([0.0, 1000.0, 1000.0, 1000.1, 1000.2, 2000.0, 3000.0])
    place = np.array([0.0, 1700.0, 1700.0, 1700.0, 1700.1, 2000.0, 3000.0])
    found = consensus(passages(place, rolled), 0.01)
    assert found.right.tolist() == [True, False, False, False, False, True, True]
    assert found.votes == (3, 1)


def test_a_fix_that_is_off_by_metres_is_likelier_right_than_one_that_is_off_by_a_kilometre() -> None:
    """All else errs by 50 m, in one interval of twenty; a wrong fix is anywhere on 8 km, one in ten is."""
    error = np.array([0.0, 7.0, -60.0, 180.0, 1000.0])
    assert wrong_is_likelier(error, np.full(5, 50.0**2), 8000.0).tolist() == [False, False, False, True, True]
