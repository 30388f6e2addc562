"""A sensor whose clock shows local time beside one that shows UTC."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.checks.plausibility import findings
from trackfg.recording.description import Gnss, Imu
from trackfg.recording.model import IMU_COLUMNS


@pytest.mark.parametrize(("ahead_s", "offset"), [(3600.0, "-3600"), (-3605.0, "3600"), (0.0, ""), (1000.0, "")])
def test_clocks_of_two_zones_in_a_run_of_hours_are_named(ahead_s: float, offset: str) -> None:
    t = np.arange(0.0, 4.0 * 3600.0, 0.25)
    apart = clocks_apart(t, t[::4] + ahead_s)
    if not offset:
        assert apart == []
        return
    ((level, hint),) = apart
    assert level == "warning"
    assert f"set time_offset_s = {offset} in [gnss]" in hint
    assert "another time zone" in hint


def test_clocks_that_begin_somewhere_else_are_of_no_zone() -> None:
    """The record of 92 s is within 1800 to 2716 s, and so are few of the positions."""
    ((level, hint),) = clocks_apart(np.arange(2300.0, 2392.0, 0.25), np.arange(0.0, 916.0))
    assert level == "error"
    assert "set time_offset_s of [gnss] (first rows together: 2300)" in hint


def clocks_apart(imu_s: np.ndarray, gnss_s: np.ndarray) -> list[tuple[str, str]]:
    """Level and hint of each finding ``clocks-apart``, of GNSS positions at these times beside an IMU at rest."""
    imu = Imu(file="imu.csv", gyro=("a", "b", "c"), accel=("d", "e", "f"))
    gnss = Gnss(file="gnss.csv", position=("a", "b", "c"), sd=("d", "e", "f"))
    noise = 0.001 * np.random.default_rng(1).standard_normal((len(imu_s), 6))
    rows = pd.DataFrame(np.column_stack([imu_s, noise]), columns=IMU_COLUMNS)
    rows["fz_mps2"] += 9.81
    tables = {"imu": rows, "gnss": pd.DataFrame({"t_s": gnss_s})}
    found = findings({"imu": imu, "gnss": gnss}, tables, "r.toml", CheckLimits())
    return [(one.level, one.hint or "") for one in found if one.code == "clocks-apart"]
