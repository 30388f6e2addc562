"""The window of a stream: what a keyframe carries along when it is predicted, updated, marginalised and merged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import UnsolvableError
from trackfg.factors.marginal_prior import marginal_prior, step_from
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Nav, Odo, States, Step, offset_in_keyframe
from trackfg.graph.inputs import World
from trackfg.numerics.rotations import so3_exp
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.tach import Wheel
from trackfg.solver.elimination import Conditionals
from trackfg.streaming.rows import NO_SAMPLES
from trackfg.streaming.window import window as window_module
from trackfg.streaming.window.filter_step import PredictedPair
from trackfg.streaming.window.marginalised import MarginalisedHistory
from trackfg.streaming.window.next_interval import Prediction, predict_interval, with_other_rows
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.window import Interval, MarginalisedKeyframes, Window

SIZE = KEYFRAME_DIM + SHARED_DIM
GRAVITY = 9.8
NOTHING = np.zeros((0, 2))


def keyframes(count: int, speed: float = 0.0) -> States:
    """On a straight level track, one second apart."""
    t = np.arange(float(count))
    along = np.stack([speed * t, 0.0 * t, 0.0 * t], axis=1)
    nav = Nav(np.tile(np.eye(3), (count, 1, 1)), along, np.tile([speed, 0.0, 0.0], (count, 1)))
    odo = Odo.of(along[:, 0], np.ones(count), along[:, 0], np.full(count, speed))
    shared = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    return States(nav, np.zeros((count, Kind.BIAS.dim)), odo, *shared)


def known(states: States) -> Window:
    """A window of one keyframe, known to 1e-3 in every variable; the forward speed to 0.05 m/s, the wheel's scale and
    the mounting to 1e-4.
    """
    sd = np.full(SIZE, 1e-3)
    sd[offset_in_keyframe(Kind.NAV) + 6] = 0.05
    sd[[offset_in_keyframe(Kind.ODO) + 1, KEYFRAME_DIM, KEYFRAME_DIM + 1]] = 1e-4
    rows = np.column_stack([np.diag(1.0 / sd), np.zeros(SIZE)])
    return Window(np.zeros(1), states, (), np.zeros((1, 6, Kind.IMU.dim)), (marginal_prior(rows, states),))


def test_the_newest_keyframes_prior_is_of_the_interval_once_one_begins_there() -> None:
    """The marginal prior is of the sensor's own bias; the window's state is that of the interval, own + response c."""
    rng = np.random.default_rng(0)
    newest = replace(keyframes(1), imu=rng.standard_normal((1, Kind.IMU.dim)))
    rows, response = rng.standard_normal((SIZE, SIZE + 1)), rng.standard_normal((6, Kind.IMU.dim))
    prior = marginal_prior(rows, newest)
    window = Window(np.zeros(1), newest, (), np.zeros((1, 6, Kind.IMU.dim)), (prior,))
    measured: Any = None
    interval = Interval(1.0, (newest.imu @ response.T)[0], keyframes(1), measured, response, ())
    pair = window.extended(interval)
    calibrated = replace(pair.states, imu=newest.imu)
    np.testing.assert_allclose(pair.families[0].residual(calibrated), prior.residual(newest), atol=1e-9)


def conditional(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of one keyframe on the next and the shared variables, with steps of about a hundredth."""
    R = np.triu(rng.standard_normal((KEYFRAME_DIM, KEYFRAME_DIM))) + 8.0 * np.eye(KEYFRAME_DIM)
    return R, rng.standard_normal((KEYFRAME_DIM, SIZE)), 0.1 * rng.standard_normal(KEYFRAME_DIM)


def test_keyframes_follow_the_next_one_through_their_conditionals() -> None:
    """``R_1 x_1 = d_1 - S_1 (x_2, s)``, then ``R_0 x_0 = d_0 - S_0 (x_1, s)``."""
    rng = np.random.default_rng(1)
    parts, point = [conditional(rng) for _ in range(2)], keyframes(3)
    gone = MarginalisedKeyframes(
        np.arange(2.0), Conditionals(*(np.array(part) for part in zip(*parts, strict=True))), point
    )
    next_one = replace(point.take(slice(2, 3)), bias=np.full((1, 6), 0.01), clock=np.full((1, 3), 0.02))
    ahead = step_from(point.take(slice(2, 3)), next_one)
    x, solutions = ahead.keyframes[0], []
    for R, S, d in reversed(parts):
        x = np.linalg.solve(R, d - S @ np.concatenate([x, ahead.shared]))
        solutions.insert(0, x)
    ours = step_from(point.take(slice(0, 2)), gone.back_substitute(next_one))
    np.testing.assert_allclose(ours.keyframes, solutions, atol=1e-9)


