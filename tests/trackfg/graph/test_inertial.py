"""The inertial factors' world: how the level frame turns, what weighs, how biases walk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.bias import OF_GYRO_RATE, response_terms
from trackfg.factors.states import Kind, Nav
from trackfg.graph.build import Problem, build_problem
from trackfg.graph.inertial import increment_s, response_of_motion
from trackfg.numerics.geodesy import EARTH_RADIUS
from trackfg.numerics.rotations import so3_exp
from trackfg.recording.model import IMU_COLUMNS, Recording


@pytest.fixture(scope="module")
def problem(simulated: Callable[..., Simulation]) -> Problem:
    return build_problem(simulated("mainline-gnss", seed=2, duration_s=60.0).recording, SmoothConfig())


def test_the_level_frame_turns_with_the_earth_and_over_it(problem: Problem) -> None:
    """Under a vehicle that goes east at v it turns by v / R about north, going north about west: beside the Earth's
    rotation, which is the same everywhere. At 14 m/s these are 2e-6 rad/s.
    """
    v = 0.5 * (problem.initial.nav.v[1:] + problem.initial.nav.v[:-1])
    assert np.linalg.norm(v, axis=1).max() > 5.0
    turning = np.array([one.frame_rate for one in problem.measured])
    own = turning - turning[np.argmin(np.linalg.norm(v, axis=1))]
    np.testing.assert_allclose(own[:, 0], -v[:, 1] / EARTH_RADIUS, atol=1e-12)
    np.testing.assert_allclose(own[:, 1], v[:, 0] / EARTH_RADIUS, atol=1e-12)
    np.testing.assert_allclose(own[:, 2], 0.0, atol=1e-12)


def test_biases_walk_by_the_root_of_time(simulated: Callable[..., Simulation], problem: Problem) -> None:
    """A density of N per root second: N sqrt(T) over an interval T, whether a second or a fifth of one."""
    noise = simulated("mainline-gnss", seed=2, duration_s=60.0).recording.description.imu.noise
    walk = next(family for family in problem.families if family.name == "bias walk")
    duration = np.diff(problem.t)
    assert duration.max() > 2.0 * duration.min()
    for axis in range(3):
        np.testing.assert_allclose(walk.sigma[:, axis], noise.accel_bias_walk * np.sqrt(duration))
        np.testing.assert_allclose(walk.sigma[:, 3 + axis], noise.gyro_bias_walk * np.sqrt(duration))


def test_the_motion_in_a_curve_has_a_force_to_the_inside_and_gravity() -> None:
    """At 20 m/s and 0.05 rad/s to the left it is 1 m/s^2 to the left, less 1 - sin(x)/x of it, x = 0.0125 per 0.5 s."""
    t, v, turning, g = np.arange(5) * 0.5, 20.0, 0.05, 9.81
    R = so3_exp(np.outer(turning * t, [0.0, 0.0, 1.0]))
    power = np.array([1.0, 2.0, 3.0])
    measured = np.zeros((5, 6, Kind.IMU.dim))
    sevens = np.full((4, 3), 7.0)
    measured[:-1] = response_terms(sevens, sevens, np.tile(power, (4, 1)), R[:-1], sevens)
    response = response_of_motion(Nav(R, np.zeros((5, 3)), v * R[:, :, 0]), t, g, measured, on_springs=False)
    middle = so3_exp(np.outer(turning * (t[:-1] + 0.25), [0.0, 0.0, 1.0]))
    motion = (np.array([0.0, v * turning, g]), np.array([0.0, 0.0, turning]), power)
    expected = response_terms(*(np.tile(mean, (4, 1)) for mean in motion), middle, v * middle[:, :, 0])
    np.testing.assert_allclose(response[:-1], expected, atol=1e-4, rtol=1e-4)
    np.testing.assert_array_equal(response[-1], 0.0)


def test_the_response_of_a_body_on_springs_is_to_what_lasts() -> None:
    """It goes straight on at 20 m/s, bounces by 0.1 m/s and pitches and rolls by 10 mrad at 1.3 Hz, and brakes for the
    second half of the time by 1 m/s^2. Braking shows at once; of the rest a mean over 10 s leaves little.
    """
    t, g = np.arange(80) * 0.55, 9.81
    swing = np.sin(2.0 * np.pi * 1.3 * t)
    R = so3_exp(0.01 * swing[:, None] * [1.0, 1.0, 0.0])
    speed = 20.0 - np.maximum(t - 21.0, 0.0)
    nav = Nav(R, np.zeros((80, 3)), np.stack([speed, np.zeros(80), 0.1 * swing], axis=1))
    measured = np.zeros((80, 6, Kind.IMU.dim))
    responses = [response_of_motion(nav, t, g, measured, on_springs=springs)[:-1] for springs in (False, True)]
    ahead, upward = (np.stack([response[:, 0, column] for response in responses]) for column in (0, 2))
    rolling = np.stack([response[:, 3, OF_GYRO_RATE.start] for response in responses])
    np.testing.assert_allclose(ahead[1], ahead[0])
    assert np.diff(ahead[1][[30, 50]]) == pytest.approx(-1.0, abs=0.2)
    for moved in (upward, rolling):
        assert np.std(moved[1, 10:-10]) < 0.1 * np.std(moved[0, 10:-10])


def test_increments_are_short_where_the_vehicle_is_fast() -> None:
    speeds = np.array([0.0, 10.0, 40.0, 80.0])
    np.testing.assert_allclose(increment_s(speeds[:, None] * [0.6, 0.8, 0.0]), [0.02, 0.02, 0.01, 0.005])


def test_the_way_over_short_waves_is_that_of_the_wave(simulated: Callable[..., Simulation]) -> None:
    """At 80 m/s a wave of 5 m is one of 16 Hz, of which an increment of 20 ms is a third."""
    template = simulated("mainline", seed=2, duration_s=40.0).recording
    amplitude, frequency, h, speed = 2e-3, 2.0 * np.pi * 16.0, 0.005, 80.0

    def driven(amplitude_m: float) -> Recording:
        """It goes straight on and up and down; a sample is the mean of the force over its interval."""
        t = np.arange(0.0, 20.0, h)
        force = amplitude_m * frequency * np.diff(np.cos(frequency * np.append(t, 20.0))) / h
        noise = 1e-3 * np.random.default_rng(1).standard_normal((len(t), len(IMU_COLUMNS)))
        imu = pd.DataFrame(noise, columns=list(IMU_COLUMNS)).assign(t_s=t + 0.5 * h)
        imu["fz_mps2"] += 9.81 + force
        return replace(template, imu=imu, tach=pd.DataFrame({"t_s": t, "distance_m": speed * t}), fixes=None)

    wavy, even = (build_problem(driven(a), SmoothConfig()) for a in (amplitude, 0.0))
    np.testing.assert_array_equal(wavy.t, even.t)
    rising = amplitude * frequency * np.cos(frequency * wavy.t)
    up = []
    for problem, climb in ((wavy, rising), (even, 0.0 * rising)):
        begins = [Nav(np.eye(3)[None], np.zeros((1, 3)), np.array([[speed, 0.0, w]])) for w in climb[:-1]]
        ends = [one.predicted(nav, np.zeros(6)) for one, nav in zip(problem.measured, begins, strict=True)]
        up.append(np.array([end.p[0, 2] for end in ends]))
    np.testing.assert_allclose(up[0] - up[1], np.diff(amplitude * np.sin(frequency * wavy.t)), atol=0.05 * amplitude)
