"""A stream reports its doubts while it runs, each once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg import FixedLagSmoother
from trackfg.datasets.scenarios import simulate
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.doubts.reporting import DoubtReports, subject_of
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

from ..conftest import setting_off


def test_looks_are_further_and_further_apart_up_to_an_hour() -> None:
    doubts = DoubtReports()
    looks = [t for t in np.arange(1000.0, 30_000.0) if doubts.are_due(float(t))]
    assert looks[:6] == [1120.0, 1240.0, 1480.0, 1960.0, 2920.0, 4840.0]
    assert max(np.diff(looks)) == 3600.0


def test_a_doubt_is_new_once_whatever_its_factor() -> None:
    doubts = DoubtReports()
    speed = Event(DOUBT, detail="speed: estimates differ by 2.5 times")
    assert doubts.new([speed]) == (speed,)
    assert doubts.new([replace(speed, detail="speed: estimates differ by 3 times")]) == ()
    roll = replace(speed, detail="roll: estimates differ by 2.5 times")
    assert doubts.new([speed, roll]) == (roll,)
    assert subject_of(roll) != subject_of(replace(roll, kind="noise-raised"))


@pytest.mark.slow
def test_a_stream_says_early_that_its_clock_is_off() -> None:
    recording = simulate(setting_off("mainline-gnss", 8.0), seed=1, duration_s=140.0).recording
    assert recording.gnss is not None
    late = replace(recording, gnss=recording.gnss.assign(t_s=recording.gnss["t_s"] + 2.0))
    smoother, events = FixedLagSmoother(recording.description, lag_s=10.0), []
    source = RecordingSource(late)
    intake = Intake.of(source)
    for batch in source:
        estimates = smoother.put(intake.push(batch)[0])
        events += [event for event in estimates.events if event.kind == DOUBT]
    (event,) = [event for event in events if "stamps of gnss" in event.detail]
    assert event.t_s is not None
    assert event.t_s < 140.0
