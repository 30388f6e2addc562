"""The wheel that creeps further, by the sign of the force, counts less; a lone one, or one in the noise, does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.vehicle.vehicle import Rigid
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.odometry import force_on_distances
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.graph.creeping_wheel import with_creeping_wheels
from trackfg.smoothing.smoother import smooth_states

FIRST, SECOND = FactorType.TACH_DISTANCE, FactorType.TACH_INCREMENT
CONFIG = SmoothConfig()


@pytest.fixture(scope="module")
def rolling() -> tuple[Problem, States]:
    """Two wheels that roll alike, and the solution."""
    plan = replace(scenario("slippery-line-two-axles"), adhesion=None, irregularities=None, vehicle=Rigid())
    smoothed = smooth_states(simulate(plan, seed=1, duration_s=200.0, noise=False).recording, CONFIG)
    return smoothed.problem, smoothed.solution.states


def family(problem: Problem, kind: FactorType) -> Family:
    found = problem.family(kind)
    assert found is not None
    return found


def creeping(problem: Problem, states: States, share: float, *, traction: bool) -> tuple[Problem, np.ndarray]:
    """Have the second wheel turn more, by a share of the distance, while a force acts; where that lasts for 5 s."""
    second, t = family(problem, SECOND), problem.t
    step = np.abs(states.odo.step[1:])
    force = np.zeros_like(step)
    force[second.first_keyframe] = force_on_distances(second.data["response"])
    forced = (force if traction else -force) > 0.05 * step + 1e-3
    more = (share * forced * step)[second.first_keyframe]
    rolled = second.with_data(counted=second.data["counted"] + more)
    lasting = [forced[(t[1:] > at - 2.5) & (t[:-1] < at + 2.5)].all() for at in 0.5 * (t[1:] + t[:-1])]
    return replace(problem, families=changed(problem.families, SECOND, lambda _: rolled)), np.array(lasting)


def added(problem: Problem, states: States, kind: FactorType) -> np.ndarray:
    """Return the sigma that comes to that of each interval, m, (n - 1,)."""
    before, after = (family(one, kind) for one in (problem, with_creeping_wheels(problem, states, CONFIG)))
    more = np.zeros(len(problem.t) - 1)
    more[before.first_keyframe] = np.sqrt(after.sigma[:, 0] ** 2 - before.sigma[:, 0] ** 2)
    return more


@pytest.mark.parametrize("traction", [True, False])
def test_a_wheel_ahead_creeps_in_traction_and_under_the_brake_the_other_does(
    rolling: tuple[Problem, States], *, traction: bool
) -> None:
    """By hand: 0.5 % of the speed v, for T = 5 s, is an error of 0.005 v sqrt(T dt) in each interval of dt."""
    problem, states = rolling
    apart, lasting = creeping(problem, states, 0.005, traction=traction)
    assert lasting.sum() > 20
    wrong, right = (SECOND, FIRST) if traction else (FIRST, SECOND)
    step, duration = np.abs(states.odo.step[1:]), np.diff(problem.t)
    expected = 0.005 * step * np.sqrt(5.0 / duration)
    fast = lasting & (step > 5.0 * duration)
    np.testing.assert_allclose(added(apart, states, wrong)[fast], expected[fast], rtol=0.05)
    assert not added(apart, states, right)[lasting].any()


def test_what_noise_would_part_them_by_adds_nothing(rolling: tuple[Problem, States]) -> None:
    problem, states = rolling
    apart, _ = creeping(problem, states, 1e-4, traction=True)
    assert not added(apart, states, FIRST).any()
    assert not added(apart, states, SECOND).any()


def test_no_wheel_creeps_by_more_than_the_top_of_its_curve(rolling: tuple[Problem, States]) -> None:
    problem, states = rolling
    apart, lasting = creeping(problem, states, 0.025, traction=True)
    step, duration = np.abs(states.odo.step[1:]), np.diff(problem.t)
    fast = lasting & (step > 5.0 * duration)
    np.testing.assert_allclose(
        added(apart, states, SECOND)[fast], (0.02 * step * np.sqrt(5.0 / duration))[fast], rtol=0.05
    )


def test_a_wheel_that_does_not_turn_is_no_measure_of_the_other(rolling: tuple[Problem, States]) -> None:
    """It would be the one that creeps least in traction; its loss has given it up."""
    problem, states = rolling
    apart, lasting = creeping(problem, states, -1.0, traction=True)
    assert lasting.any()
    assert not added(apart, states, FIRST)[lasting].any()


def test_one_wheel_stays_as_it_is(rolling: tuple[Problem, States]) -> None:
    problem, states = rolling
    alone = replace(problem, families=tuple(part for part in problem.families if part.type is not SECOND))
    assert with_creeping_wheels(alone, states, CONFIG) is alone
