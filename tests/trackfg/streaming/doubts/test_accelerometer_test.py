"""What the samples of a stream show of the accelerometer's clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.clocks import LateAccelerometer
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.streaming.doubts.accelerometer_test import AccelerometerTest


def ridden(late_ms: float, speed_sd_mps: float = 1.0) -> tuple[Intervals, pd.DataFrame]:
    """Samples, and a true trajectory with this sigma of its speed."""
    plan = replace(scenario("mainline"), effects=(LateAccelerometer(late_ms),))
    run = simulate(plan, seed=1, duration_s=200.0)
    return intervals(run.recording), run.truth.assign(speed_mps_sd=speed_sd_mps)


def put_in_pieces(data: Intervals, trajectory: pd.DataFrame) -> AccelerometerTest:
    """Put the samples piece by piece, as a stream does."""
    test = AccelerometerTest()
    for first in range(0, len(data), 2000):
        piece = data.take(slice(first, min(first + 2000, len(data))))
        test.put(piece, trajectory[trajectory["t_s"].between(*piece.edges[[0, -1]])])
    return test


@pytest.mark.parametrize("late_ms", [5.0, 20.0, 45.0])
def test_an_accelerometer_that_is_late_is_said_to_be(late_ms: float) -> None:
    (event,) = put_in_pieces(*ridden(late_ms)).events(200.0)
    assert (event.kind, event.t_s) == (DOUBT, 200.0)
    start, late = event.detail.split(" are ")
    assert start == "level, alignment: the accelerometer's samples"
    assert float(late.split(" ms late")[0]) == pytest.approx(late_ms, abs=1.0)


def test_the_speed_is_doubted_where_a_late_force_spoils_its_sigma() -> None:
    """Accelerations of 0.4 m/s^2, rms, make 20 ms an error of 0.008 m/s."""
    for sd, names in ((0.05, "level, alignment: "), (0.005, "level, alignment, speed: ")):
        (event,) = put_in_pieces(*ridden(20.0, sd)).events(200.0)
        assert event.detail.startswith(names)


def test_one_in_time_is_not_doubted() -> None:
    assert put_in_pieces(*ridden(0.0)).events(200.0) == ()
    assert AccelerometerTest().events(0.0) == ()


def test_ten_minutes_suffice_and_a_hole_does_not_matter() -> None:
    data, trajectory = ridden(20.0)
    t = data.edges[:-1]
    data = replace(
        data, bridged=(t > 80.0) & (t < 83.0), accel=np.where(((t > 80.0) & (t < 83.0))[:, None], 0.0, data.accel)
    )
    test = AccelerometerTest()
    for _ in range(10):
        for first in range(0, len(data), 2000):
            piece = data.take(slice(first, min(first + 2000, len(data))))
            test.put(piece, trajectory[trajectory["t_s"].between(*piece.edges[[0, -1]])])
    assert test.products.shape[1] == 60
    (event,) = test.events(200.0)
    assert "20." in event.detail or "19." in event.detail


def test_short_pieces_are_left_out() -> None:
    (data, trajectory), test = ridden(20.0), AccelerometerTest()
    test.put(data.take(slice(0, 600)), trajectory)
    test.put(data, trajectory[:0])
    assert test.products.shape[1] == 0
