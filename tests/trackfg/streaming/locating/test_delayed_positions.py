"""Places that are recognised after their keyframes have left the window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.factors.landmark import landmark
from trackfg.factors.loss import Cauchy, Loss
from trackfg.factors.states import Kind
from trackfg.graph.build import build_problem
from trackfg.graph.priors import with_free_start
from trackfg.solver.covariance import posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.streaming.locating.delayed_positions import PassedPlaces, delayed_position_factor
from trackfg.streaming.window.marginalised import MarginalisedHistory
from trackfg.streaming.window.window import Window, WindowStep

LEAVING = 12


@pytest.fixture(scope="module")
def step() -> WindowStep:
    """A window of half a minute under way, at its solution."""
    problem = build_problem(simulate("mainline", seed=1, duration_s=60.0).recording, SmoothConfig())
    states = solve(problem, SmoothConfig().solver).states
    families = with_free_start(problem.families)
    window = Window(problem.t, states, problem.measured, problem.response, families)
    return window.gauss_newton_step({LEAVING})


def places(step: WindowStep, away: list[float], sigma: float) -> PassedPlaces:
    t, D = step.window.t, step.window.states.odo.distance
    when = t[[2, 5, 6]] + 0.3
    return PassedPlaces(when, np.interp(when, t, D) + np.array(away), np.full(3, sigma), np.zeros(3))


def window_with(step: WindowStep, passed: PassedPlaces, loss: Loss | None = None) -> tuple[Window, np.ndarray]:
    """The window without the keyframes that left, but with what the places say; and their weights."""
    rest, gone = step.window_without_first(LEAVING), step.marginalised_first(LEAVING)
    marginal = posterior_covariance(step.root).marginal[LEAVING]
    late = delayed_position_factor(passed, MarginalisedHistory(), step.window, step.root, LEAVING, marginal, loss)
    assert late is not None
    assert gone.t[-1] < rest.t[0]
    return rest.with_families(late.family), late.weight


def test_it_is_what_the_whole_window_would_have_said(step: WindowStep) -> None:
    passed = places(step, [0.5, 0.4, -0.2], 0.1)
    t = step.window.t
    k = np.searchsorted(t, passed.t) - 1
    f = (passed.t - t[k]) / (t[k + 1] - t[k])
    seen = landmark(k, f, passed.distance, passed.sigma[:, None], None)
    at_origin = replace(step.window, states=step.linearisation_point)
    whole = at_origin.with_families(seen).gauss_newton_step()
    late = window_with(step, passed)[0].gauss_newton_step()
    np.testing.assert_allclose(
        late.window.states.odo.array[:, :2], whole.window.states.odo.array[LEAVING:, :2], rtol=0.0, atol=2e-3
    )
    ours, theirs = (posterior_covariance(one.root).of(Kind.ODO)[-5:, 0, 0] for one in (late, whole))
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    assert (ours < 1.0).all()  # without them nobody knows


def test_a_wrong_one_is_set_aside(step: WindowStep) -> None:
    _, weight = window_with(step, places(step, [0.0, 25.0, 0.0], 0.05), Cauchy(3.0))
    assert weight[1] < 1e-3
    assert weight[[0, 2]] == pytest.approx(1.0, abs=0.2)


def test_places_of_another_time_say_nothing(step: WindowStep) -> None:
    passed = places(step, [0.0, 0.0, 0.0], 0.1)
    later = replace(passed, t=passed.t + 1000.0)
    marginal = posterior_covariance(step.root).marginal[LEAVING]
    assert (
        delayed_position_factor(later, MarginalisedHistory(), step.window, step.root, LEAVING, marginal, None) is None
    )
