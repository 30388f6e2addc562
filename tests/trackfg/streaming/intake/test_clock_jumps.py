"""A clock that was set is distinguished from a gap by what the wheel counted, however the rows come in."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.streaming.checkpoint.snapshot import Snapshot
from trackfg.streaming.intake.clock_jumps import ClockJumps
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.rows import Rows
from trackfg.streaming.sources.source import Batch

WHEN_S, END_S = 10.0, 20.0
IMU_S, TACH_S, QUANTUM_M = 0.01, 0.02, 0.03
Tables = dict[str, Array]


def through_json(state: Snapshot) -> Snapshot:
    return Snapshot(json.loads(json.dumps(state.tree)), state.data)


def description(kind: str = "distance", unit: str = "m") -> RecordingDescription:
    return RecordingDescription.model_validate({
        "id": "x",
        "imu": {"file": "-", "gyro": ["a", "b", "c"], "accel": ["d", "e", "f"]},
        "tach": {"file": "-", "column": "d", "kind": kind, "unit": unit},
        "fixes": {"file": "-"},
    })  # fmt: skip


def run(distance: Callable[[Array], Array], *, seed: int = 0) -> Tables:
    """A ride as it was, in true time; the tach counts whole quanta."""
    rng = np.random.default_rng(seed)
    t, counted, passed = np.arange(0.0, END_S, IMU_S), np.arange(0.003, END_S, TACH_S), np.arange(1.0, END_S, 3.0)
    gravity = np.array([0.0, 0.0, 0.0, 0.1, -0.2, 9.8])
    imu = np.column_stack([t, gravity + rng.normal(0.0, 0.05, (t.size, 6))])
    tach = np.column_stack([counted, np.floor(distance(counted) / QUANTUM_M) * QUANTUM_M])
    return {"imu": imu, "tach": tach, "fixes": np.column_stack([passed, distance(passed), 0.0 * passed + 0.1])}


def set_ahead(tables: Tables, by: float, names: tuple[str, ...] = ("imu", "tach", "fixes")) -> Tables:
    """From ``WHEN_S`` on."""
    return {
        name: rows + np.where(rows[:, :1] >= WHEN_S, by, 0.0) * (np.arange(rows.shape[1]) == 0)
        if name in names
        else rows
        for name, rows in tables.items()
    }


def silent(tables: Tables, seconds: float) -> Tables:
    """Nothing recorded from ``WHEN_S`` on."""
    return {
        name: rows[(rows[:, 0] < WHEN_S) | (rows[:, 0] >= WHEN_S + seconds)] for name, rows in tables.items()
    }  # fmt: skip


def arriving(true: Tables, given: Tables | None = None, seconds: float = 0.1) -> list[Batch]:
    """The rows given, in batches of so many seconds of true time."""
    cut = {name: np.searchsorted(rows[:, 0], np.arange(0.0, END_S + seconds, seconds)) for name, rows in true.items()}
    chunks = (
        {name: (given or true)[name][at[i] : at[i + 1]] for name, at in cut.items()} for i in range(len(cut["imu"]) - 1)
    )
    return [Batch({name: rows for name, rows in chunk.items() if len(rows)}) for chunk in chunks]


def taken_in(batches: list[Batch], described: RecordingDescription | None = None) -> tuple[Tables, list[Event]]:
    intake = Intake.begin(described or description(), canonical=True)
    pieces = [intake.push(batch) for batch in batches]
    pieces.append(intake.finish())
    lost = sum(event.rows for _, events in pieces for event in events)
    assert intake.rows_in == intake.rows_out + lost
    assert intake.rows_out == sum(len(rows) for rows, _ in pieces)
    tables = {name: np.concatenate([rows.tables()[name] for rows, _ in pieces]) for name in ("imu", "tach", "fixes")}
    return tables, [event for _, events in pieces for event in events]


def steady(t: Array) -> Array:
    return 15.0 * t


def braking(t: Array) -> Array:
    return 25.0 * t - 0.5 * t**2


def gentle(t: Array) -> Array:
    return 1.2 * t


def standing(t: Array) -> Array:
    return 0.0 * t


def halting(t: Array) -> Array:
    """As fast at the end as at the beginning, and a halt in between."""
    return np.where(t < 5.0, 8.0 * t, np.where(t < WHEN_S, 40.0, 40.0)) + 8.0 * np.maximum(t - 16.0, 0.0)


@pytest.mark.parametrize("by", [0.3, 2.0, 45.0, 300.0, 5000.0, 1e8, -0.7, -3.0, -1e6])
@pytest.mark.parametrize("ride", [steady, braking, gentle])
def test_a_clock_that_was_set_costs_no_time(ride: Callable[[Array], Array], by: float) -> None:
    true = run(ride)
    tables, events = taken_in(arriving(true, set_ahead(true, by)))
    kinds = [event.kind for event in events if event.table == "imu"]
    assert kinds == ["clock-set"]
    for name, rows in tables.items():
        assert len(rows) == len(true[name])
        np.testing.assert_allclose(rows[:, 0], true[name][:, 0], rtol=0.0, atol=1e-6 + 2e-9 * abs(by))
        np.testing.assert_array_equal(rows[:, 1:], true[name][:, 1:])


@pytest.mark.parametrize("seconds", [0.1, 0.5, 3.0, 9.0])
@pytest.mark.parametrize("ride", [steady, braking, gentle, standing, halting])
def test_a_gap_stays_one(ride: Callable[[Array], Array], seconds: float) -> None:
    tables, events = taken_in(arriving(silent(run(ride), seconds)))
    assert {event.kind for event in events} <= {"gap"}
    assert tables["imu"][-1, 0] == pytest.approx(END_S - IMU_S)


def test_where_one_table_goes_on_no_clock_was_set() -> None:
    tables, events = taken_in(arriving(silent(run(steady), 4.0) | {"tach": run(steady)["tach"]}))
    assert [event.kind for event in events] == ["gap"]
    assert tables["tach"][-1, 0] > END_S - 0.1


def test_a_speed_counts_nothing() -> None:
    true = run(steady)
    _, events = taken_in(arriving(true, set_ahead(true, 5.0)), description("speed", "m/s"))
    assert [event.kind for event in events] == ["gap"]


def test_who_stands_as_before_was_not_moved() -> None:
    true = run(standing)
    _, events = taken_in(arriving(true, set_ahead(true, -1e5)))
    assert [event.kind for event in events if event.table == "imu"] == ["clock-set"]
    moved = {name: rows.copy() for name, rows in set_ahead(true, -1e5).items()}
    moved["imu"][moved["imu"][:, 0] < 0.0, 5] += 0.3  # on a curve with some cant
    _, events = taken_in(arriving(true, moved))
    assert [event.kind for event in events if event.table == "imu"] == ["clock-restart"]


def test_a_count_that_began_again_proves_nothing() -> None:
    true = run(steady)
    later = set_ahead(true, -1e5)
    later["tach"] = later["tach"].copy()
    later["tach"][later["tach"][:, 0] < 0.0, 1] -= 140.0
    _, events = taken_in(arriving(true, later))
    assert {"clock-restart", "tach-reset"} <= {event.kind for event in events if event.table in ("imu", "tach")}
    assert "clock-set" not in {event.kind for event in events}


def test_a_vehicle_that_went_on_while_the_device_was_off_is_a_break() -> None:
    true = run(steady)
    off = silent(true, 4.0)
    _, events = taken_in(arriving(off, set_ahead(off, -1e5)))
    assert [event.kind for event in events if event.table == "imu"] == ["clock-restart"]


@pytest.mark.parametrize("by", [7.0, -2e4, 0.15])
def test_how_rows_are_grouped_makes_no_difference(by: float) -> None:
    true = run(steady)
    (a, said_a), (b, said_b) = (taken_in(arriving(true, set_ahead(true, by), seconds)) for seconds in (0.1, 1.7))
    assert said_a == said_b
    for name, rows in a.items():
        np.testing.assert_array_equal(rows, b[name])


@pytest.mark.parametrize("cut", [99, 101, 103, 108, 130])
def test_it_goes_on_from_its_state(cut: int) -> None:
    true = run(braking)
    batches = arriving(true, set_ahead(true, 7.0))
    whole, again = Intake.begin(description(), canonical=True), Intake.begin(description(), canonical=True)
    for batch in batches[:cut]:
        whole.push(batch)
    again.restore(through_json(whole.state()))
    for batch in batches[cut:]:
        (a, said_a), (b, said_b) = whole.push(batch), again.push(batch)
        assert said_a == said_b
        assert a.until_s == b.until_s
        for name, rows in a.tables().items():
            np.testing.assert_array_equal(rows, b.tables()[name])


def test_events_have_the_times_of_the_stream() -> None:
    steps = ClockJumps.of(description())
    tables = set_ahead(run(steady), 30.0)
    late = Event("late", "tach", 45.0, 45.5, 3, "too late")
    _, events = steps.without_jumps(Rows.of(tables, END_S + 30.0), [])
    assert [event.kind for event in events] == ["clock-set"]
    assert steps.shift_s == pytest.approx(30.0)
    _, events = steps.without_jumps(Rows(until_s=END_S + 30.0), [late])
    assert [(event.t_s, event.until_s) for event in events] == [(pytest.approx(15.0), pytest.approx(15.5))]


@pytest.mark.parametrize("off_s", [300.0, 3000.0])
@pytest.mark.parametrize("distance", [lambda t: 10.0 * t, lambda t: 0.0 * t])
def test_a_feed_that_goes_on_from_now_was_off_however_its_tach_has_counted(
    distance: Callable[[Array], Array], off_s: float
) -> None:
    """The count is that of a clock that was set: the vehicle has stood nearly all of the time, or lost its count."""
    true = run(distance)
    batches = arriving(true, set_ahead(true, off_s))
    until = round(WHEN_S / 0.1)
    for from_now in (True, False):
        intake = Intake.begin(description(), canonical=True)
        pieces = [intake.push(batch) for batch in batches[:until]]
        again = Intake.begin(description(), canonical=True)
        again.restore(through_json(intake.state()))
        if from_now:
            again.miss_rows()
        pieces += [*map(again.push, batches[until:]), again.finish()]
        t = np.concatenate([rows.imu[:, 0] for rows, _ in pieces])
        events = [event.kind for _, some in pieces for event in some if event.table == "imu"]
        assert len(t) == len(true["imu"])
        if from_now:
            assert events == ["gap"]
            assert t[-1] == pytest.approx(true["imu"][-1, 0] + off_s)
        elif off_s > 600.0:
            assert t[-1] < 2.0 * END_S
