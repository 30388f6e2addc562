"""A sensor whose clock shows local time beside one that shows UTC."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.checks.plausibility import findings
from trackfg.recording.description import Gnss, Imu


@pytest.mark.parametrize(("ahead_s", "offset"), [(3600.0, "-3600"), (-3605.0, "3600"), (0.0, ""), (1000.0, "")])
def test_clocks_of_two_zones_in_a_run_of_hours_are_named(ahead_s: float, offset: str) -> None:
    imu = Imu(file="imu.csv", gyro=("a", "b", "c"), accel=("d", "e", "f"))
    gnss = Gnss(file="gnss.csv", position=("a", "b", "c"), sd=("d", "e", "f"))
    t = np.arange(0.0, 4.0 * 3600.0, 0.25)
    rows = pd.DataFrame(np.column_stack([t, 0.001 * np.random.default_rng(1).standard_normal((len(t), 6))]))
    rows.columns = ["t_s", "wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2"]
    rows["fz_mps2"] += 9.81
    positions = pd.DataFrame({"t_s": t[::4] + ahead_s})

    found = findings({"imu": imu, "gnss": gnss}, {"imu": rows, "gnss": positions}, "r.toml", CheckLimits())

    apart = [(one.level, one.hint or "") for one in found if one.code == "clocks-apart"]
    if not offset:
        assert apart == []
        return
    ((level, hint),) = apart
    assert level == "warning"
    assert f"set time_offset_s = {offset} in [gnss]" in hint
    assert "another time zone" in hint
