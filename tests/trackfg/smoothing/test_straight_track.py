"""A sensor that is turned about the direction of travel shows cant where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth_states
from trackfg.smoothing.straight_track import roll_on_straights


def turned(recording: Recording, roll: float) -> Recording:
    """Return what a sensor measures whose left side is up by ``roll``, rad, while it is declared level."""
    c, s = np.cos(roll), np.sin(roll)
    imu = recording.imu.copy()
    for name, unit in (("w", "radps"), ("f", "mps2")):
        y, z = (recording.imu[f"{name}{axis}_{unit}"] for axis in "yz")
        imu[f"{name}y_{unit}"], imu[f"{name}z_{unit}"] = c * y + s * z, c * z - s * y
    return replace(recording, imu=imu)


@pytest.mark.parametrize("roll", [0.0, 0.02, -0.02])
def test_cant_of_straight_track_is_the_sensors_roll(simulated: Callable[..., Simulation], roll: float) -> None:
    run = simulated("mainline", seed=1, duration_s=150.0)
    doubts = roll_on_straights(smooth_states(turned(run.recording, roll), SmoothConfig()))
    assert len(doubts) == (1 if roll else 0)
    for doubt in doubts:
        assert doubt.quantities == ("roll", "cross_level")
        seen = float(doubt.reason.split("by ")[1].split(" mrad")[0])
        assert seen == pytest.approx(1e3 * roll, abs=2.0)
        assert doubt.factor > 10.0


def test_a_short_run_has_too_little_straight_track(simulated: Callable[..., Simulation]) -> None:
    run = simulated("trolley", seed=1, duration_s=60.0)
    assert roll_on_straights(smooth_states(turned(run.recording, 0.05), SmoothConfig())) == []
