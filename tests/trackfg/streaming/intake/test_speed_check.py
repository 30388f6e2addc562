"""A receiver's speeds in another unit are named once, and are left out from then on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, KNOT
from trackfg.recording.description import GnssSpeed
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.speed_check import EVERY_S, LONGEST_S, SpeedCheck

PART = GnssSpeed(file="-", column="speed")
DRIVEN_S = 400.0


def seen(
    factor: float, sources: tuple[str, ...], again: Callable[[Any], Any] = lambda check: check, sd_m: float = 1.5
) -> tuple[list[Event], int]:
    """Return the events of a stand of 100 s and a drive of 300 s, and how many speeds were passed on."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, DRIVEN_S, 1.0)
    speed = np.clip((t - 100.0) * 0.3, 0.0, 15.0)
    way = np.cumsum(speed)
    rows = {
        "gnss_speed": np.column_stack([t, factor * (speed + 0.1 * rng.standard_normal(t.size)), 0.1 + 0.0 * t]),
        "gnss": np.column_stack([t, way, 0.1 * way, 0.0 * t, *np.full((3, t.size), sd_m)]),
        "tach": np.column_stack([t, way]),
    }
    rows["gnss"][:, 1:3] += sd_m * rng.standard_normal((t.size, 2))
    check, report, passed = SpeedCheck(CheckLimits()), LossReport(), 0
    events: list[Event] = []
    for i in range(t.size):
        check = again(check)
        tables: dict[str, Array] = {name: rows[name][i : i + 1] for name in ("gnss_speed", *sources)}
        passed += len(check.sound(tables, PART, report).get("gnss_speed", ()))
        events += report.end_of_push()
    return events + list(report.end_of_stream()), passed


@pytest.mark.parametrize("sources", [("gnss",), ("gnss", "tach"), ("tach",)])
@pytest.mark.parametrize(("factor", "unit"), [(1.0 / KMH, "km/h"), (1.0 / KNOT, "kn")])
def test_speeds_in_another_unit_are_named_and_left_out(
    factor: float, unit: str, sources: tuple[str, ...], saved_and_restored: Callable[..., Any]
) -> None:
    events, passed = seen(factor, sources)
    (doubt,) = (event for event in events if event.kind == DOUBT)
    assert doubt.table == "gnss_speed"
    assert f"the data look like {unit}" in doubt.detail
    lost = sum(event.rows for event in events if event.kind == "contradicted")
    assert 0 < passed < DRIVEN_S
    assert passed + lost == DRIVEN_S  # each row is passed on or counted
    assert seen(factor, sources, saved_and_restored) == (events, passed)


@pytest.mark.parametrize("sources", [("gnss",), ("tach",), ()])
def test_speeds_in_their_unit_are_passed_on(sources: tuple[str, ...]) -> None:
    assert seen(1.0, sources) == ([], DRIVEN_S)


def test_positions_that_are_too_poor_to_show_are_no_reason() -> None:
    assert seen(1.0, ("gnss",), sd_m=30.0) == ([], DRIVEN_S)


def test_rows_of_a_receiver_that_sends_no_speeds_are_not_kept_for_ever() -> None:
    check, report = SpeedCheck(CheckLimits()), LossReport()
    for t in np.arange(0.0, 7200.0, 10.0):
        check.sound({"tach": np.column_stack([t + np.arange(10.0), t + np.arange(10.0)])}, PART, report)
    assert check.waiting is not None
    assert sum(map(len, check.waiting["tach"])) <= LONGEST_S + EVERY_S
