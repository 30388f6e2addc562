"""A stream whose inertial sensor changes its sampling rate during the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate


def test_a_stream_follows_a_change_of_the_rate(stream: Callable[..., Any]) -> None:
    """From 200 to 10 samples a second after 70 s: the first two seconds are bridged, later ones are measured."""
    recording = simulate("mainline", seed=0, duration_s=120.0).recording
    imu, row = recording.imu, 14_000
    means = pd.DataFrame(imu.iloc[row:].to_numpy().reshape(-1, 20, 7).mean(axis=1), columns=imu.columns)
    changed = replace(recording, imu=pd.concat([imu.iloc[:row], means], ignore_index=True))
    slow, fine = (stream(one, lag_s=10.0, config=SmoothConfig()).smoothed for one in (changed, recording))
    ratio = np.interp(fine["t_s"], slow["t_s"], slow["roll_rad_sd"]) / fine["roll_rad_sd"]
    assert ratio[fine["t_s"] > 80.0].max() < 1.3
