"""Clocks of a stream that are off by more than it allows for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.results.events import DOUBT
from trackfg.streaming.late_clocks import clock_doubts

from .conftest import setting_off, streamed


def test_clocks_within_four_declared_sigmas_are_not_doubted() -> None:
    assert clock_doubts(np.array([-0.3, 0.0, 1.1]), SmoothConfig(), 60.0) == ()
    late, early = clock_doubts(np.array([-0.5, 0.0, 1.5]), SmoothConfig(), 60.0)
    assert (late.kind, late.t_s) == (DOUBT, 60.0)
    assert late.detail.startswith("chainage, position, speed: the stamps of tach are 0.50 s late")
    assert "add 1.50 to gnss.time_offset_s" in early.detail


@pytest.mark.slow
def test_a_stream_of_late_positions_doubts_its_place() -> None:
    recording = simulate(setting_off("mainline-gnss", 8.0), seed=2, duration_s=38.0).recording
    assert recording.gnss is not None
    late = replace(recording, gnss=recording.gnss.assign(t_s=recording.gnss["t_s"] + 2.0))
    for run, doubts in ((recording, 0), (late, 1)):
        details = [
            event.detail for event in streamed(run, lag_s=5.0, config=SmoothConfig()).events if event.kind == DOUBT
        ]
        assert sum("the stamps of gnss are" in detail for detail in details) == doubts
