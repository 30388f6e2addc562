"""The kernel that linearises and stacks the factors of two keyframes, against one family after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.imu import InertialFactors
from trackfg.factors.loss import SwitchChain
from trackfg.factors.marginal_prior import marginal_prior
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, States, Step
from trackfg.graph.build import build_problem
from trackfg.solver.pair_rows import linearised_pair

WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]
SIZE = KEYFRAME_DIM + SHARED_DIM


@pytest.fixture(scope="module")
def pair(simulated: Callable[..., Simulation]) -> tuple[States, list[Family], InertialFactors]:
    """The first two keyframes of a run that moves, with a marginal prior, far enough off for all losses to act."""
    problem = build_problem(simulated("mainline-gnss", seed=2, duration_s=45.0).recording, SmoothConfig())
    rng = np.random.default_rng(0)
    first = len(problem.t) - 3
    origin = problem.initial.take(slice(first, first + 2))
    states = origin.moved(Step(1e-2 * rng.standard_normal((2, KEYFRAME_DIM)), 1e-3 * rng.standard_normal(SHARED_DIM)))
    families = [marginal_prior(rng.standard_normal((SIZE, SIZE + 1)), origin.take(slice(0, 1)))]
    for family in problem.families:
        among = (family.first_keyframe >= first) & (family.last_keyframe <= first + 1)
        families.append(family.take(among).shifted(-first))
    return states, families, InertialFactors(problem.measured[first : first + 1])


def information(states: States, families: list[Family], inertial: InertialFactors) -> np.ndarray:
    """What rows in any order say, each column in units of its root."""
    rows = linearised_pair(states, families, inertial)
    information = rows.T @ rows
    scale = np.sqrt(np.maximum(np.diagonal(information), 1.0))
    return np.asarray(information / (scale[:, None] * scale))


def test_the_kernel_says_of_two_keyframes_what_their_families_do(
    pair: tuple[States, list[Family], InertialFactors], with_both: WithBoth
) -> None:
    types = {family.type for family in pair[1] if len(family)}
    assert {FactorType.MARGINAL_PRIOR, FactorType.PATH, FactorType.TACH_DISTANCE, FactorType.GNSS_POSITION} <= types
    assert any(isinstance(family.loss, SwitchChain) for family in pair[1])
    ours, theirs = with_both(lambda: information(*pair))
    assert ours.shape == (2 * KEYFRAME_DIM + SHARED_DIM + 1,) * 2
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


@pytest.mark.usefixtures("kernels")
def test_what_is_not_finite_is_refused(pair: tuple[States, list[Family], InertialFactors]) -> None:
    states, families, inertial = pair
    nowhere = replace(states, odo=states.odo.moved_along(np.inf))
    with pytest.raises(ValueError, match="not finite"):
        linearised_pair(nowhere, families, inertial)


def test_the_kernel_refuses_factors_that_do_not_belong_together() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    with pytest.raises(TypeError, match="tuple of arrays"):
        compiled.pair_rows([], np.zeros((0, 1)), (), (), np.zeros((0, 1)))
