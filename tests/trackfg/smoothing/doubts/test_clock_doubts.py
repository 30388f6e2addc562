"""A clock of the IMU that gains on that of the tach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.results.verdict import Verdict
from trackfg.smoothing.doubts.clock_doubts import BY_CLOCK, is_far
from trackfg.smoothing.smoother import smooth


def verdicts_of(recording: Recording) -> dict[str, Verdict]:
    """The verdicts by quantity."""
    return {verdict.quantity: verdict for verdict in smooth(recording).summary.verdicts}


def of_clock(verdict: Verdict) -> bool:
    """Whether the clocks are among the reasons."""
    return any("the clock of the IMU gains" in reason for reason in verdict.reasons)


def test_a_drift_is_far_beyond_both_what_is_declared_and_how_well_it_is_known() -> None:
    assert is_far(-5e-4, 1e-4, 2e-5)
    assert not is_far(3e-4, 1e-4, 2e-5)
    assert not is_far(5e-4, 1e-4, 2e-4)


@pytest.mark.parametrize(("gain", "doubted"), [(0.0, False), (3e-3, True)])
def test_what_a_clock_makes_wrong_is_not_trusted(
    simulated: Callable[..., Simulation], gain: float, *, doubted: bool
) -> None:
    recording = simulated("slippery-line", seed=1, duration_s=300.0).recording
    imu = recording.imu.assign(t_s=recording.imu["t_s"] * (1.0 + gain))
    found = verdicts_of(replace(recording, imu=imu))
    assert {quantity for quantity, verdict in found.items() if of_clock(verdict)} == (
        set(BY_CLOCK) if doubted else set()
    )
    if doubted:
        assert found["speed"].status == "not_trusted"
