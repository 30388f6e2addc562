"""Disturbances are found where they are, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.curves.increment_noise import IncrementNoise
from trackfg.curves.increments import CellIncrements, Observed

NOISE = IncrementNoise(level=1.0, walk=1e-4, cutoff=0.4, theta=0.1)
COUNT = 80
NOTHING = np.zeros((COUNT, 0))


def observed(added: np.ndarray, seed: int = 0) -> Observed:
    root = np.linalg.cholesky(NOISE.covariance(np.zeros(COUNT), np.zeros(COUNT + 1)))
    noise = root @ np.random.default_rng(seed).standard_normal(COUNT)
    return Observed(CellIncrements(noise + added, np.zeros(COUNT), np.zeros(COUNT + 1), least=1.0), NOISE)


def test_noise_alone_has_none() -> None:
    for seed in range(20):
        seen = observed(np.zeros(COUNT), seed)
        assert seen.undisturbed(seen.increments.measured, NOTHING) is seen


def test_a_step_and_a_disturbed_cell_are_distinguished() -> None:
    added = np.zeros(COUNT)
    added[20] = 6.0
    added[49:51] = [8.0, -8.0]
    seen = observed(added)
    increments = seen.undisturbed(seen.increments.measured, NOTHING).increments
    assert np.flatnonzero(np.isinf(increments.known)).tolist() == [20]
    assert np.flatnonzero(np.isinf(increments.between)).tolist() == [50]
    assert np.flatnonzero(~increments.telling).tolist() == [20, 49, 50]
    assert (increments.disturbances, increments.freedom) == (2, COUNT - 2)


def test_what_the_curves_explain_is_no_disturbance() -> None:
    added = 6.0 * np.eye(COUNT)[20]
    seen = observed(added)
    assert seen.undisturbed(seen.increments.measured, added[:, None]) is seen


def test_less_than_a_defect_is_none() -> None:
    quiet = IncrementNoise(level=1e-3, walk=1e-3, cutoff=0.4, theta=0.1)
    seen = Observed(CellIncrements(0.5 * np.eye(COUNT)[20], np.zeros(COUNT), np.zeros(COUNT + 1), least=1.0), quiet)
    assert seen.undisturbed(seen.increments.measured, NOTHING) is seen


def test_parts_go_back_where_they_came_from() -> None:
    seen = observed(8.0 * np.eye(COUNT)[20]).increments
    part = Observed(seen.part(slice(10, 40)), NOISE).undisturbed(seen.measured[10:40], np.zeros((30, 0))).increments
    assert np.flatnonzero(np.isinf(seen.with_part(slice(10, 40), part).known)).tolist() == [20]


@pytest.mark.parametrize("value", [1e-3, 1e9])
def test_what_says_nothing_may_be_anything(value: float) -> None:
    known = np.zeros(COUNT)
    known[20] = np.inf
    white = Observed(CellIncrements(np.zeros(COUNT), known, np.zeros(COUNT + 1), least=1.0), NOISE).white
    assert np.sum((white @ np.eye(COUNT)[20]) ** 2) * min(value, 1.0) ** 2 < 1e-5
