"""A tach that counts while a stream's vehicle rests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.standstills import find_standstills
from trackfg.streaming.doubts.rest_count_test import RestCountTest


def put(recording: Recording, counted_mps: float, *, rests_known: bool) -> RestCountTest:
    """The test of a run whose tach counts ``counted_mps`` in its rests, in parts as they come."""
    assert recording.tach is not None
    rests, samples = find_standstills(recording), intervals(recording)
    t, distance = recording.tach.to_numpy().T
    counted = np.interp(t, *_ramps(rests, counted_mps))
    rows = np.column_stack([t, distance + counted])
    test = RestCountTest()
    for first in range(0, len(samples), 2000):
        part = samples.take(slice(first, min(first + 2000, len(samples))))
        test.put(part, rows, rests if rests_known else np.zeros((0, 2)), recording.description, 0.1)
    return test


def _ramps(rests: np.ndarray, speed_mps: float) -> tuple[np.ndarray, np.ndarray]:
    gained = np.cumsum(np.diff(rests, axis=1)[:, 0]) * speed_mps
    return rests.ravel(), np.column_stack([np.append(0.0, gained[:-1]), gained]).ravel()


def test_a_tach_that_counts_at_rest_is_doubted(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("slippery-line", seed=1, duration_s=300.0).recording
    (event,) = put(recording, 0.5, rests_known=False).events(300.0, recording.description, 0.1)
    assert event.kind == DOUBT
    assert event.detail.startswith("chainage, position, height, speed, roll, pitch, cross_level, twist, ")
    assert "the tach goes on counting while the vehicle rests, as from " in event.detail


def test_a_sound_tach_is_not(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("slippery-line", seed=1, duration_s=300.0).recording
    assert put(recording, 0.0, rests_known=True).events(300.0, recording.description, 0.1) == ()
    assert RestCountTest().events(0.0, recording.description, 0.1) == ()
