"""A tach that sends no rows at first: estimates begin with what measures the speed, and are as good from then on."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.recording.model import Recording
from trackfg.sensors.tach import read_wheel
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.json_lines import JsonLinesSource

LATE_S = 15.0


def with_tach_from(recording: Recording, t: float, *, signed: bool = False) -> Recording:
    tach = recording.description.tach.model_copy(update={"signed": signed})
    return replace(
        recording,
        tach=recording.tach[recording.tach["t_s"] >= t].reset_index(drop=True),
        description=recording.description.model_copy(update={"tach": tach}),
    )


def json_lines(recording: Recording) -> bytes:
    """The canonical rows of IMU and tach in the order of time."""
    description = {
        "id": "lines",
        "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]},
        "tach": {"column": "s", "kind": "distance", "unit": "m", "signed": recording.description.tach.signed},
    }
    columns = {"tach": ("t", "s"), "imu": ("t", "wx", "wy", "wz", "fx", "fy", "fz")}
    rows = [
        {"table": table, **dict(zip(names, row, strict=True))}
        for table, names in columns.items()
        for row in getattr(recording, table).to_numpy().tolist()
    ]
    rows.sort(key=lambda row: row["t"])
    return "\n".join(map(json.dumps, [{"description": description}, *rows])).encode()


@pytest.fixture(scope="module")
def run() -> Any:
    return simulate("mainline", seed=3, duration_s=60.0)


@pytest.mark.parametrize(("late_s", "signed"), [(8.0, True), (LATE_S, False)])
def test_a_recording_whose_tach_begins_late(stream: Callable[..., Any], run: Any, late_s: float, signed: bool) -> None:
    ours = stream(with_tach_from(run.recording, late_s, signed=signed), lag_s=5.0)
    (waited,) = [event for event in ours.events if event.kind == "no-speed"]
    assert (waited.t_s, waited.until_s) == (pytest.approx(0.0, abs=0.01), pytest.approx(late_s, abs=0.1))
    assert ours.filtered["t_s"].iloc[0] == pytest.approx(late_s + 10.0, abs=0.1)
    t = ours.smoothed["t_s"]
    for name in ("speed_mps", "roll_rad", "pitch_rad"):
        error = ours.smoothed[name] - np.interp(t, run.truth["t_s"], run.truth[name])
        assert (np.abs(error) < 5.0 * ours.smoothed[f"{name}_sd"]).all(), name


@pytest.mark.parametrize("scenario", ["mainline", "no-stop"])
def test_a_minute_later_it_equals_a_tach_that_was_there(stream: Callable[..., Any], scenario: str) -> None:
    recording = simulate(scenario, seed=3, duration_s=LATE_S + 72.0).recording
    whole, late = (stream(with_tach_from(recording, t), lag_s=5.0) for t in (0.0, LATE_S))
    for table in ("filtered", "smoothed"):
        ours, other = getattr(late, table), getattr(whole, table)
        ours = ours[ours["t_s"] > LATE_S + 60.0]
        assert len(ours) > 20
        for name in ("speed_mps", "roll_rad", "pitch_rad"):
            away = ours[name] - np.interp(ours["t_s"], other["t_s"], other[name])
            assert (np.abs(away) < ours[f"{name}_sd"]).all(), (table, name)


@pytest.mark.parametrize("signed", [False, True])
def test_json_lines_whose_tach_is_absent_at_first(run: Any, signed: bool) -> None:
    late = with_tach_from(run.recording, 20.0, signed=signed)
    late = replace(late, imu=late.imu[late.imu["t_s"] < 40.0])
    source = JsonLinesSource(io.BytesIO(json_lines(late)))
    intake, smoother = Intake.of(source), FixedLagSmoother(source.description, lag_s=5.0)
    pieces: list[Estimates] = [smoother.put(intake.push(batch)[0]) for batch in source]
    assert [event.kind for piece in pieces for event in piece.events].count("no-speed") == 1
    assert sum(len(piece.filtered) for piece in pieces) > 5


def test_with_gnss_the_stream_begins_at_once_and_takes_the_tach_up(stream: Callable[..., Any]) -> None:
    plan = scenario("mainline-gnss")
    run = simulate(replace(plan, driver=replace(plan.driver, start_rest_s=10.0)), seed=3, duration_s=82.0)
    whole, late = (stream(with_tach_from(run.recording, t), lag_s=5.0, config=SmoothConfig()) for t in (0.0, LATE_S))
    assert late.filtered["t_s"].iloc[0] == pytest.approx(10.0, abs=0.1)
    assert not [event for event in late.events if event.kind == "no-speed"]
    ours = late.filtered[late.filtered["t_s"] > LATE_S + 60.0]
    for name in ("speed_mps", "chainage_m", "yaw_rad"):
        away = ours[name] - np.interp(ours["t_s"], whole.filtered["t_s"], whole.filtered[name])
        assert (np.abs(away) < ours[f"{name}_sd"]).all(), name
        assert (
            ours[f"{name}_sd"] < 1.1 * np.interp(ours["t_s"], whole.filtered["t_s"], whole.filtered[f"{name}_sd"])
        ).all()


def test_without_any_speed_there_are_no_estimates_and_an_event_says_so(stream: Callable[..., Any], run: Any) -> None:
    ours = stream(with_tach_from(run.recording, 1e9), lag_s=5.0)
    assert ours.filtered.empty
    (event,) = ours.events
    assert event.kind == "no-speed"
    assert "expected rows of the tach" in event.detail


def test_how_rows_are_grouped_makes_no_difference_to_where_it_begins(stream: Callable[..., Any], run: Any) -> None:
    late = with_tach_from(run.recording, 32.0)
    first, second = (stream(late, lag_s=5.0, batch_s=batch_s).filtered for batch_s in (0.1, 35.0))
    np.testing.assert_array_equal(first.to_numpy(), second.to_numpy())


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("rows", [0, 1])
def test_a_tach_table_that_measures_no_speed_makes_no_wheel(run: Any, rows: int, signed: bool) -> None:
    few = with_tach_from(run.recording, 0.0, signed=signed)
    assert read_wheel(replace(few, tach=few.tach.iloc[:rows]), max_gap_s=0.3) is None
