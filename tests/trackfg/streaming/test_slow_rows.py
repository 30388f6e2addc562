"""Streams of sensors that are read once a second, at times of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate

from .conftest import setting_off


def test_a_tach_that_is_read_once_a_second_measures_the_way(stream: Callable[..., Any]) -> None:
    run = simulate(setting_off("mainline"), seed=3, duration_s=72.0)
    tach = run.recording.tach
    assert tach is not None
    second = tach[np.diff(np.floor(tach["t_s"] + 0.4), prepend=-1.0) > 0.0].reset_index(drop=True)
    assert len(second) < 0.1 * len(tach)
    ends = [
        stream(replace(run.recording, tach=rows), lag_s=10.0, config=SmoothConfig()).smoothed.iloc[-1]
        for rows in (tach, second)
    ]
    fine, slow = (float(end["chainage_m_sd"]) for end in ends)
    assert slow < 1.2 * fine
    assert abs(ends[1]["chainage_m"] - ends[0]["chainage_m"]) < slow


def test_positions_between_two_samples_make_no_keyframes_besides_their_own(stream: Callable[..., Any]) -> None:
    run = simulate(setting_off("mainline-gnss"), seed=3, duration_s=42.0)
    gnss = run.recording.gnss
    assert gnss is not None
    between = gnss.assign(t_s=gnss["t_s"] + 0.0023)
    filtered = stream(replace(run.recording, gnss=between), lag_s=10.0, config=SmoothConfig()).filtered
    assert np.diff(filtered["t_s"])[1:].min() > 0.2  # the first keyframe ends the first window
