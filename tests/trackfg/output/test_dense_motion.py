"""The motion between keyframes: through every state, and the truth in between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import GeometryConfig, SmoothConfig
from trackfg.datasets.faults import drop_imu
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.graph.inputs import World
from trackfg.graph.run_context import RunContext, geometry_conventions
from trackfg.numerics.rotations import so3_log
from trackfg.output.dense_motion import DenseMotion, dense_motion
from trackfg.recording.description import Track
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

STEP_S = 0.02


@pytest.fixture(scope="module")
def noisy(smoothed: Callable[..., SmoothedStates]) -> SmoothedStates:
    return smoothed("mainline", seed=1, duration_s=120.0)


@pytest.fixture(scope="module")
def noisy_motion(noisy: SmoothedStates) -> DenseMotion:
    return dense_motion(noisy.problem.run, noisy.solution.states, STEP_S)


def test_passes_through_every_keyframe(noisy: SmoothedStates, noisy_motion: DenseMotion) -> None:
    states, t = noisy.solution.states, noisy.problem.t
    rows = np.searchsorted(noisy_motion.t, t - 1e-9)
    np.testing.assert_allclose(noisy_motion.t[rows], t, atol=1e-12)
    np.testing.assert_allclose(noisy_motion.nav.p[rows], states.nav.p, atol=1e-9)
    np.testing.assert_allclose(noisy_motion.nav.v[rows], states.nav.v, atol=1e-9)
    np.testing.assert_allclose(noisy_motion.nav.R[rows], states.nav.R, atol=1e-12)
    np.testing.assert_allclose(noisy_motion.distance[rows], states.odo.distance, atol=1e-9)
    np.testing.assert_allclose(noisy_motion.fraction[rows[:-1]], 0.0, atol=1e-12)
    assert (noisy_motion.keyframe[rows[:-1]] == np.arange(len(t) - 1)).all()


def test_arrives_at_every_keyframe_without_a_jump(noisy: SmoothedStates, noisy_motion: DenseMotion) -> None:
    """Just before a keyframe the motion is where the keyframe is."""
    states, t = noisy.solution.states, noisy.problem.t
    before = noisy_motion.at(t[1:] - 1e-6)
    np.testing.assert_allclose(before.nav.p, states.nav.p[1:], atol=1e-4)
    np.testing.assert_allclose(before.nav.v, states.nav.v[1:], atol=1e-4)
    np.testing.assert_allclose(before.nav.R, states.nav.R[1:], atol=1e-6)
    np.testing.assert_allclose(before.distance, states.odo.distance[1:], atol=1e-4)


@pytest.mark.parametrize("step_s", [STEP_S, 0.001, 0.3])
def test_the_kernel_moves_as_numpy_does(
    noisy: SmoothedStates,
    step_s: float,
    with_both: Callable[[Callable[[], DenseMotion]], tuple[DenseMotion, DenseMotion]],
) -> None:
    """Where the Earth turns, and in rows of a sample, of a few and of many."""
    world = World(9.81, np.array([1e-5, 4e-5, 6e-5]), 0.0)
    run = replace(noisy.problem.run, world=world)
    ours, theirs = with_both(lambda: dense_motion(run, noisy.solution.states, step_s))
    for name in ("t", "distance", "gyro", "gyro_span", "keyframe", "fraction", "forward"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-12, atol=1e-9)
    for name in ("R", "p", "v"):
        np.testing.assert_allclose(getattr(ours.nav, name), getattr(theirs.nav, name), rtol=1e-12, atol=1e-9)


def test_the_kernel_refuses_rows_that_do_not_belong_to_intervals() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    keyframes = tuple(np.zeros((2, *shape)) for shape in ((), (3, 3), (3,), (3,), (), (6,)))
    rows = tuple(np.zeros((3, *shape)) for shape in ((), (3, 3), (3,), (3,), (), (3,), (), ()))
    samples = np.arange(5.0), np.zeros((4, 3)), np.zeros((4, 3))
    starts = np.array([0, 1, 2, 3])
    with pytest.raises(ValueError, match="do not belong together: intervals"):
        compiled.dense_motion(*samples, starts, np.array([0, 2]), np.zeros(11), keyframes, rows)
    with pytest.raises(ValueError, match="do not belong together: settings"):
        compiled.dense_motion(*samples, starts, np.array([0, 3]), np.zeros(10), keyframes, rows)


def test_body_rate_is_the_samples_less_the_bias(noisy: SmoothedStates) -> None:
    """With a row for each sample: the gyro's reading less the bias of the interval that the row is in."""
    samples, states = noisy.problem.run.inertial, noisy.solution.states
    motion = dense_motion(noisy.problem.run, states, 1e-4)
    row = np.searchsorted(samples.edges, motion.t[:-1] - 1e-9)
    expected = samples.gyro[row] - states.bias[motion.keyframe[:-1], 3:]
    np.testing.assert_allclose(motion.gyro[:-1], expected, atol=1e-9)
    assert np.abs(states.bias[:, 3:]).max() > 1e-5


