from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import NoiseConfig, SmoothConfig
from trackfg.datasets.real import kitti
from trackfg.evaluation.outages import horizontal_errors, score_outages, straight_line_errors, withhold
from trackfg.numerics.spans import Span
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.smoothing.smoother import smooth


def trajectory(**columns: object) -> pd.DataFrame:
    t = np.arange(0.0, 100.05, 0.1)
    table = pd.DataFrame({name: np.zeros(len(t)) for name in TRAJECTORY_COLUMNS}).assign(t_s=t)
    return table.assign(east_m_sd=3.0, north_m_sd=4.0, **columns)


def gnss(**columns: object) -> pd.DataFrame:
    return pd.DataFrame({"t_s": np.arange(0.0, 100.0), "east_m": 0.0, "north_m": 0.0}).assign(**columns)


def test_a_span_holds_its_start_and_not_its_end() -> None:
    kept, withheld = withhold(gnss(), [(10.0, 12.0), (50.0, 50.5)])
    assert withheld["t_s"].tolist() == [10.0, 11.0, 50.0]
    assert len(kept) == 97
    assert kept.index.tolist() == list(range(97))


def test_error_and_sigma() -> None:
    errors = horizontal_errors(trajectory(east_m=6.0), gnss(north_m=8.0))
    np.testing.assert_allclose(errors["error_m"], 10.0)
    np.testing.assert_allclose(errors["sd_m"], 5.0)


def test_positions_outside_the_trajectory_are_left_out() -> None:
    assert len(horizontal_errors(trajectory().iloc[:101], gnss())) == 11


def test_antenna_ahead_of_the_reference_point() -> None:
    north_bound = trajectory(yaw_rad=np.pi / 2)
    errors = horizontal_errors(north_bound, gnss(east_m=-1.0, north_m=2.0), lever_arm_m=(2.0, 1.0, 3.0))
    np.testing.assert_allclose(errors["error_m"], 0.0, atol=1e-12)


def test_heading_through_south_is_not_averaged_to_north() -> None:
    table = trajectory()
    table["yaw_rad"] = np.where(np.arange(len(table)) % 2, 3.14, -3.14)
    errors = horizontal_errors(table, gnss(t_s=np.arange(100) * 0.5 + 0.05, east_m=-2.0), lever_arm_m=(2.0, 0.0, 0.0))
    assert errors["error_m"].max() < 0.01


def test_straight_line_between_the_kept_positions() -> None:
    path = gnss(east_m=np.arange(100.0), north_m=np.where(np.arange(100) == 20, 7.0, 0.0))
    kept, withheld = withhold(path, [(15.0, 25.0)])
    assert straight_line_errors(kept, withheld).max() == pytest.approx(7.0)
    assert np.count_nonzero(straight_line_errors(kept, withheld) > 1e-9) == 1


def test_scores_per_outage_and_for_all() -> None:
    positions = gnss(east_m=np.where(np.arange(100) < 50, 3.0, 4.0))
    scores = score_outages(trajectory(), positions, [(10.0, 20.0), (60.0, 90.0)])
    assert scores["positions"].tolist() == [10, 30, 40]
    np.testing.assert_allclose(scores["rms_m"], [3.0, 4.0, np.sqrt((10 * 9 + 30 * 16) / 40)])
    np.testing.assert_allclose(scores["max_m"], [3.0, 4.0, 4.0])
    np.testing.assert_allclose(scores["mean_sd_m"], 5.0)
    np.testing.assert_allclose(scores["straight_rms_m"], 0.0, atol=1e-12)
    assert np.isnan(scores["start_s"].iloc[-1])


def test_the_smoother_bridges_outages_of_a_real_drive() -> None:
    """KITTI, IMU and 1 Hz positions, 30 s without them five times; what was withheld was not seen."""
    drive = kitti.load().recording
    assert drive.gnss is not None
    outages: list[Span] = [(start, start + 30.0) for start in (60.0, 150.0, 240.0, 330.0, 400.0)]
    kept, _ = withhold(drive.gnss, outages)
    result = smooth(replace(drive, gnss=kept), SmoothConfig(noise=NoiseConfig(adapt=True)))
    assert result.summary.solver.converged
    every = score_outages(result.trajectory, drive.gnss, outages).iloc[-1]
    assert every["positions"] == 150
    assert every["rms_m"] < 3.0
    assert every["straight_rms_m"] > 40.0