def test_the_kernel_follows_the_next_keyframe_as_arrays_do(with_both: Callable[..., tuple[Any, Any]]) -> None:
    """Of a run with one further sensor; turned, in motion, and away from the linearisation point."""
    rng = np.random.default_rng(3)
    parts = [conditional(rng) for _ in range(2)]
    R, S, d = (np.array(part) for part in zip(*parts, strict=True))
    S = np.concatenate([S, rng.standard_normal((2, KEYFRAME_DIM, Kind.SENSOR.dim))], axis=2)
    turned = Nav(so3_exp(rng.standard_normal((3, 3))), *rng.standard_normal((2, 3, 3)))
    point = replace(keyframes(3), nav=turned, sensor=np.array([[0.01, 0.02]]))
    gone = MarginalisedKeyframes(np.arange(2.0), Conditionals(R, S, d), point)
    dims = KEYFRAME_DIM, SHARED_DIM + Kind.SENSOR.dim
    ahead = Step(0.05 * rng.standard_normal((1, dims[0])), 0.05 * rng.standard_normal(dims[1]))
    next_one = point.take(slice(2, 3)).moved(ahead)
    ours, theirs = with_both(lambda: gone.back_substitute(next_one))
    for one, other in zip((*ours.arrays, ours.sensor), (*theirs.arrays, theirs.sensor), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kernels", [True, False])
def test_a_singular_conditional_is_an_error(*, kernels: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not kernels:
        monkeypatch.setattr(window_module, "compiled_kernels", lambda: False)
    R, S, d = conditional(np.random.default_rng(1))
    R[3, 3] = 0.0
    alone = MarginalisedKeyframes(np.array([7.0]), Conditionals(R[None], S[None], d[None]), keyframes(2))
    with pytest.raises(UnsolvableError, match=r"the keyframe at 7\.000 s is singular"):
        alone.back_substitute(keyframes(1))


def test_a_keyframe_merged_away_leaves_the_others_where_they_were() -> None:
    """Of a rest of three keyframes the first alone is kept. Each was marginalised at another linearisation point; from
    the keyframe after the rest the first one follows as it did through both others.
    """
    rng = np.random.default_rng(2)
    history = MarginalisedHistory()
    for k in range(4):
        own = replace(
            keyframes(2), bias=0.01 * rng.standard_normal((2, 6)), clock=0.01 * rng.standard_normal((1, Kind.CLOCK.dim))
        )
        own_rows = Conditionals(*(part[None] for part in conditional(rng)))
        history.parts.append(MarginalisedKeyframes(np.array([float(k)]), own_rows, own))
    each, after = list(history.parts), replace(keyframes(1), bias=np.full((1, 6), 0.03))
    expected = after
    for part in reversed(each[:3]):
        expected = part.back_substitute(expected)
    np.testing.assert_array_equal(history.collapse_rests(100.0), [[0.0, 3.0]])
    assert len(history.parts) == 2
    found = history.parts[0].back_substitute(after)
    assert np.abs(expected.bias).max() > 1e-3
    np.testing.assert_allclose(found.bias, expected.bias, atol=1e-9)
    np.testing.assert_allclose(found.odo.array, expected.odo.array, atol=1e-9)
    np.testing.assert_allclose(found.nav.p, expected.nav.p, atol=1e-6)


@pytest.fixture(scope="module")
def description(simulated: Callable[..., Simulation]) -> RecordingDescription:
    return simulated("mainline", seed=2, duration_s=60.0).recording.description


def predicted(description: RecordingDescription, speed: float) -> Prediction:
    """A second at constant speed from a keyframe that is known, by the inertial sensor alone."""
    n = 120
    force = np.tile([0.0, 0.0, GRAVITY], (n, 1))
    data = Intervals(np.arange(n + 1) / 100.0, np.zeros((n, 3)), force, np.zeros(n, dtype=bool))
    context = StreamContext(description, SmoothConfig(), World(GRAVITY, np.zeros(3), 0.0), 0.0)
    return predict_interval(context, known(keyframes(1, speed)), data, np.array([0, 100]), NoiseAtRest())


def rolled(speed: float) -> Wheel:
    t = np.arange(0.0, 1.31, 0.05) - 0.05
    return Wheel(t, speed * t, 1e-3, 0.0, False, NOTHING)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("speed", [10.0, -10.0], ids=["forwards", "backwards"])
def test_the_next_keyframe_is_where_the_speed_leads(description: RecordingDescription, speed: float) -> None:
    interval = predicted(description, speed).interval
    np.testing.assert_allclose(interval.predicted.nav.p, [[speed, 0.0, 0.0]], atol=1e-3)
    assert interval.predicted.odo.step.item() == pytest.approx(speed, abs=1e-3)
    assert interval.predicted.odo.distance.item() == pytest.approx(speed, abs=1e-3)


def test_a_wheel_that_agrees_says_where_the_next_keyframe_is(description: RecordingDescription) -> None:
    """Predicted 10 m, rolled 10.05 m, which a speed known to 0.05 m/s allows: 5 cm further, and 5 cm/s faster."""
    nothing = Recording(description, NO_SAMPLES)
    interval = with_other_rows(predicted(description, 10.0), nothing, rolled(10.05), 0.05)
    np.testing.assert_allclose(interval.predicted.nav.p, [[10.05, 0.0, 0.0]], atol=1e-3)
    np.testing.assert_allclose(interval.predicted.nav.v, [[10.05, 0.0, 0.0]], atol=1e-3)
    np.testing.assert_allclose(interval.predicted.odo.array, [[10.05, 1.0, 10.05, 10.05]], atol=1e-3)


def test_a_wheel_that_slips_does_not(description: RecordingDescription) -> None:
    """Rolled 11 m, which it does not allow: the vehicle is where it was predicted, and only the count goes on."""
    nothing = Recording(description, NO_SAMPLES)
    interval = with_other_rows(predicted(description, 10.0), nothing, rolled(11.0), 0.05)
    np.testing.assert_allclose(interval.predicted.nav.p, [[10.0, 0.0, 0.0]], atol=1e-3)
    np.testing.assert_allclose(interval.predicted.odo.array, [[10.0, 1.0, 11.0, 10.0]], atol=1e-3)


def test_the_filters_step_ends_where_its_new_prior_has_its_minimum(description: RecordingDescription) -> None:
    """The tach reads 10.05 m, its clock known to 1 ms and so to 1 cm, the speed to 5 cm/s: the count is what is read
    but for a 25th of the difference, and the cost of the newest keyframe's prior is least where the step has put it.
    """
    prediction = predicted(description, 10.0)
    interval = with_other_rows(prediction, Recording(description, NO_SAMPLES), rolled(10.05), 0.05)
    result = PredictedPair.of(known(keyframes(1, 10.0)), prediction, description.imu.noise).update(interval)
    assert result.pair.states.odo.count[1] == pytest.approx(10.05, abs=6e-3)
    prior = result.newest.families[0]
    assert np.linalg.norm(prior.residual(result.newest.states)) < 0.05


def test_an_unsigned_tach_counts_down_backwards() -> None:
    first = Wheel(np.array([-1.0, 0.0]), np.zeros(2), 1e-3, 0.0, False, NOTHING)
    buffer = TachBuffer(first, np.array([[0.0, 3.0]]), 40.0, signed=False, longest_silence_s=2.0)
    recorded = np.array([[0.5, 42.0], [1.0, 44.0]])
    wheel = buffer.wheel_until(1.0, recorded, 0.0, (-4.0, -4.0), NOTHING)
    np.testing.assert_allclose(wheel.at(np.array([0.0, 0.5, 1.0])), [3.0, 1.0, -1.0])


def at_rest(late_s: float = 0.0) -> TachBuffer:
    """An unsigned tach at rest at 0 s, which shows 3 m and has counted 40 m."""
    first = Wheel(np.array([-1.0, 0.0]), np.zeros(2), 1e-3, 0.0, False, NOTHING)
    return TachBuffer(first, np.array([[0.0, 3.0]]), 40.0, signed=False, longest_silence_s=2.0, late_s=late_s)


def test_an_unsigned_tach_that_departs_counts_as_the_vehicle_is_predicted_to_move() -> None:
    """At rest the speed is not known to be another than 0, and a sense once taken would last."""
    recorded, t = np.array([[0.5, 42.0], [1.0, 44.0]]), np.array([0.0, 0.5, 1.0])
    for predicted, shown in ((-2.0, [3.0, 1.0, -1.0]), (0.0, [3.0, 5.0, 7.0])):
        wheel = at_rest().wheel_until(1.0, recorded, 0.0, (0.0, predicted), NOTHING)
        np.testing.assert_allclose(wheel.at(t), shown)


def test_rows_of_a_slow_tach_are_waited_for_until_they_are_missing() -> None:
    buffer, rows = at_rest(late_s=1.5), np.array([[0.0, 40.0], [1.0, 42.0]])
    assert buffer.rows_end(0.9, rows, 1.2) == pytest.approx(1.2)  # as of any tach: 0.3 s more than the keyframe
    assert buffer.rows_end(0.5, rows, 1.0) == 1.0
    assert buffer.rows_end(1.4, rows, 2.8) is None
    assert buffer.rows_end(1.4, rows, 2.9) == pytest.approx(1.7)  # it is missing
    assert buffer.rows_end(1.4, np.concatenate([rows, [[2.0, 44.0]]]), 2.0) == 2.0
