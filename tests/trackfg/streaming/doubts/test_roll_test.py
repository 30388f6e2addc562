"""The mean roll on straights of a stream's smoothed rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.events import DOUBT
from trackfg.smoothing.passage import STEP_M
from trackfg.smoothing.straights import straight, straightest
from trackfg.streaming.doubts.roll_test import RollTest
from trackfg.streaming.doubts.track_cells import TrackCells

SPEED_MPS, RATE_HZ, SD_RAD = 12.0, 10.0, 1e-3


def rows(roll_deg: float, duration_s: float = 200.0) -> pd.DataFrame:
    """Rows of a run with a curve of 300 m radius, from 1000 to 1300 m, that is canted by 0.1 rad."""
    t = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    into = np.clip(SPEED_MPS * t - 1000.0, 0.0, 300.0)
    cant = 0.1 * ((into > 0.0) & (into < 300.0))
    heading = np.angle(np.exp(1j * (np.pi - 0.01 + into / 300.0)))
    roll = np.radians(roll_deg) + cant + 1e-4 * np.sin(t)
    known = {"t_s": t, "speed_mps": SPEED_MPS, "yaw_rad": heading, "roll_rad": roll, "roll_rad_sd": SD_RAD}
    return pd.DataFrame(known, columns=list(TRAJECTORY_COLUMNS))


def put_through(table: pd.DataFrame, *ends: int) -> RollTest:
    test, cells, first = RollTest(), TrackCells(), 0
    for end in (*ends, len(table)):
        test.put(cells.put(table[first:end]))
        first = end
    return test


@pytest.mark.parametrize("roll_deg", [1.0, -0.5])
def test_a_tilt_is_said(roll_deg: float) -> None:
    (event,) = put_through(rows(roll_deg)).events(200.0)
    side = "left" if roll_deg > 0 else "right"
    assert (event.kind, event.t_s) == (DOUBT, 200.0)
    assert event.detail.startswith(f"roll, cross_level: on straights the {side} side is {abs(roll_deg):.2f} deg up")


def test_an_upright_sensor_and_one_in_curves_alone_are_not_doubted() -> None:
    assert put_through(rows(0.05)).events(200.0) == ()
    assert put_through(rows(1.0, duration_s=20.0)).events(20.0) == ()
    assert RollTest().events(0.0) == ()


def test_a_mean_that_its_sigma_explains_is_not_doubted() -> None:
    """1 deg is 2.9 sigmas of 6 mrad."""
    assert put_through(rows(1.0).assign(roll_rad_sd=6e-3)).events(200.0) == ()
    assert len(put_through(rows(1.0).assign(roll_rad_sd=5e-3)).events(200.0)) == 1


def test_what_is_not_known_at_first_does_not_hide_a_tilt() -> None:
    """1 deg is 2 sigmas for a third of the run, and 17 of them from then on."""
    table = rows(1.0)
    table["roll_rad_sd"] = np.where(table["t_s"] < 70.0, 9e-3, 1e-3)
    assert len(put_through(table).events(200.0)) == 1
    slight = rows(0.0)
    slight["roll_rad_sd"] = table["roll_rad_sd"]
    slight["roll_rad"] += np.where(table["t_s"] < 70.0, 9e-3, 1e-3)  # one sigma throughout
    assert put_through(slight).events(200.0) == ()


def test_a_small_tilt_is_said_where_roll_is_known_well() -> None:
    """0.1 deg is 1.7 mrad, 6 sigmas; but 0.5 mrad is what irregularities of 3 mrad leave of the mean."""
    sure = rows(0.1).assign(roll_rad_sd=3e-4)
    assert len(put_through(sure).events(200.0)) == 1
    way = SPEED_MPS * sure["t_s"].to_numpy()
    rough = rows(0.03).assign(roll_rad_sd=1e-4)
    assert len(put_through(rough).events(200.0)) == 1
    rough["roll_rad"] += 3e-3 * np.sin(2.0 * np.pi * way / 70.0)
    assert put_through(rough).events(200.0) == ()


def test_pieces_of_any_size_make_the_same_sums() -> None:
    table = rows(1.0)
    whole = put_through(table)
    way = SPEED_MPS * table["t_s"].to_numpy()
    cells = np.arange(1, int(way[-1] / STEP_M) + 1) * STEP_M
    on_straight = straight(np.interp(cells, way, np.unwrap(table["yaw_rad"])), straightest(np.array(SPEED_MPS)))
    assert whole.sums[0] == np.count_nonzero(on_straight)
    mean = np.interp(cells, way, table["roll_rad"])[on_straight].mean()
    assert whole.sums[3] / whole.sums[1] == pytest.approx(mean)
    for ends in ((0, 1, 2, 7), tuple(range(5, len(table), 5)), (1999,)):
        test = put_through(table, *ends)
        np.testing.assert_allclose(test.sums, whole.sums, rtol=1e-12)
