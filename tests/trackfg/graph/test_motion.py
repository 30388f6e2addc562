"""How far a path may leave the direction of travel, and what a clock's drift is counted from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import MotionConfig, SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import simulate
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.graph.build import Problem, build_problem

GYRO_WHITE = 1e-3
"""rad/s/sqrt(Hz), so much that the bridge is nearly all there is of the path factor's sigma."""


@pytest.fixture(scope="module")
def problem() -> Problem:
    """A run whose path factors have no sigma of their own to speak of."""
    plan = scenario("mainline")
    imu = replace(plan.imu, noise=plan.imu.noise.model_copy(update={"gyro_white": GYRO_WHITE}))
    recording = simulate(replace(plan, imu=imu), seed=2, duration_s=60.0).recording
    return build_problem(recording, SmoothConfig(motion=MotionConfig(path_sd_m=1e-9, path_sd_relative=1e-12)))


def family_of(problem: Problem, kind: FactorType) -> Family:
    return next(family for family in problem.families if family.type is kind)


def test_path_may_leave_the_direction_of_travel_by_the_gyros_bridge(problem: Problem) -> None:
    """White noise of density N leaves the heading within an interval T, held at both ends, the covariance
    N^2 s (T - t) / T of times s < t. Its integral over the way L, in proportion to time, has the variance
    (L / T)^2 N^2 T^3 / 12 = N^2 L^2 T / 12.
    """
    path = family_of(problem, FactorType.PATH)
    first = path.first_keyframe
    way, duration = np.diff(problem.initial.odo.distance)[first], np.diff(problem.t)[first]
    moving = way > 1.0
    assert np.count_nonzero(moving) > 10
    expected = GYRO_WHITE * way[moving] * np.sqrt(duration[moving] / 12.0)
    for row in range(2):
        np.testing.assert_allclose(path.sigma[moving, row], expected, rtol=0.01)


def test_a_clock_that_drifts_is_right_in_the_middle_of_the_run(problem: Problem) -> None:
    """There the offset is what CLOCK says: drift for a time t - t_middle does what an offset drift x (t - t_middle)
    does, so the first readings move one way and the last ones the other.
    """
    reading, states = family_of(problem, FactorType.TACH_READING), problem.initial
    zero, offset, drift = (
        reading.residual(replace(states, clock=np.array([clock])))[:, 0]
        for clock in ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    )
    since = problem.t[reading.first_keyframe] - 0.5 * (problem.t[0] + problem.t[-1])
    assert (offset - zero).max() > 5.0
    assert since.min() < 0.0 < since.max()
    np.testing.assert_allclose(drift - zero, (offset - zero) * since, atol=1e-9)
