"""A recording that contradicts its description is not smoothed in silence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg import smooth
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.recording.model import Recording
from trackfg.results.verdict import QUANTITIES
from trackfg.smoothing.doubts.recording_doubts import PLACE

Simulate = Callable[..., Simulation]


def statuses(recording: Recording, code: str) -> dict[str, str]:
    """The status of each quantity, of a result that has the finding."""
    summary = smooth(recording).summary
    assert code in {finding.code for finding in summary.findings}
    return {verdict.quantity: verdict.status for verdict in summary.verdicts}


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_tach_that_is_dead_or_freezes_is_not_believed(share: float, simulated_in_full: Simulate) -> None:
    recording = simulated_in_full("mainline", seed=1, duration_s=120.0).recording
    assert recording.tach is not None
    distance = recording.tach["distance_m"]
    frozen = recording.tach.assign(distance_m=distance.clip(upper=distance.iloc[int(share * len(distance))]))
    assert statuses(replace(recording, tach=frozen), "tach-silent") == dict.fromkeys(QUANTITIES, "not_trusted")


def test_a_gyro_column_with_the_wrong_sign_spoils_everything(simulated_in_full: Simulate) -> None:
    recording = simulated_in_full("mainline", seed=1, duration_s=80.0).recording
    imu = recording.imu.assign(wx_radps=-recording.imu["wx_radps"])
    assert statuses(replace(recording, imu=imu), "gyro-sign") == dict.fromkeys(QUANTITIES, "not_trusted")


def test_fixes_in_km_spoil_the_place_only() -> None:
    plan = replace(scenario("mainline"), balises=BaliseModel(spacing_m=200.0, sd_m=0.1))
    recording = simulate(plan, seed=1, duration_s=150.0).recording
    assert recording.fixes is not None
    fixes = recording.fixes.assign(chainage_m=recording.fixes["chainage_m"] / 1000.0)
    found = statuses(replace(recording, fixes=fixes), "fix-unit")
    assert {found[quantity] for quantity in PLACE} == {"not_trusted"}
    assert found["cross_level"] != "not_trusted"


def test_half_a_tach_is_reported_and_bridged(simulated_in_full: Simulate) -> None:
    """Where the tach has no rows the sigmas are those of the IMU, and hold."""
    run = simulated_in_full("mainline", seed=1, duration_s=120.0)
    assert run.recording.tach is not None
    tach = run.recording.tach[run.recording.tach["t_s"] > 60.0].reset_index(drop=True)
    result = smooth(replace(run.recording, tach=tach))
    assert "tach-absent" in {finding.code for finding in result.summary.findings}
    trajectory = result.trajectory
    error = trajectory["speed_mps"] - np.interp(trajectory["t_s"], run.truth["t_s"], run.truth["speed_mps"])
    assert (error.abs() < 4.0 * trajectory["speed_mps_sd"]).mean() > 0.99


def test_a_sound_recording_has_no_finding_of_its_contents(simulated_in_full: Simulate) -> None:
    summary = smooth(simulated_in_full("mainline", seed=1, duration_s=120.0).recording).summary
    assert summary.findings == ()
