"""Rests of a stream: what the whole silence of its tach shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.tach import Wheel
from trackfg.streaming.rows import Rows
from trackfg.streaming.window.rests import Rests
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.window import Window

STOPS_S, CREEPS_S, STARTS_S = 20.0, 29.0, 37.0
"""The vehicle stops, lets go of the brake and creeps by less than a count, and starts in earnest."""
COUNT_M = 0.3


@pytest.fixture(scope="module")
def recording(simulated: Callable[..., Simulation]) -> Recording:
    return simulated("mainline", seed=2, duration_s=60.0).recording


def tach_rows() -> Array:
    """A count once a second."""
    t = np.arange(0.0, 45.0)
    distance = 0.35 * (STOPS_S**2 - np.maximum(STOPS_S - t, 0.0) ** 2 + np.maximum(t - STARTS_S, 0.0) ** 2)
    return np.column_stack([t, np.floor(distance / COUNT_M) * COUNT_M])


def inertial_rows() -> Array:
    """Samples at 100 Hz: the force forwards is that of braking, of rest on a gradient, of creeping, of a start."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 45.0, 0.01)
    force = np.select([t < STOPS_S, t < CREEPS_S, t < STARTS_S], [-0.4, 0.3, 0.45], 1.0)
    forces = np.stack([force, np.zeros_like(t), np.full_like(t, 9.81)], axis=1)
    return np.column_stack([t, rng.normal(0.0, 1e-4, (len(t), 3)), forces + rng.normal(0.0, 3e-3, (len(t), 3))])


@pytest.mark.parametrize("begin", [14.0, 21.0, 23.0, 25.5])
def test_a_creep_in_a_silence_of_the_tach_is_no_rest(recording: Recording, begin: float) -> None:
    config, tach, rows = SmoothConfig(), recording.description.tach, tach_rows()
    assert tach is not None
    buffer = SampleBuffer(recording.description)
    buffer.put(Rows(imu=inertial_rows(), tach=rows))
    wheel = Wheel(*rows.T, COUNT_M / np.sqrt(12.0), COUNT_M, False, np.zeros((0, 2)))
    turning = TachBuffer.of(wheel, rows, tach, max_gap_s=config.tach.max_gap_s)
    still = Nav(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    shared = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU))
    states = States(still, np.zeros((1, 6)), Odo(np.array([[140.0, 0.0, 140.0, 0.0]])), *shared)
    rests = Rests(lag_s=10.0)
    rests.update(
        buffer,
        turning,
        Window(np.array([25.0]), states, (), np.zeros((1, 6, Kind.IMU.dim)), ()),
        config.motion,
        (begin, 40.0),
    )
    assert all(start >= STOPS_S and end <= CREEPS_S + 0.5 for start, end in rests.spans)
    assert len(rests.spans) == 1
