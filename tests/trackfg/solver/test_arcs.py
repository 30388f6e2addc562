"""A step along arcs keeps lengths where the straight one stretches them, and agrees with it where both are short."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Nav, Odo, States, Step
from trackfg.graph.build import build_problem
from trackfg.numerics.rotations import so3_exp
from trackfg.solver.arcs import along_arcs


@pytest.fixture(scope="module")
def states() -> States:
    """States of a run that begins at rest."""
    return build_problem(simulate("no-stop", seed=1, duration_s=60.0).recording, SmoothConfig()).initial


def lengths(states: States) -> tuple[np.ndarray, np.ndarray]:
    return np.linalg.norm(np.diff(states.nav.p, axis=0), axis=1), np.linalg.norm(states.nav.v, axis=1)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.5), (0.1, -0.3, 0.2)])
def test_a_step_that_turns_the_run_turns_it(states: States, turn: tuple[float, float, float]) -> None:
    rate, nav = np.array(turn), states.nav
    across = [x - np.outer(x @ rate, rate) / (rate @ rate) for x in (nav.p - nav.p[0], nav.v)]
    flat = replace(states, nav=Nav(nav.R, *across))  # at right angles to the axis all chords turn by the same angle
    straight = Nav(nav.R, *(x + np.cross(rate, x) for x in across))
    moved = along_arcs(flat, replace(flat, nav=straight)).nav
    R = so3_exp(rate[None])[0]
    for turned, before in zip((moved.p, moved.v), across, strict=True):
        np.testing.assert_allclose(turned, before @ R.T, atol=1e-9 * np.abs(before).max())
    longer = lengths(replace(flat, nav=straight))[0] / np.maximum(lengths(flat)[0], 1e-9)
    assert np.median(longer) == pytest.approx(np.sqrt(1.0 + rate @ rate), rel=1e-6)


def test_short_steps_agree_to_first_order(states: States) -> None:
    rng = np.random.default_rng(3)
    step = Step(rng.normal(size=(len(states), KEYFRAME_DIM)), rng.normal(size=SHARED_DIM))
    away = []
    for scale in (1e-3, 1e-4):
        straight = states.moved(step.scaled(scale))
        arcs = along_arcs(states, straight)
        moving = lengths(states)[0] > 1.0
        differences = np.diff(arcs.nav.p - straight.nav.p, axis=0)[moving]
        away.append(float(np.abs(differences).max()))
        np.testing.assert_array_equal(arcs.nav.R, straight.nav.R)
        for kind in (Kind.ODO, Kind.MOUNT):
            assert arcs.of(kind) is straight.of(kind)
    assert away[1] == pytest.approx(1e-2 * away[0], rel=0.05)


def test_what_stands_still_moves_straight() -> None:
    still = Nav(np.repeat(np.eye(3)[None], 3, axis=0), np.zeros((3, 3)), np.zeros((3, 3)))
    mount, clock, imu = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    states = States(still, np.zeros((3, 6)), Odo(np.zeros((3, 4))), mount, clock, imu)
    moved = replace(states, nav=Nav(still.R, np.arange(9.0).reshape(3, 3), np.ones((3, 3))))
    np.testing.assert_array_equal(along_arcs(states, moved).nav.p, moved.nav.p)
    np.testing.assert_array_equal(along_arcs(states, moved).nav.v, moved.nav.v)
