"""What the samples of a stream show of the accelerometer's clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.clocks import LateAccelerometer
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.streaming.accelerometer_test import AccelerometerTest


def ridden(late_ms: float) -> Simulation:
    return simulate(replace(scenario("mainline"), effects=(LateAccelerometer(late_ms),)), seed=1, duration_s=200.0)


def put_in_pieces(data: Intervals, trajectory: pd.DataFrame) -> AccelerometerTest:
    """Put the samples piece by piece, as a stream does."""
    test = AccelerometerTest()
    for first in range(0, len(data), 2000):
        piece = data.take(slice(first, min(first + 2000, len(data))))
        test.put(piece, trajectory[trajectory["t_s"].between(*piece.edges[[0, -1]])])
    return test


@pytest.mark.parametrize("late_ms", [5.0, 20.0, 45.0])
def test_an_accelerometer_that_is_late_is_said_to_be(late_ms: float) -> None:
    run = ridden(late_ms)
    (event,) = put_in_pieces(intervals(run.recording), run.truth).events(200.0)
    assert (event.kind, event.t_s) == (DOUBT, 200.0)
    start, late = event.detail.split(" are ")
    assert start == "level, alignment: the accelerometer's samples"
    assert float(late.split(" ms late")[0]) == pytest.approx(late_ms, abs=1.0)


def test_one_in_time_is_not_doubted() -> None:
    run = ridden(0.0)
    assert put_in_pieces(intervals(run.recording), run.truth).events(200.0) == ()
    assert AccelerometerTest().events(0.0) == ()


def test_ten_minutes_suffice_and_a_hole_does_not_matter() -> None:
    run = ridden(20.0)
    data = intervals(run.recording)
    t = data.edges[:-1]
    data = replace(
        data, bridged=(t > 80.0) & (t < 83.0), accel=np.where(((t > 80.0) & (t < 83.0))[:, None], 0.0, data.accel)
    )
    test = AccelerometerTest()
    for _ in range(10):
        for first in range(0, len(data), 2000):
            piece = data.take(slice(first, min(first + 2000, len(data))))
            test.put(piece, run.truth[run.truth["t_s"].between(*piece.edges[[0, -1]])])
    assert test.products.shape[1] == 60
    (event,) = test.events(200.0)
    assert "20." in event.detail or "19." in event.detail


def test_short_pieces_are_left_out() -> None:
    run, test = ridden(20.0), AccelerometerTest()
    test.put(intervals(run.recording).take(slice(0, 600)), run.truth)
    test.put(intervals(run.recording), run.truth[:0])
    assert test.products.shape[1] == 0
