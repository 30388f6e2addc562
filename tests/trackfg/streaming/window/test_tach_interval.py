"""The kernel that says what a wheel rolls over an interval, against the batch smoother's functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.odometry import ANY_DISTANCE_SD_M
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.graph.inputs import World
from trackfg.numerics.rotations import so3_exp
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.tach import Wheel
from trackfg.streaming.window.predicted_motion import PredictedMotion
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_interval import TachInterval

WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]
NOTHING = np.zeros((0, 2))
T = np.arange(0.0, 4.01, 0.1)
BEGIN, END = 2.5, 3.5


def rolled(speed: float) -> Wheel:
    return Wheel(T, np.round(speed * T / 0.05) * 0.05, 0.0144, 0.05, False, NOTHING)


WHEELS = {
    "forwards": (rolled(12.0), 12.0),
    "backwards": (rolled(-3.0), -3.0),
    "at rest": (rolled(0.0), 0.0),
    "slipping": (rolled(20.0), 12.0),
    "silent at the end": (replace(rolled(12.0), gaps=np.array([[3.2, 3.7]])), 12.0),
    "silent at the begin": (replace(rolled(0.0), gaps=np.array([[2.2, 2.7]])), 0.0),
    "not counting": (replace(rolled(12.0), uncounted=np.array([[3.0, 3.1], [9.0, 9.5]])), 12.0),
    "ending before": (replace(rolled(12.0), t=T[:30], distance=rolled(12.0).distance[:30]), 12.0),
}


@pytest.fixture(scope="module")
def context(simulated: Callable[..., Simulation]) -> StreamContext:
    description = simulated("mainline", seed=2, duration_s=60.0).recording.description
    return StreamContext(description, SmoothConfig(), World(9.81, np.zeros(3), 0.0), 1.5)


def motion(context: StreamContext, speed: float) -> PredictedMotion:
    """A second in a curve to the left, braking, at 100 Hz."""
    t = np.arange(371) / 100.0
    gyro, accel = np.tile([0.0, 0.0, 0.05], (370, 1)), np.tile([-0.3, 0.6, 9.81], (370, 1))
    attitude = so3_exp(np.array([[0.0, 0.0, 0.4]]))
    shared = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    nav, odo = Nav(attitude, np.zeros((1, 3)), speed * attitude[:, :, 0]), Odo(np.array([[30.0, 1.0, 30.0, 1.0]]))
    newest = States(nav, np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]]), odo, *shared)
    data = Intervals(t, gyro, accel, np.zeros(370, dtype=bool))
    return PredictedMotion.of(context, newest, data, np.array([250, 350]), NoiseAtRest())


@pytest.mark.parametrize("name", WHEELS)
def test_the_kernel_says_what_the_batchs_functions_do(context: StreamContext, name: str, with_both: WithBoth) -> None:
    wheel, speed = WHEELS[name]
    ours, theirs = with_both(lambda: TachInterval.of(motion(context, speed), wheel))
    assert ours.counted == pytest.approx(theirs.counted, rel=1e-12, abs=1e-12)
    assert [family.type for family in ours.families] == [family.type for family in theirs.families]
    for one, other in zip(ours.families, theirs.families, strict=True):
        assert (one.loss, len(one)) == (other.loss, len(other))
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-9)
        for name_, data in other.data.items():
            np.testing.assert_allclose(one.data[name_], data, rtol=1e-9, atol=1e-12)
        for slot, other_slot in zip(one.slots, other.slots, strict=True):
            np.testing.assert_array_equal(slot.index, other_slot.index)


@pytest.mark.usefixtures("kernels")
def test_a_count_is_read_where_it_has_moved_and_covers_the_end(context: StreamContext) -> None:
    read = {
        name: len(TachInterval.of(motion(context, speed), wheel).families) == 2
        for name, (wheel, speed) in WHEELS.items()
    }
    assert {name for name, is_read in read.items() if not is_read} == {"at rest", "silent at the end", "ending before"}


@pytest.mark.usefixtures("kernels")
def test_a_wheel_that_does_not_count_says_nothing(context: StreamContext) -> None:
    sigma = TachInterval.of(motion(context, 12.0), WHEELS["not counting"][0]).families[0].sigma
    assert sigma[0, 0] == pytest.approx(ANY_DISTANCE_SD_M)


def test_the_kernel_refuses_arrays_that_do_not_belong_together() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    with pytest.raises(ValueError, match="do not belong together: a wheel"):
        compiled.tach_interval(T, T[1:], NOTHING, NOTHING, np.zeros(12), np.zeros(8))
    with pytest.raises(ValueError, match="do not belong together: an interval"):
        compiled.tach_interval(T, T, NOTHING, NOTHING, np.zeros(11), np.zeros(8))
