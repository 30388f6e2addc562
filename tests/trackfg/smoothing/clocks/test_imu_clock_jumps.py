"""Jumps of the IMU's clock are distinguished from gaps in its record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.faults import drop_imu
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.smoothing.clocks.imu_clock_jumps import imu_clock_jumps, without_imu_clock_jumps


def without_tach(recording: Recording) -> Recording:
    description = recording.description.model_copy(update={"tach": None})
    return replace(recording, tach=None, description=description)


@pytest.fixture(scope="module")
def recording(simulated: Callable[..., Simulation]) -> Recording:
    return simulated("mainline", seed=3, duration_s=300.0).recording


@pytest.mark.parametrize("by_s", [1.0, 5.0])
def test_a_jump_is_found_and_a_gap_is_not_one(by_s: float, recording: Recording) -> None:
    t = recording.imu["t_s"].to_numpy()
    jumped = replace(recording, imu=recording.imu.assign(t_s=t + by_s * (t > 150.0)))
    (jump,) = imu_clock_jumps(jumped, SmoothConfig())
    assert jump.after_s == pytest.approx(150.0, abs=0.02)
    assert jump.by_s == pytest.approx(by_s, abs=0.01)
    assert imu_clock_jumps(drop_imu(recording, 150.0, 150.0 + by_s), SmoothConfig()) == ()


def test_a_late_tach_shows_a_jump(recording: Recording) -> None:
    assert recording.tach is not None
    late = replace(recording, tach=recording.tach.assign(t_s=recording.tach["t_s"] + 1.0))
    t = late.imu["t_s"].to_numpy()
    (jump,) = imu_clock_jumps(replace(late, imu=late.imu.assign(t_s=t + 2.0 * (t > 150.0))), SmoothConfig())
    assert jump.by_s == pytest.approx(2.0, abs=0.01)
    assert imu_clock_jumps(drop_imu(late, 150.0, 152.0), SmoothConfig()) == ()


def test_jumps_add_up(recording: Recording) -> None:
    t = recording.imu["t_s"].to_numpy()
    jumped = recording.imu.assign(t_s=t + 2.0 * (t > 100.0) + 3.0 * (t > 200.0))
    mended = without_imu_clock_jumps(replace(recording, imu=jumped), SmoothConfig())
    np.testing.assert_allclose(mended.imu["t_s"], t, atol=0.01)
    assert [finding.code for finding in mended.findings] == ["imu-clock-jump"] * 2


@pytest.mark.parametrize("by_s", [0.6, 5.0])
def test_without_a_tach_gnss_shows_a_jump(by_s: float, simulated: Callable[..., Simulation]) -> None:
    recording = without_tach(simulated("mainline-gnss", seed=1, duration_s=300.0).recording)
    t = recording.imu["t_s"].to_numpy()
    jumped = replace(recording, imu=recording.imu.assign(t_s=t + by_s * (t > 150.0)))
    set_back = without_imu_clock_jumps(jumped, SmoothConfig())
    np.testing.assert_allclose(set_back.imu["t_s"], t, atol=0.02)
    (finding,) = set_back.findings
    assert f"jumps ahead by {by_s:.2f} s against that of GNSS" in finding.message
    assert imu_clock_jumps(drop_imu(recording, 150.0, 150.0 + by_s), SmoothConfig()) == ()


def test_without_another_clock_nothing_is_said(recording: Recording) -> None:
    t = recording.imu["t_s"].to_numpy()
    alone = replace(recording, tach=None, imu=recording.imu.assign(t_s=t + 5.0 * (t > 150.0)))
    assert without_imu_clock_jumps(alone, SmoothConfig()) is alone


def test_what_does_not_converge_shows_no_jump(simulated: Callable[..., Simulation]) -> None:
    recording = without_tach(simulated("mainline-gnss", seed=1, duration_s=300.0).recording)
    t = recording.imu["t_s"].to_numpy()
    jumped = replace(recording, imu=recording.imu.assign(t_s=t + 5.0 * (t > 150.0)))
    in_two_steps = SmoothConfig.model_validate({"solver": {"max_iterations": 2}})
    assert imu_clock_jumps(jumped, in_two_steps) == ()
