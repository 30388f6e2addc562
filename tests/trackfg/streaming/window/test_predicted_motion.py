"""The kernel that predicts the next interval of a stream against the batch smoother's functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.graph.inputs import World
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import so3_exp
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.streaming.window.predicted_motion import PredictedMotion
from trackfg.streaming.window.stream_context import StreamContext

WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]
RNG = np.random.default_rng(5)
AT_REST = NoiseAtRest(np.array([1e-8, 0.0, 0.0, 0.0, 1e-5, 0.0]), np.array([np.inf, 1e-10, *np.full(4, np.inf)]))


@pytest.fixture(scope="module")
def context(simulated: Callable[..., Simulation]) -> StreamContext:
    description = simulated("mainline", seed=2, duration_s=60.0).recording.description
    imu = description.imu.model_copy(update={"lever_arm_m": (3.0, 0.4, -1.2)})
    description = description.model_copy(update={"imu": imu})
    return StreamContext(description, SmoothConfig(), World(9.81, np.array([1e-5, 4e-5, 6e-5]), 0.0), 0.0)


def samples(count: int) -> Intervals:
    """Vibration and a slow turn at 100 Hz."""
    t = np.arange(count + 1) / 100.0 + 7.0
    gyro = 0.02 * RNG.standard_normal((count, 3)) + [0.0, 0.01, 0.1]
    accel = 0.5 * RNG.standard_normal((count, 3)) + [0.3, -0.2, 9.8]
    return Intervals(t, gyro, accel, np.zeros(count, dtype=bool))


def shaken() -> Intervals:
    """A shock, a missing sample, a channel at the end of its range and one in coarse steps."""
    data = samples(370)
    edges, gyro, accel = data.edges.copy(), data.gyro.copy(), data.accel.copy()
    edges[301:] += 0.006
    accel[280:284] += [9.0, -6.0, 40.0]
    accel[:, 1] = np.minimum(accel[:, 1], 0.1)
    gyro[:, 0] = np.round(gyro[:, 0], 2)
    return replace(data, edges=edges, gyro=gyro, accel=accel)


def bridged() -> Intervals:
    data = samples(370)
    hole = np.arange(370)
    return replace(data, bridged=(hole >= 250) & (hole < 350))


RECORDS = {
    "usual": (samples(370), (250, 350)),
    "shaken": (shaken(), (250, 350)),
    "bridged": (bridged(), (250, 350)),
    "first of a record": (samples(110), (0, 97)),
    "few samples": (samples(20), (0, 3)),
}


def newest(speed: float) -> States:
    attitude = so3_exp(np.array([[0.02, -0.03, 2.5]]))
    nav = Nav(attitude, np.array([[100.0, -50.0, 3.0]]), speed * attitude[:, :, 0])
    shared = (0.01 * RNG.standard_normal((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    return States(nav, 0.01 * RNG.standard_normal((1, 6)), Odo(np.array([[900.0, 1.01, 890.0, 20.0]])), *shared)


def numbers(found: Any) -> Iterator[Array]:
    """All numbers of a result, in the order of their names."""
    if isinstance(found, tuple):
        for part in found:
            yield from numbers(part)
    elif is_dataclass(found):
        yield from numbers(tuple(getattr(found, field.name) for field in fields(found)))
    else:
        yield np.asarray(found, dtype=np.float64)


def measurements(family: Family) -> tuple[Array, ...]:
    """What distinguishes two families of one type, in the order of the names."""
    return family.sigma, *(slot.index for slot in family.slots), *(data for _, data in sorted(family.data.items()))


@pytest.mark.parametrize("name", RECORDS)
@pytest.mark.parametrize("speed", [30.0, -4.0, 0.0])
def test_the_kernel_predicts_as_the_batchs_functions_do(
    context: StreamContext, name: str, speed: float, with_both: WithBoth
) -> None:
    data, edges = RECORDS[name]
    start = newest(speed)

    def predicted() -> list[Array]:
        motion = PredictedMotion.of(context, start, data, np.array(edges), AT_REST)
        inputs = motion.inputs
        known = (inputs.mean_accel, inputs.mean_gyro, inputs.vibration, inputs.noise, inputs.distance, inputs.body_rate)
        guessed = (inputs.path.rpy, inputs.path.speed, inputs.path.gyro_bias, inputs.distance_at(data.edges))
        rest = (inputs.durations, inputs.mean_rate, motion.start.bias, motion.start.nav.p, motion.t)
        found = (motion.response, motion.measured, motion.nav, motion.distance, motion.rolling)
        return list(numbers((known, guessed, rest, found, tuple(map(measurements, motion.families)))))

    ours, theirs = with_both(predicted)
    assert len(ours) == len(theirs) > 25
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11)


def test_the_kernel_refuses_arrays_that_do_not_belong_together() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    data = samples(20)
    given = (data.edges, data.gyro, data.accel, data.bridged)
    for layout, setting, refused in (((5, 3, 0, 3, 3, 1), 45, "the interval"), ((0, 3, 0, 3, 3, 1), 9, "settings")):
        with pytest.raises(ValueError, match=f"do not belong together: {refused}"):
            compiled.predict_interval(*given, layout, 0.01, np.zeros(setting), np.zeros(11), newest(1.0).arrays, ())
    with pytest.raises(ValueError, match="do not belong together: results"):
        compiled.predict_interval(
            *given, (0, 3, 0, 3, 3, 1), 0.01, np.zeros(43), np.zeros(11), newest(1.0).arrays, (np.zeros(9),)
        )
