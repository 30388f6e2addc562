"""Places where the scale changes, found among all: few, by how much, and how unsure."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.solver.scale_changes import WALKS, _effects, _with_walk, log_odds_of_change, variance_of_changes

SD = 1e-3


def odds_of(data: tuple[Array, Array]) -> float:
    """The log odds of a change."""
    return log_odds_of_change(*data)


def variance_of(data: tuple[Array, Array], way_m: float = 0.0) -> Array:
    """The variance of changes; without a way the scale does not walk beside them."""
    return variance_of_changes(*data, np.full(len(data[1]), way_m))


def measured(changes: Array, *, sd: float = SD, seed: int | None = 0) -> tuple[Array, Array]:
    """What distances over the cells between edges say of the changes at them: the sum of those before, with noise."""
    count = len(changes)
    design = np.tril(np.ones((count, count))) / sd
    noise = 0.0 if seed is None else np.random.default_rng(seed).standard_normal(count)
    return design.T @ design, design.T @ (design @ changes + noise)


def test_a_change_that_the_data_determine_is_where_it_was() -> None:
    changes = np.zeros(12)
    changes[5] = 0.01
    data = measured(changes)
    variance = variance_of(data)
    assert odds_of(data) > 10.0
    assert np.sqrt(variance[5]) == pytest.approx(0.01, rel=0.1)
    assert np.sqrt(np.delete(variance, 5)).max() < 1e-3


@pytest.mark.parametrize("seed", range(8))
def test_a_constant_scale_changes_nowhere(seed: int) -> None:
    data = measured(np.zeros(40), seed=seed)
    variance = variance_of(data)
    assert odds_of(data) < 3.0
    assert np.sqrt(variance.sum()) < 1e-3


def test_errors_that_are_larger_everywhere_are_noise() -> None:
    """Distances over cells err by 2.5 of their sigmas: odds of 20 are rare, and a large change is found."""
    design, changes, odds = np.tril(np.ones((50, 50))) / SD, np.zeros(50), np.empty(40)
    information, _ = measured(changes)
    changes[20] = 0.02
    for seed in range(len(odds)):
        linear = design.T @ (2.5 * np.random.default_rng(seed).standard_normal(50))
        odds[seed] = odds_of((information, linear))
        data = information, linear + information @ changes
        variance = variance_of(data)
        assert odds_of(data) > 10.0
        assert np.sqrt(variance[18:23].sum()) == pytest.approx(0.02, rel=0.25)
    assert np.mean(odds > 3.0) <= 0.05


def test_creep_has_its_begin_and_its_end() -> None:
    changes = np.zeros(40)
    changes[13], changes[27] = 0.01, -0.01
    variance = variance_of(measured(changes))
    np.testing.assert_allclose(np.sqrt(variance[[13, 27]]), 0.01, rtol=0.1)
    assert np.sqrt(np.delete(variance, [13, 27])).max() < 1e-3


def test_places_that_the_data_do_not_distinguish_share_the_change() -> None:
    """One distance after three edges: the change was at one of them, and may have been at each."""
    design = np.array([[0.0, 1.0, 1.0, 1.0, 0.0]]) / 1e-4
    information = design.T @ design
    variance = variance_of((information, information @ np.array([0.0, 0.01, 0.0, 0.0, 0.0])))
    np.testing.assert_allclose(variance[1:4], variance[2], rtol=1e-6)
    assert 0.01**2 < variance[1:4].sum() < 1.5 * 0.01**2  # creep that ceases is measured in part


def test_a_walk_is_integrated_out_as_the_noise_that_it_is() -> None:
    """The data leave N(estimate, I^-1); with a walk of variance D the effects are seen with I^-1 + D."""
    rng = np.random.default_rng(3)
    information, linear = measured(1e-3 * rng.standard_normal(6))
    sd = rng.uniform(1e-4, 1e-3, 6)
    gain, left, linear_left = _with_walk(information, linear, sd)
    covariance, estimate = np.linalg.inv(information), np.linalg.solve(information, linear)
    seen = covariance + np.diag(sd**2)
    np.testing.assert_allclose(left, np.linalg.inv(seen), rtol=1e-9)
    np.testing.assert_allclose(linear_left, np.linalg.solve(seen, estimate), rtol=1e-9)
    log_normal = [
        -0.5 * estimate @ np.linalg.solve(P, estimate) - 0.5 * np.linalg.slogdet(P)[1] for P in (seen, covariance)
    ]
    assert gain == pytest.approx(log_normal[0] - log_normal[1], rel=1e-9)


@pytest.mark.parametrize("walk", WALKS[1:])
@pytest.mark.parametrize("seed", range(4))
def test_a_scale_that_walks_everywhere_is_allowed_to(walk: float, seed: int) -> None:
    """A little at each of 50 edges, 200 m apart: no sum of a few changes explains it."""
    changes = walk * np.sqrt(200.0) * np.random.default_rng([seed, 7]).standard_normal(50)
    variance = variance_of(measured(changes, sd=1e-4, seed=seed), way_m=200.0)
    assert np.sqrt(variance.sum()) == pytest.approx(np.sqrt(np.sum(changes**2)), rel=0.5)
    assert np.mean(np.abs(changes) < 3.0 * np.sqrt(variance)) > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_a_change_at_one_place_is_not_taken_for_a_walk(seed: int) -> None:
    changes = np.zeros(50)
    changes[20] = 0.01
    variance = variance_of(measured(changes, sd=1e-4, seed=seed), way_m=200.0)
    assert np.sqrt(variance[20]) == pytest.approx(0.01, rel=0.1)
    assert np.sqrt(np.delete(variance, 20)).max() < 5e-4


def test_the_evidence_is_a_bound_of_that_of_all_sums_of_two_effects() -> None:
    information, linear = measured(np.array([0.0, 3e-3, 0.0, -3e-3]), sd=3e-3)
    units = list(np.eye(4))
    kinds = (units, [a - b for a, b in combinations(units, 2)])
    single = [
        (1.0 / (8.0 * len(kind)), np.sqrt(variance) * effect)
        for kind in kinds
        for effect in kind
        for variance in np.square([1e-3, 3e-3, 1e-2, 2e-2])
    ]

    def likelihood(*effects: Array) -> float:
        W = np.array(effects)
        precision = np.eye(len(W)) + W @ information @ W.T
        return float(
            np.exp(0.5 * (W @ linear) @ np.linalg.solve(precision, W @ linear)) / np.sqrt(np.linalg.det(precision))
        )

    # Each further effect has half the prior odds: those beyond the second add less than 0.3 in all.
    none, one = 1.0, sum(p * likelihood(w) for p, w in single)
    two = sum(p * q * likelihood(w, v) for p, w in single for q, v in single)
    exact = np.log(none + one + 0.5 * one + 0.5 * two)
    bound = _effects(information, linear).log_evidence
    assert bound < exact + 0.3
    assert bound == pytest.approx(exact, abs=0.5)


def test_no_edges_have_no_changes() -> None:
    data = np.zeros((0, 0)), np.zeros(0)
    assert odds_of(data) == -np.inf
    assert variance_of(data).shape == (0,)


def test_a_single_effect_has_its_exact_posterior() -> None:
    """With data so weak that a second effect has no weight, the odds are the sum over all places, kinds and sigmas."""
    information, linear = measured(np.array([0.0, 3e-3, 0.0, -3e-3]), sd=3e-3)
    effects = [np.eye(4)[i] for i in range(4)]
    pairs = [np.eye(4)[i] - np.eye(4)[j] for i, j in combinations(range(4), 2)]
    weight, second = 0.0, np.zeros(4)
    for kind in (effects, pairs):
        for effect in kind:
            own, left = effect @ information @ effect, effect @ linear
            for variance in np.square([1e-3, 3e-3, 1e-2, 2e-2]):
                shrunk = variance / (1.0 + variance * own)
                factor = np.exp(0.5 * left**2 * shrunk) / np.sqrt(1.0 + variance * own) / (8.0 * len(kind))
                weight += factor
                second += factor * effect**2 * (shrunk + (shrunk * left) ** 2)
    assert odds_of((information, linear)) == pytest.approx(np.log(weight), abs=0.5)
    assert (variance_of((information, linear)) > 0.5 * second / (1.0 + weight)).all()