def test_what_is_left_of_place_and_speed_is_closed_by_the_cubic() -> None:
    """By its sensor a body rests; the keyframes have it 0.2 m further on and at 1 m/s one second later. Hermite's cubic
    from (0, 0) to (0.2, 1) is ``0.2 (3 f^2 - 2 f^3) + f^3 - f^2``: at f = 1/2 it is at 0.1 - 0.125 = -0.025 m, and its
    slope is 0.3 - 0.25 = 0.05 m/s.
    """
    n, gravity = 100, 9.8
    force = np.tile([0.0, 0.0, gravity], (n, 1))
    samples = Intervals(np.arange(n + 1) / n, np.zeros((n, 3)), force, np.zeros(n, dtype=bool))
    meaning = geometry_conventions(GeometryConfig(), Track())
    world, noise = World(gravity, np.zeros(3), 0.0), WhiteNoise.alike(1e-5, 1e-3, 1)
    run = RunContext(np.array([0.0, 1.0]), np.array([0, n]), samples, world, np.zeros(3), noise, 0.0, 1, meaning)
    nav = Nav(np.tile(np.eye(3), (2, 1, 1)), *np.zeros((2, 2, 3)))
    nav.p[1, 0], nav.v[1, 0] = 0.2, 1.0
    odo = Odo.of(nav.p[:, 0], np.ones(2), nav.p[:, 0], np.array([0.0, 0.2]))
    shared = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    motion = dense_motion(run, States(nav, np.zeros((2, 6)), odo, *shared), 0.01)
    middle = np.searchsorted(motion.t, 0.5 - 1e-9)
    assert motion.nav.p[middle, 0] == pytest.approx(-0.025, abs=1e-9)
    assert motion.nav.v[middle, 0] == pytest.approx(0.05, abs=1e-9)
    assert motion.distance[middle] == pytest.approx(-0.025, abs=1e-9)


def test_rows_are_no_further_apart_than_asked(noisy: SmoothedStates, noisy_motion: DenseMotion) -> None:
    assert (np.diff(noisy_motion.t) > 0).all()
    assert np.diff(noisy_motion.t).max() < 1.01 * STEP_S
    assert noisy_motion.t[0] == noisy.problem.t[0]
    assert noisy_motion.t[-1] == noisy.problem.t[-1]


