"""A clock of the IMU that was set alone is found out by the tach, however the rows come in; a gap is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.checks.clock_change import SIDE_S
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.faults import drop_imu
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.intake.imu_clock_jumps import CELL_S, ImuClockJumps
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.rows import Rows
from trackfg.streaming.sources.source import RecordingSource


def jumped(recording: Recording, *jumps: tuple[float, float]) -> Recording:
    """The IMU's clock is set ahead after each time by so many seconds."""
    t = recording.imu["t_s"].to_numpy()
    return replace(recording, imu=recording.imu.assign(t_s=t + sum(by_s * (t > after_s) for after_s, by_s in jumps)))


def events_of(
    recording: Recording, batch_s: float = 20.0, again: Callable[[Any], Any] = lambda stage: stage
) -> list[Event]:
    """The doubts of the intake."""
    source = RecordingSource(recording, batch_s=batch_s)
    intake, events = Intake.of(source), list[Event]()
    for batch in source:
        intake.imu_clock_jumps = again(intake.imu_clock_jumps)
        events += intake.push(batch)[1]
    return [event for event in (*events, *intake.finish()[1]) if event.kind == DOUBT]


@pytest.fixture(scope="module")
def recording(simulated: Callable[..., Simulation]) -> Recording:
    return simulated("mainline", seed=3, duration_s=300.0).recording


@pytest.mark.parametrize("by_s", [1.0, 5.0])
def test_a_jump_is_found_and_a_gap_is_not_one(by_s: float, recording: Recording) -> None:
    (event,) = events_of(jumped(recording, (150.0, by_s)))
    assert (event.table, event.t_s) == ("imu", pytest.approx(150.0, abs=0.02))
    assert f"the IMU's clock jumped ahead by {by_s:.2f} s against that of the tachometer" in event.detail
    assert event.until_s is not None
    assert 150.0 + by_s < event.until_s < 250.0
    assert events_of(drop_imu(recording, 150.0, 150.0 + by_s)) == []


def test_batches_and_checkpoints_make_no_difference(
    recording: Recording, saved_and_restored: Callable[..., Any]
) -> None:
    given = jumped(recording, (100.0, 5.0), (200.0, 1.0))
    events = events_of(given)
    assert ["5.00 s" in event.detail for event in events] == [True, False]
    assert events_of(given, 0.7) == events
    assert events_of(given, 3.0, saved_and_restored) == events


@pytest.mark.parametrize("seconds", [1.0, 5.0])
def test_gaps_before_and_after_a_jump_are_none(seconds: float, recording: Recording) -> None:
    (event,) = events_of(jumped(drop_imu(recording, 60.0, 60.0 + seconds), (130.0, 2.0)))
    assert "2.00 s" in event.detail
    (event,) = events_of(drop_imu(jumped(recording, (90.0, 2.0)), 180.0, 180.0 + seconds))
    assert "2.00 s" in event.detail


@pytest.mark.parametrize("seconds", [1.0, 2.0, 5.0, 20.0])
@pytest.mark.parametrize(("name", "magnitude"), [("coarse-pulses", 1.0), ("whole-kmh", 5.0)])
def test_gaps_beside_a_poor_tach_are_none(name: str, magnitude: float, seconds: float) -> None:
    plan = replace(scenario("rough-ride"), effects=(effect(name, magnitude),))
    recording = simulate(plan, seed=2, duration_s=300.0).recording
    for begin_s in (60.0, 120.0, 180.0):
        assert events_of(drop_imu(recording, begin_s, begin_s + seconds)) == []


def test_the_end_of_a_stream_is_looked_at(recording: Recording) -> None:
    """It ends 28 s after the jump, before the first look."""
    given = jumped(recording, (150.0, 5.0))
    imu, tach = (table[table["t_s"] < 183.0] for table in (given.imu, given.tables["tach"]))
    (event,) = events_of(replace(given, imu=imu, tach=tach))
    assert event.until_s == pytest.approx(183.0, abs=0.1)


def test_a_late_tach_shows_a_jump(recording: Recording) -> None:
    tach = recording.tables["tach"]
    late = replace(recording, tach=tach.assign(t_s=tach["t_s"] + 1.0))
    (event,) = events_of(jumped(late, (150.0, 2.0)))
    assert "2.00 s" in event.detail
    assert events_of(drop_imu(late, 150.0, 152.0)) == []


def without_tach(recording: Recording) -> Recording:
    description = recording.description.model_copy(update={"tach": None})
    return replace(recording, tach=None, description=description)


@pytest.fixture(scope="module", params=["speeds", "positions"])
def of_receiver(request: pytest.FixtureRequest) -> Recording:
    """A receiver's speeds, or positions as good as those by carrier phase, without a tach."""
    plan = scenario("mainline-gnss")
    assert plan.gnss is not None
    if request.param == "speeds":
        plan = replace(plan, further_sensors=(ReceiverSpeeds(rate_hz=5.0, delay_s=0.1),))
    else:
        plan = replace(plan, gnss=replace(plan.gnss, sd_m=(0.02, 0.02, 0.04)))
    return without_tach(simulate(plan, seed=31, duration_s=300.0).recording)


@pytest.mark.parametrize("by_s", [1.0, 5.0])
def test_without_a_tach_a_receiver_shows_a_jump(
    by_s: float, of_receiver: Recording, saved_and_restored: Callable[..., Any]
) -> None:
    given = jumped(of_receiver, (150.0, by_s))
    (event,) = events_of(given)
    assert f"by {by_s:.2f} s against that of the receiver's" in event.detail
    assert events_of(given, 3.0, saved_and_restored) == [event]
    assert events_of(drop_imu(of_receiver, 150.0, 150.0 + by_s)) == []


def test_without_another_clock_nothing_is_looked_at(recording: Recording) -> None:
    assert events_of(without_tach(jumped(recording, (150.0, 5.0)))) == []


def test_minutes_are_kept(recording: Recording) -> None:
    """Of an hour at rest, in which nothing shows whether the hole was a gap."""
    stage, t = ImuClockJumps.of(recording.description), np.arange(0.0, 3600.0, 0.02)
    assert stage is not None
    t = t[(t < 1000.0) | (t > 1010.0)]
    for part in np.array_split(t, 500):
        stage.take(
            Rows(imu=np.column_stack([part, np.zeros((len(part), 6))]), tach=np.column_stack([part, 0.0 * part]))
        )
        assert max(len(stage.samples.rows), len(stage.other.rows)) * CELL_S < 3.0 * SIDE_S
    assert stage.hole is None
