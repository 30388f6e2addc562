"""Waves of the track that a filtered sensor does not show."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.inertial import Slow
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.results.verdict import widening
from trackfg.sensors.imu_filters.bandwidth import Bandwidths
from trackfg.smoothing.doubts.bandwidth_doubts import ShortWaves
from trackfg.smoothing.doubts.usual_sigmas import COLUMNS
from trackfg.smoothing.smoother import smooth

STEP_M = 0.25


def waves(speed_mps: float, length_m: float = 8.0, sd_mm: float = 0.02, rows: int = 4000) -> pd.DataFrame:
    """A geometry of sines of 1 mm."""
    x = STEP_M * np.arange(rows)
    y = np.sin(2.0 * np.pi * x / length_m)
    columns = {name: values for column in COLUMNS.values() for name, values in ((column, y), (f"{column}_sd", sd_mm))}
    curvature = {"curvature_1pm": 1e-3 * y, "curvature_1pm_sd": 1e-3 * sd_mm}
    return pd.DataFrame({"chainage_m": x, "speed_mps": speed_mps, **columns, **curvature})


@pytest.mark.parametrize("backwards", [False, True])
def test_what_a_filter_of_first_order_takes_is_known(backwards: bool) -> None:
    geometry = waves(10.0, sd_mm=0.004)
    if backwards:
        geometry = geometry.assign(speed_mps=-10.0, chainage_m=-geometry["chainage_m"])
    doubts = {doubt.quantities: doubt for doubt in ShortWaves.of(geometry, STEP_M).doubts(Bandwidths(10.0, 20.0))}
    lost = math.sqrt(1.0 + (10.0 / 8.0 / 10.0) ** 2) - 1.0
    expected = math.hypot(1.0, lost / math.sqrt(2.0) / 0.004)
    assert doubts["twist",].factor == pytest.approx(expected, rel=0.03)
    assert "the gyro's samples hold little above 10 Hz: 0.0055 mm of twist are missing" in doubts["twist",].reason
    assert ("level",) not in doubts  # 0.0014 mm, a third of a sigma
    assert doubts["curvature",].factor == pytest.approx(expected, rel=0.03)
    assert "5.5e-06 1/m of curvature are missing" in doubts["curvature",].reason


def test_a_geometry_too_fast_for_the_sensor_is_not_to_be_trusted() -> None:
    twist, curvature = ShortWaves.of(waves(30.0), STEP_M).doubts(Bandwidths(5.0, None))
    assert (twist.quantities, twist.factor) == (("twist",), math.inf)
    assert "at 30 m/s waves shorter than 6.1 m are missing" in twist.reason
    assert curvature.quantities == ("curvature",)
    assert math.isfinite(curvature.factor)


def test_some_fast_metres_do_not_spoil_a_slow_run() -> None:
    whole = ShortWaves.of(waves(5.0), STEP_M) + ShortWaves.of(waves(30.0, rows=100), STEP_M)
    assert all(math.isfinite(doubt.factor) for doubt in whole.doubts(Bandwidths(8.0, 8.0)))


def test_a_sensor_that_is_not_filtered_or_a_table_without_rows_is_not_doubted() -> None:
    assert not list(ShortWaves.of(waves(30.0), STEP_M).doubts(Bandwidths(None, None)))
    assert not list(ShortWaves.of(waves(30.0)[:0], STEP_M).doubts(Bandwidths(1.0, 1.0)))
    assert not list(ShortWaves.of(waves(30.0, sd_mm=np.nan), STEP_M).doubts(Bandwidths(1.0, 1.0)))


def test_what_lies_between_passages_is_no_bend() -> None:
    two = pd.concat([waves(10.0), waves(10.0).assign(chainage_m=lambda table: table["chainage_m"] + 5000.0)])
    two["twist_mm"] += np.repeat([0.0, 50.0], 4000)
    one, both = (ShortWaves.of(table, STEP_M) for table in (waves(10.0), two))
    assert both.sums[0, 1] == pytest.approx(2.0 * one.sums[0, 1])


@pytest.mark.parametrize("hz", [20.0, 5.0])
def test_a_slow_sensor_is_widened_or_not_trusted(hz: float) -> None:
    run = simulate(replace(scenario("mainline"), effects=(Slow(hz),)), seed=1, duration_s=240.0)
    result = smooth(run.recording)
    errors = geometry_errors(result.geometry, result.trajectory, run.truth, run.truth_geometry)
    for name, column in COLUMNS.items():
        if hz == 5.0:
            assert math.isinf(widening(result.summary.verdicts, name))
        else:
            assert np.sqrt(np.nanmean((errors[column] / errors[f"{column}_sd"]) ** 2)) < 1.6
    assert widening(result.summary.verdicts, "roll") == 1.0
