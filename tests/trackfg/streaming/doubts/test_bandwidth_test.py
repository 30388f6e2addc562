"""What the samples of a stream show of its sensor's filter."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import Intervals
from trackfg.streaming.doubts.bandwidth_test import BandwidthTest

STEP_M = 0.25
RESTS = np.array([[0.0, 30.0]])


def samples(averaged: int) -> Intervals:
    """Half a minute of noise at 200 Hz, of which each sample is a mean over some."""
    white = np.random.default_rng(0).standard_normal((6, 6000))
    noise = np.array([np.convolve(channel, np.ones(averaged) / averaged, mode="same") for channel in white]).T
    return Intervals(np.arange(6001) / 200.0, 1e-4 * noise[:, :3], 1e-2 * noise[:, 3:], np.zeros(6000, dtype=bool))


def geometry() -> pd.DataFrame:
    x = STEP_M * np.arange(2000)
    y = np.sin(x)
    names = ("twist_mm", "versine_level_mm", "versine_alignment_mm", "curvature_1pm")
    columns = {name: values for column in names for name, values in ((column, y), (f"{column}_sd", 0.05))}
    return pd.DataFrame({"chainage_m": x, "speed_mps": 25.0, **columns})


def put_in_pieces(data: Intervals) -> BandwidthTest:
    test = BandwidthTest()
    for first in range(0, 6000, 2000):
        test.put(data.take(slice(first, first + 2000)), RESTS, geometry(), STEP_M)
    return test


def test_a_slow_sensor_is_said_to_be() -> None:
    events = put_in_pieces(samples(20)).events(30.0)
    assert [(event.kind, event.t_s) for event in events] == [(DOUBT, 30.0)] * 4
    assert events[0].detail.startswith("twist: the gyro's samples hold little above ")
    assert "are missing: do not trust it, or filter the sensor less" in events[0].detail


def test_a_fast_one_is_not_doubted() -> None:
    assert put_in_pieces(samples(1)).events(30.0) == ()
    assert BandwidthTest().events(0.0) == ()


def test_pieces_of_another_rate_are_left_out() -> None:
    test = put_in_pieces(samples(20))
    assert test.spectra is not None
    lines = test.spectra.lines.copy()
    slow = samples(20)
    test.put(Intervals(10.0 * slow.edges, slow.gyro, slow.accel, slow.bridged), 10.0 * RESTS, geometry()[:0], STEP_M)
    assert np.array_equal(test.spectra.lines, lines)
