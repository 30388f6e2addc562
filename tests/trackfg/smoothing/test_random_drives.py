"""Any drive to and fro at walking pace, with stops of any length, is smoothed to whole tables with honest sigmas."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackfg import smooth
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import simulate
from trackfg.datasets.sensors.positioning import BaliseModel


@dataclass(frozen=True)
class Drive:
    """A drive to and fro: its speed and stops, and how far apart its fixes are."""

    name: str
    seed: int
    speed_mps: float
    shortest_m: float
    dwell_s: float
    fixes_m: float
    start_rest_s: float


def assert_a_drive_is_smoothed(drive: Drive) -> None:
    base = scenario(drive.name)
    driver = replace(
        base.driver,
        speed_mps=(drive.speed_mps, drive.speed_mps + 0.7),
        near_m=20.0,
        far_m=20.0 + 4.0 * drive.shortest_m,
        shortest_m=drive.shortest_m,
        start_rest_s=drive.start_rest_s,
        dwell_s=(drive.dwell_s, drive.dwell_s + 2.0),
    )
    plan = replace(base, driver=driver, balises=BaliseModel(spacing_m=drive.fixes_m, sd_m=0.1))
    run = simulate(plan, seed=drive.seed, duration_s=60.0)
    result = smooth(run.recording)
    trajectory = result.trajectory
    assert np.isfinite(trajectory.to_numpy()).all()
    assert (trajectory.filter(like="_sd") > 0.0).all().all()
    assert result.summary.solver.converged
    if run.recording.fixes is None or len(run.recording.fixes) == 0:
        return
    for column in ("chainage_m", "speed_mps"):
        true = np.interp(trajectory["t_s"], run.truth["t_s"], run.truth[column])
        z = (trajectory[column] - true) / trajectory[f"{column}_sd"]
        assert np.abs(z).max() < 7.0, column


DRIVES = st.builds(
    Drive,
    name=st.sampled_from(["shunting", "shunting-unsigned"]),
    seed=st.integers(0, 10_000),
    speed_mps=st.floats(0.4, 2.5),
    shortest_m=st.floats(10.0, 40.0),
    dwell_s=st.floats(0.5, 6.0),
    fixes_m=st.sampled_from([2.0, 5.0, 20.0]),
    start_rest_s=st.sampled_from([0.5, 3.0, 20.0]),
)


@settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(DRIVES)
def test_a_few_drives(drive: Drive) -> None:
    assert_a_drive_is_smoothed(drive)


@pytest.mark.slow
@settings(max_examples=16, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(DRIVES)
def test_many_drives(drive: Drive) -> None:
    assert_a_drive_is_smoothed(drive)


def test_a_rest_with_a_fix_every_fifth_of_a_second() -> None:
    """Each fix makes a keyframe: 64 of them pass before the first place of the geometry does."""
    base = scenario("shunting")
    run = simulate(replace(base, driver=replace(base.driver, start_rest_s=40.0)), seed=0, duration_s=120.0).recording
    t = np.arange(1.0, 35.0, 0.2)
    fixes = pd.DataFrame({"t_s": t, "chainage_m": base.driver.near_m, "chainage_sd_m": 0.3})
    result = smooth(replace(run, fixes=fixes))
    assert result.summary.solver.converged
    assert len(result.geometry) > 10