@pytest.mark.parametrize("name", ["mainline", "mainline-gnss", "shunting"])
def test_noise_free_run_is_the_truth_between_keyframes(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates], name: str
) -> None:
    """Relative to the keyframes on either side, whose own errors are the smoother's and not the interpolation's."""
    options = {"seed": 1, "duration_s": 120.0, "noise": False}
    run, result = simulated(name, **options), smoothed(name, **options)
    problem, states = result.problem, result.solution.states
    at = np.arange(0.05, 119.9, 0.0537)
    motion = dense_motion(problem.run, states, STEP_S, at).at(at)
    k, f = motion.keyframe, motion.fraction[:, None]

    def position_error(t: np.ndarray, p: np.ndarray) -> np.ndarray:
        return p - run.ride.position(t)

    own = position_error(problem.t, states.nav.p)
    between = position_error(at, motion.nav.p) - own[k] * (1 - f) - own[k + 1] * f
    assert np.abs(between).max() < 1e-3
    turn = so3_log(np.swapaxes(run.ride.rotation(at), 1, 2) @ motion.nav.R)
    assert np.abs(turn).max() < 1e-5
    forward = np.einsum("mi,mi->m", motion.nav.v, run.ride.rotation(at)[:, :, 0])
    np.testing.assert_allclose(forward, run.ride.motion.speed(at), atol=2e-3)
    true = run.ride.motion.distance(at)
    lag = states.odo.distance - run.ride.motion.distance(problem.t)
    assert np.abs(motion.distance - true - lag[k] * (1 - f[:, 0]) - lag[k + 1] * f[:, 0]).max() < 1e-3


def test_at_is_exact_on_rows_and_at_both_ends(noisy_motion: DenseMotion) -> None:
    rows = np.array([0, 1, 777, len(noisy_motion.t) - 2, len(noisy_motion.t) - 1])
    at = noisy_motion.at(noisy_motion.t[rows])
    np.testing.assert_array_equal(at.t, noisy_motion.t[rows])
    np.testing.assert_allclose(at.nav.p, noisy_motion.nav.p[rows], atol=1e-9)
    np.testing.assert_allclose(at.nav.v, noisy_motion.nav.v[rows], atol=1e-12)
    np.testing.assert_allclose(at.nav.R, noisy_motion.nav.R[rows], atol=1e-12)
    np.testing.assert_allclose(at.distance, noisy_motion.distance[rows], atol=1e-9)
    np.testing.assert_allclose(
        at.keyframe + at.fraction, noisy_motion.keyframe[rows] + noisy_motion.fraction[rows], atol=1e-9
    )


def test_fraction_and_keyframe_say_where_a_time_lies(noisy: SmoothedStates, noisy_motion: DenseMotion) -> None:
    t = noisy.problem.t
    at = np.linspace(t[0], t[-1], 2345)
    motion = noisy_motion.at(at)
    where = t[motion.keyframe] + motion.fraction * np.diff(t)[motion.keyframe]
    np.testing.assert_allclose(where, at, atol=1e-9)
    assert motion.fraction.min() >= 0.0
    assert motion.fraction.max() <= 1.0


def test_asked_times_make_the_motion_there_exact(noisy: SmoothedStates, noisy_motion: DenseMotion) -> None:
    """Steps as the smoother takes them, with rows around the times asked for, say the same as fine ones."""
    at = np.arange(1.0, 119.0, 0.73)
    coarse = dense_motion(noisy.problem.run, noisy.solution.states, STEP_S, at).at(at)
    fine = dense_motion(noisy.problem.run, noisy.solution.states, 0.005).at(at)
    np.testing.assert_allclose(coarse.nav.p, fine.nav.p, atol=2e-4)
    np.testing.assert_allclose(coarse.nav.R, fine.nav.R, atol=2e-6)
    np.testing.assert_allclose(coarse.distance, fine.distance, atol=5e-4)


def test_hole_in_the_record_is_crossed_smoothly(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=1, duration_s=120.0)
    result = smooth_states(drop_imu(run.recording, 80.0, 85.0), SmoothConfig())
    motion = dense_motion(result.problem.run, result.solution.states, STEP_S)
    inside = (motion.t > 79.5) & (motion.t < 85.5)
    error = np.diff((motion.nav.p - run.ride.position(motion.t))[inside], axis=0)
    assert np.linalg.norm(error, axis=1).max() < 0.02
