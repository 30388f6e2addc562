"""What takes over where undamped steps of a window do not settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SolverConfig
from trackfg.smoothing.smoother import SmoothedStates
from trackfg.solver.gauss_newton import solve
from trackfg.streaming.window.window import Window
from trackfg.streaming.window.window_solver import WindowSolver


@pytest.fixture
def solved(smoothed: Callable[..., SmoothedStates]) -> Window:
    """A window that is as long as its run, at its minimum."""
    run = smoothed("mainline-gnss", seed=0, duration_s=150.0)
    problem = run.problem
    return Window(problem.t, run.solution.states, tuple(problem.measured), problem.response, tuple(problem.families))


def test_a_window_that_was_solved_backwards_is_turned_round(solved: Window) -> None:
    """Positions and inertial sensor agree with a mounting half a turn off: the batch solver stays there."""
    turned = replace(solved, states=solved.states.turned_round())
    assert turned.states.is_mounted_backwards
    assert solve(turned, SolverConfig()).states.is_mounted_backwards
    step, event = WindowSolver().settle(turned, SolverConfig(), {len(solved) - 1}, failure="as asked")
    assert event is not None
    assert event.kind == "by-batch"
    assert not step.window.states.is_mounted_backwards
    np.testing.assert_allclose(step.window.states.odo.distance, solved.states.odo.distance, atol=0.1)


def test_turned_round_twice_is_as_it_was(solved: Window) -> None:
    states = solved.states
    assert not states.is_mounted_backwards
    again = states.turned_round().turned_round()
    np.testing.assert_allclose(again.odo.array, states.odo.array, atol=1e-9)
    np.testing.assert_allclose(again.mount, states.mount, atol=1e-12)
