"""Raw rows of a stream become what reading the whole recording gives, whatever the description says."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.io.reader import read_recording
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.streaming.checkpoint.snapshot import Snapshot
from trackfg.streaming.events import LossReport
from trackfg.streaming.intake.conversion import Conversion
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.intake.row_checks import RowChecks
from trackfg.streaming.rows import Rows, no_rows, raw_columns, recording_rows
from trackfg.streaming.sources.source import Batch, RecordingSource

Draft = Any


def through_json(state: Snapshot) -> Snapshot:
    return Snapshot(json.loads(json.dumps(state.tree)), state.data)


def joined(batches: Iterable[Rows]) -> Rows:
    """Successive batches as one."""
    batches = list(batches)
    names = dict.fromkeys(name for batch in batches for name in batch.tables())
    tables = {name: np.concatenate([batch.tables().get(name, no_rows(name)) for batch in batches]) for name in names}
    if not batches:
        return Rows()
    origins = [batch.gnss_origin for batch in batches if batch.gnss_origin is not None]
    return Rows.of(tables, batches[-1].until_s, origins[0] if origins else None)


def raw_batches(draft: Draft, description: RecordingDescription, batch_s: float = 0.5) -> Iterator[Batch]:
    """The draft's tables as the sensors send them, each row at its time on the common clock."""
    tables, offsets = {}, {}
    for name, (time, *columns) in raw_columns(description).items():
        frame = draft.tables[draft.toml[name]["file"] if name in draft.toml else draft.toml["laser"][0]["file"]]
        tables[name] = frame[[time, *columns]].to_numpy(dtype=float)
        offsets[name] = draft.toml[name].get("time_offset_s", 0.0) if name in draft.toml else 0.0
    for i in range(round(-4.0 / batch_s), round(155.0 / batch_s) + 1):
        chunk = {name: rows[(rows[:, 0] + offsets[name]) // batch_s == i] for name, rows in tables.items()}
        yield Batch({name: rows for name, rows in chunk.items() if rows.shape[0]}, position=i + 1)


def taken_in(intake: Intake, batches: Iterator[Batch]) -> tuple[Rows, list[Event]]:
    parts, events = [], []
    for batch in batches:
        rows, said = intake.push(batch)
        parts.append(rows)
        events += said
    rows, said = intake.finish()
    return joined([*parts, rows]), [*events, *said]


VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "other units and axes": {
        "imu": {"gyro_unit": "deg/s", "accel_unit": "g", "axes": "FRD", "mount_rpy_deg": [1.0, -2.0, 3.0]}
    },
    "stamps at the end": {"imu": {"stamp": "end"}},
    "own clocks": {"tach": {"time_offset_s": -1.5}, "gnss": {"time_offset_s": 0.125}},
    "speed": {
        "tach": {
            "file": "tach.csv",
            "column": "count",
            "kind": "speed",
            "unit": "km/h",
            "pulses_per_rev": None,
            "wheel_diameter_m": None,
        }
    },
    "local positions": {"gnss": {"frame": "local"}},
    "a chosen origin": {"gnss": {"origin": [35.0, 139.0, 0.0]}},
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_stream_gives_what_reading_gives(variant: str, draft: Draft, tmp_path: Path) -> None:
    for part, changes in VARIANTS[variant].items():
        draft.toml[part] = {k: v for k, v in {**draft.toml[part], **changes}.items() if v is not None}
    if variant == "speed":
        draft["tach"]["count"] = 20.0 + 10.0 * np.sin(draft["tach"]["t"] / 7.0)
        draft["gnss"]["height_m"] += 0.01 * np.arange(len(draft["gnss"]))  # they would be held: the run begins at rest
    if variant == "local positions":
        draft["gnss"][["lat_deg", "lon_deg", "height_m"]] -= [35.2, 139.0, 0.0]
    folder = draft.write(tmp_path / "rec")
    if variant == "other units and axes":
        for columns, factor in ((["wx", "wy", "wz"], 180 / np.pi), (["fx", "fy", "fz"], 1 / 9.80665)):
            draft["imu"][columns] *= np.array([factor, -factor, -factor])
        folder = draft.write(tmp_path / "rec")
    recording = read_recording(folder)
    rows, events = taken_in(Intake.begin(recording.description), raw_batches(draft, recording.description))
    expected = recording_rows(recording)
    assert not events
    assert rows.tables().keys() == expected.tables().keys()
    for name, table in expected.tables().items():
        if name == "gnss" or (name == "imu" and variant == "stamps at the end"):
            np.testing.assert_allclose(rows.tables()[name], table, rtol=0, atol=1e-9)
        else:
            np.testing.assert_array_equal(rows.tables()[name], table)
    if recording.gnss_origin is None:
        assert rows.gnss_origin is None
    else:
        np.testing.assert_array_equal(rows.gnss_origin, recording.gnss_origin)


def test_a_recording_replayed_comes_out_as_it_is(draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(draft.write(tmp_path / "rec"))
    source = RecordingSource(recording)
    intake = Intake.of(source)
    rows, events = taken_in(intake, iter(source))
    assert not events
    for name, table in recording_rows(recording).tables().items():
        np.testing.assert_array_equal(rows.tables()[name], table)
        pd.testing.assert_frame_equal(
            rows.frame(name), pd.DataFrame(table, columns=rows.frame(name).columns), check_exact=True
        )
    assert intake.rows_in == intake.rows_out == len(rows)


@pytest.mark.parametrize("canonical", [True, False])
@pytest.mark.parametrize("cut", [0, 9, 150, 317])
def test_an_intake_goes_on_from_its_state(canonical: bool, cut: int, draft: Draft, tmp_path: Path) -> None:
    draft.toml["imu"]["stamp"] = "start"
    draft["tach"].loc[300:, "count"] -= 100
    description = RecordingDescription.model_validate(draft.toml)
    batches = list(raw_batches(draft, description))
    if canonical:
        del draft.tables["tach.csv"], draft.toml["tach"]
        recording = read_recording(draft.write(tmp_path / "rec"))
        description, batches = recording.description, list(RecordingSource(recording, batch_s=0.5))
    whole = Intake.begin(description, canonical=canonical)
    for batch in batches[:cut]:
        whole.push(batch)
    again = Intake.begin(description, canonical=canonical)
    again.restore(through_json(whole.state()))
    for batch in batches[cut:]:
        (a, said_a), (b, said_b) = whole.push(batch), again.push(batch)
        assert said_a == said_b
        assert a.until_s == b.until_s
        for name, table in a.tables().items():
            np.testing.assert_array_equal(table, b.tables()[name])
    assert whole.finish()[1] == again.finish()[1]


DISTANCE = {"kind": "distance", "unit": "m"}
PULSES = {"kind": "pulses", "pulses_per_rev": 100, "wheel_diameter_m": 1.0 / np.pi}
"""Pulses of 1 cm."""


def checked(
    rows: list[list[float]], *, signed: bool = False, name: str = "tach", counts: dict[str, Any] = DISTANCE
) -> tuple[Array, list[Event]]:
    toml = {
        "id": "x",
        "imu": {"file": "-", "gyro": ["a", "b", "c"], "accel": ["d", "e", "f"]},
        "tach": {"file": "-", "column": "d", "signed": signed, **counts},
    }
    checks, report = RowChecks.of(RecordingDescription.model_validate(toml), CheckLimits()), LossReport()
    out = [checks.sound({name: np.array(rows[i : i + 7])}, report)[name] for i in range(0, len(rows), 7)]
    return np.concatenate(out), list(report.end_of_stream())


def test_one_wrong_count_costs_one_row() -> None:
    for wrong in (-50.0, 5e4):
        rows = [[0.1 * i, 1.0 * i] for i in range(60)]
        rows[30][1] += wrong
        out, events = checked(rows)
        np.testing.assert_array_equal(out, np.delete(np.array(rows), 30, axis=0))
        assert [(event.kind, event.rows, event.t_s) for event in events] == [("tach-jump", 1, 3.0)]


def test_a_counter_that_starts_again_goes_on_where_it_stood() -> None:
    rows = [[0.1 * i, 100.0 + i if i < 30 else 1.0 * (i - 30)] for i in range(80)]
    out, events = checked(rows)
    assert {(event.kind, event.rows) for event in events} == {("tach-jump", 10), ("tach-reset", 0)}
    np.testing.assert_allclose(out[-1], [7.9, 129.0 + 49.0])
    assert (np.diff(out[:, 1]) >= 0).all()


@pytest.mark.parametrize("bits", [16, 24])
@pytest.mark.parametrize("signed", [False, True])
def test_a_count_goes_on_over_the_end_of_its_range(bits: int, signed: bool) -> None:
    """A vehicle at 50 m/s; a signed count has its range about 0, and the vehicle comes back."""
    t = 0.1 * np.arange(400)
    metres = 50.0 * np.minimum(t, 30.0 - 0.5 * t) if signed else 50.0 * t
    count = np.round(100.0 * metres).astype(int) + 2 ** (bits - int(signed)) - 20_000
    seen = (count + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1) if signed else count % 2**bits

    out, events = checked(np.column_stack([t, 0.01 * seen]).tolist(), signed=signed, counts=PULSES)

    assert not events
    np.testing.assert_allclose(out[:, 1] - out[0, 1], 0.01 * (count - count[0]), atol=1e-6)


@pytest.mark.parametrize(("first_m", "back_m"), [(100.0, 130.0), (10_000.0, 655.36)])
def test_a_count_that_loses_its_place_has_not_gone_over_the_end_of_its_range(first_m: float, back_m: float) -> None:
    """It starts again within the range, or was beyond the range by which it falls."""
    rows = [[0.1 * i, first_m + i - (back_m if i >= 30 else 0.0)] for i in range(80)]
    assert {event.kind for event in checked(rows, counts=PULSES)[1]} == {"tach-jump", "tach-reset"}


def test_a_signed_tach_may_roll_back() -> None:
    rows = [[0.1 * i, -1.0 * i] for i in range(40)]
    out, events = checked(rows, signed=True)
    assert not events
    np.testing.assert_array_equal(out, rows)


def test_impossible_sigmas_and_positions_and_speeds_are_reported(draft: Draft) -> None:
    out, events = checked([[0.0, 1.0, 0.0], [1.0, 2.0, 0.5], [2.0, 3.0, -1.0]], name="fixes")
    np.testing.assert_array_equal(out, [[1.0, 2.0, 0.5]])
    assert [(event.kind, event.table, event.rows) for event in events] == [("bad-sigma", "fixes", 2)]

    draft.toml["tach"] = {"file": "tach.csv", "column": "v", "kind": "speed", "unit": "km/h"}
    conversion, report = Conversion(RecordingDescription.model_validate(draft.toml)), LossReport()
    raw = {
        "gnss": np.array([[0.0, 500.0, 139.0, 50.0, 1.0, 1.0, 1.0], [1.0, 35.2, 139.0, 50.0, 1.0, 1.0, 1.0]]),
        "tach": np.array([[0.0, 36.0], [1.0, 36.0], [2.0, -5.0], [3.0, 1e6], [4.0, 36.0]]),
    }
    tables = conversion.converted(raw, report)
    np.testing.assert_allclose(tables["tach"], [[0.0, 0.0], [1.0, 10.0], [4.0, 40.0]])
    np.testing.assert_allclose(conversion.gnss_origin, [35.2, 139.0, 50.0])
    assert {(event.kind, event.rows) for event in report.end_of_stream()} == {("position-range", 1), ("tach-jump", 2)}


def test_speeds_below_the_lowest_that_a_sensor_measures_are_reported(draft: Draft) -> None:
    draft.toml["speed"] = [{"file": "speed.csv", "column": "v", "unit": "m/s", "lowest_mps": 0.5}]
    conversion, report = Conversion(RecordingDescription.model_validate(draft.toml)), LossReport()
    tables = conversion.converted({"speed/1": np.array([[0.0, 0.4], [1.0, 0.6], [2.0, 0.0]])}, report)
    np.testing.assert_allclose(tables["speed/1"], [[1.0, 0.6]])
    assert [(event.kind, event.table, event.rows) for event in report.end_of_stream()] == [("silent", "speed/1", 2)]


def test_speeds_over_ground_of_no_vehicle_are_reported(draft: Draft) -> None:
    draft.toml["speed"] = [{"file": "speed.csv", "column": "v", "unit": "km/h"}]
    draft.toml["gnss_speed"] = {"file": "gnss.csv", "column": "v"}
    conversion, report = Conversion(RecordingDescription.model_validate(draft.toml)), LossReport()
    speeds = np.array([[0.0, 36.0], [1.0, 1e4], [2.0, -36.0]])
    tables = conversion.converted({"speed/1": speeds, "gnss_speed": speeds}, report)
    np.testing.assert_allclose(tables["speed/1"], [[0.0, 10.0]])
    assert tables["gnss_speed"][:, 0].tolist() == [0.0]
    events = {(event.kind, event.table, event.rows) for event in report.end_of_stream()}
    assert events == {("speed-jump", "speed/1", 2), ("speed-jump", "gnss_speed", 2)}
