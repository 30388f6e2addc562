"""What the samples of a stream show of its sensor's vibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import GeometryConfig
from trackfg.datasets.scenarios import simulate
from trackfg.graph.run_context import geometry_conventions
from trackfg.recording.description import Track
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.sensors.short_vibration import Blocks
from trackfg.streaming.doubts.vibration_test import VibrationTest

SPEED_MPS, SD_MM = 8.0, 0.05
CONVENTIONS = geometry_conventions(GeometryConfig(), Track())


@pytest.fixture(scope="module")
def quiet() -> Intervals:
    """Samples of 40 s that show nothing but white noise and gravity."""
    data = intervals(simulate("trolley", seed=0, duration_s=40.0).recording)
    white = np.random.default_rng(0).standard_normal((2, len(data), 3))
    return replace(data, gyro=1e-4 * white[0], accel=1e-2 * white[1] + [0.0, 0.0, 9.8])


def swaying(data: Intervals, roll_rad: float) -> Intervals:
    """Return the samples of a sensor that sways about its long axis by so much, 20 times a second."""
    rate = 40.0 * np.pi * roll_rad * np.cos(40.0 * np.pi * data.edges[:-1])
    return replace(data, gyro=data.gyro + rate[:, None] * [1.0, 0.0, 0.0])


def tables(data: Intervals) -> tuple[pd.DataFrame, pd.DataFrame]:
    trajectory = pd.DataFrame({"t_s": data.edges[[0, -1]], "speed_mps": SPEED_MPS})
    names = ("twist_mm", "versine_level_mm", "versine_alignment_mm")
    return trajectory, pd.DataFrame({f"{name}_sd": np.full(50, SD_MM) for name in names})


def test_a_sensor_that_sways_by_more_than_the_sigmas_is_said_to(quiet: Intervals) -> None:
    test = VibrationTest()
    test.put(swaying(quiet, 3e-4), *tables(quiet))
    (event,) = test.events(40.0, CONVENTIONS)
    assert (event.kind, event.t_s) == (DOUBT, 40.0)
    assert event.detail.startswith("twist: the sensor vibrates: by ")
    assert "multiply its sigmas by" in event.detail


def test_a_quiet_sensor_is_not_doubted(quiet: Intervals) -> None:
    test = VibrationTest()
    test.put(quiet, *tables(quiet))
    assert test.events(40.0, CONVENTIONS) == ()
    assert VibrationTest().events(0.0, CONVENTIONS) == ()


def test_pieces_show_what_the_whole_shows(quiet: Intervals) -> None:
    """Blocks do not reach from a piece into the next one, so that their levels agree as random ones do."""
    data, test = swaying(quiet, 3e-4), VibrationTest()
    trajectory, geometry = tables(quiet)
    for first in range(0, len(data), 2000):
        test.put(data.take(slice(first, min(first + 2000, len(data)))), trajectory, geometry)
    t, speed = trajectory["t_s"].to_numpy(), trajectory["speed_mps"].to_numpy()
    assert test.blocks.shaking()[1].roll == pytest.approx(Blocks.of(data, t, speed).shaking()[1].roll, rel=0.05)


def test_of_a_day_the_newest_hours_are_kept(quiet: Intervals) -> None:
    test = VibrationTest()
    for _ in range(300):
        test.put(quiet, *tables(quiet))
    assert len(test.blocks.speed) == len(test.blocks.variance) == 5000
