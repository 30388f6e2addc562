"""A receiver's values that its table repeats are passed on once, at rest once per measurement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.held_rows import HeldRows

REST_S, DRIVEN_S, TUNNEL_S = 20.0, 60.0, 30.0
ROWS_HZ = 10.0
SPEED_MPS = 12.0


def drive(receiver_s: float) -> dict[str, Array]:
    """A rest, a drive, a tunnel in which the receiver measures nothing, and a drive, in a table of 10 Hz."""
    t = np.arange(0.0, REST_S + 2.0 * DRIVEN_S + TUNNEL_S, 1.0 / ROWS_HZ)
    measured_s = np.floor(t / receiver_s + 1e-6) * receiver_s
    tunnel_s = REST_S + DRIVEN_S
    measured_s = np.where((t > tunnel_s) & (t < tunnel_s + TUNNEL_S), tunnel_s, measured_s)
    way = SPEED_MPS * np.clip(measured_s - REST_S, 0.0, None)
    speed = np.where(measured_s > REST_S, SPEED_MPS + 0.1 * np.sin(measured_s), 0.0)
    return {
        "gnss": np.column_stack([t, way, 0.1 * way, 0.0 * t, *np.ones((3, t.size))]),
        "gnss_speed": np.column_stack([t, speed, 0.1 + 0.0 * t]),
        "tach": np.column_stack([t, SPEED_MPS * np.clip(t - REST_S, 0.0, None)]),
    }


def passed_on(
    rows: dict[str, Array], per_batch: int = 1, again: Callable[[Any], Any] = lambda held: held
) -> tuple[dict[str, Array], int]:
    """Return the times that are passed on, by table, and how many rows were reported."""
    held, report = HeldRows(), LossReport()
    passed: dict[str, list[float]] = {name: [] for name in rows}
    for i in range(0, len(rows["gnss"]), per_batch):
        tables = again(held).without({name: table[i : i + per_batch] for name, table in rows.items()}, report)
        for name, table in tables.items():
            passed[name] += table[:, 0].tolist()
    events = report.end_of_stream()
    assert {event.kind for event in events} <= {"held"}
    return {name: np.array(t) for name, t in passed.items()}, sum(event.rows for event in events)


@pytest.mark.parametrize("receiver_s", [1.0, 0.2])
def test_each_measurement_is_passed_on_once(receiver_s: float) -> None:
    rows = drive(receiver_s)
    passed, lost = passed_on(rows)
    assert lost + sum(map(len, passed.values())) == sum(map(len, rows.values()))
    gnss = passed["gnss"]
    driven = (gnss > REST_S + 10.0) & (gnss < REST_S + DRIVEN_S)
    np.testing.assert_allclose(np.diff(gnss[driven]), receiver_s, atol=1e-9)
    np.testing.assert_allclose(gnss[driven] / receiver_s, np.round(gnss[driven] / receiver_s), atol=1e-6)
    # At rest a row stands for itself after one and a half intervals, one second each before they are known.
    np.testing.assert_allclose(np.diff(gnss[gnss < REST_S]), 1.5, atol=1e-6)
    speeds = passed["gnss_speed"]
    driven = (speeds > REST_S + 10.0) & (speeds < REST_S + DRIVEN_S)
    np.testing.assert_allclose(np.diff(speeds[driven]), receiver_s, atol=1e-9)


def test_in_a_tunnel_nothing_is_passed_on_but_where_no_wheel_shows_the_motion() -> None:
    rows = drive(1.0)
    inside = REST_S + DRIVEN_S + 1.0, REST_S + DRIVEN_S + TUNNEL_S - 1.0

    def in_tunnel(tables: dict[str, Array]) -> int:
        gnss = passed_on(tables)[0]["gnss"]
        return int(np.count_nonzero((gnss > inside[0]) & (gnss < inside[1])))

    assert in_tunnel(rows) == 0
    assert in_tunnel({name: table for name, table in rows.items() if name != "tach"}) >= 15


def test_a_table_that_is_written_as_often_as_its_receiver_measures_is_passed_on() -> None:
    rows = drive(1.0 / ROWS_HZ)
    rows["gnss"][:, 1] += 1e-3 * np.random.default_rng(0).standard_normal(len(rows["gnss"]))
    rows.pop("gnss_speed")
    passed, lost = passed_on(rows)
    assert lost == 0
    np.testing.assert_array_equal(passed["gnss"], rows["gnss"][:, 0])


@pytest.mark.parametrize("per_batch", [7, 100])
def test_how_rows_are_grouped_and_what_was_saved_between_makes_no_difference(
    per_batch: int, saved_and_restored: Callable[..., Any]
) -> None:
    passed, lost = passed_on(drive(1.0))
    grouped, lost_grouped = passed_on(drive(1.0), per_batch)
    assert lost == lost_grouped
    for name, t in passed.items():
        np.testing.assert_array_equal(t, grouped[name])
    held, report = HeldRows(), LossReport()
    saved, report_of_saved = HeldRows(), LossReport()
    rows = drive(1.0)
    for i in range(0, len(rows["gnss"]), per_batch):
        batch = {name: table[i : i + per_batch] for name, table in rows.items()}
        saved = saved_and_restored(saved)
        ours, theirs = held.without(batch, report), saved.without(batch, report_of_saved)
        for name, table in ours.items():
            np.testing.assert_array_equal(table, theirs[name])
