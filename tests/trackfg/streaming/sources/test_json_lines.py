"""JSON lines give the rows that they hold; whatever else they hold is an event, and the next line is read."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.checkpoint.checkpoint import Checkpoint
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.json_lines import JsonLinesSource
from trackfg.streaming.sources.source import Batch

DESCRIPTION: dict[str, Any] = {
    "id": "down",
    "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"], "axes": "FLU"},
    "tach": {"column": "count", "kind": "pulses", "pulses_per_rev": 90, "wheel_diameter_m": 0.86},
    "laser": [
        {"name": "a", "column": "z", "unit": "mm", "position_m": [5, 1, 0], "axis": "z", "rail": "left", "sd_m": 1e-4}
    ],
}
IMU = {"table": "imu", "wx": 0.0, "wy": 0.0, "wz": 0.01, "fx": 0.1, "fy": 0, "fz": 9.8}


def imu(i: int) -> dict[str, Any]:
    return {**IMU, "t": 0.01 * i}


def lines(*rows: object) -> bytes:
    """Objects as JSON, text and bytes as they are; each with its end of line."""
    made = [
        row if isinstance(row, bytes) else (row if isinstance(row, str) else json.dumps(row)).encode() for row in rows
    ]
    return b"".join(line + b"\n" for line in made)


def read(content: bytes, **options: Any) -> list[Batch]:
    return list(JsonLinesSource(io.BytesIO(content), **options))


@pytest.mark.parametrize("taken", [1, 3, 30])
def test_lines_of_another_recording_do_not_go_on(taken: int) -> None:
    def feed(wz: float, **others: object) -> io.BytesIO:
        rows = [{**imu(i), "wz": wz if i == 2 else 0.01, **others} for i in range(500)]
        return io.BytesIO(lines({"description": DESCRIPTION}, "noise", *rows))

    source = JsonLinesSource(feed(0.01))
    assert source.first_rows == ""
    position = [batch.position for _, batch in zip(range(taken), source, strict=False)][-1]
    saved = Checkpoint({"recording": source.first_rows}, {}, position)
    sends_its_next_rows = (feed(0.02), 0)
    for stream, start in ((feed(0.01, sent_s=5), position), sends_its_next_rows):
        saved.refuse_others({"recording": JsonLinesSource(stream, position=start).first_rows})
    with pytest.raises(BadInputError, match="made with another recording"):
        saved.refuse_others({"recording": JsonLinesSource(feed(0.02), position=position).first_rows})


def test_rows_come_in_batches_of_the_imus_time() -> None:
    rows = [row for i in range(100) for row in (imu(i), {"table": "tach", "t": 0.01 * i, "count": i, "other": "x"})]
    content = lines({"description": DESCRIPTION}, *rows, {"table": "laser/a", "t": 0.5, "z": -420})
    source = JsonLinesSource(io.BytesIO(content))
    batches = list(source)
    assert source.description.tach is not None
    assert source.description.tach.pulses_per_rev == 90
    assert {batch.tables["imu"].shape[0] for batch in batches[:-1]} <= {11, 12}
    assert batches[-1].position == 202
    np.testing.assert_array_equal(
        np.concatenate([batch.tables["imu"] for batch in batches])[:, 0], 0.01 * np.arange(100)
    )
    np.testing.assert_array_equal(batches[0].tables["imu"][0], [0, 0, 0, 0.01, 0.1, 0, 9.8])
    np.testing.assert_array_equal(batches[-1].tables["laser/a"], [[0.5, -420]])
    assert not any(batch.events for batch in batches)


def test_a_text_stream_and_a_given_description_do_too() -> None:
    description = JsonLinesSource(io.BytesIO(lines({"description": DESCRIPTION}))).description
    (batch,) = JsonLinesSource(io.StringIO(lines(imu(0), imu(1)).decode()), description)
    assert batch.tables["imu"].shape == (2, 7)
    wrapped = io.TextIOWrapper(io.BytesIO(lines(imu(0), b"\xff\xfe", imu(1))))
    (batch,) = JsonLinesSource(wrapped, description)
    assert batch.tables["imu"].shape == (2, 7)
    (batch,) = JsonLinesSource(io.BytesIO(lines({"description": DESCRIPTION}, imu(0))), description)
    assert "another was given" in batch.events[0].detail


def test_a_source_goes_on_where_it_was() -> None:
    content = lines({"description": DESCRIPTION}, *(imu(i) if i % 7 else "rubbish" for i in range(200)))
    batches = read(content)
    for k, batch in enumerate(batches[:-1]):
        rest = read(content, position=batch.position)
        assert [b.position for b in rest] == [b.position for b in batches[k + 1 :]]
        assert [b.events for b in rest] == [b.events for b in batches[k + 1 :]]
        for a, b in zip(rest, batches[k + 1 :], strict=True):
            np.testing.assert_array_equal(a.tables["imu"], b.tables["imu"])


TACH = '{"table": "tach", "t": 0, "count": '
BAD_LINES: dict[str, tuple[str | bytes, str]] = {
    "no JSON": ("t,wx,wy", "not JSON; expected one object"),
    "half an object": ('{"table": "imu", "t": 0.1', "not JSON; expected one object"),
    "binary": (bytes(range(128, 256)) * 10, "not JSON"),
    "zeros": (b"\0" * 1000, "not JSON"),
    "nested without end": ("[" * 100_000, "not JSON"),
    "a number of a million digits": (TACH + "9" * 500_000 + "}", "not JSON"),
    "too long": (TACH + " " * 1_000_000 + "1}", "longer than 1000000 bytes"),
    "far too long": (b"x" * 5_000_000, "longer than 1000000 bytes"),
    "a list": ("[1, 2, 3]", "is no object; expected one"),
    "no table": ('{"t": 0.1, "wx": 0}', 'no "table"; expected {"table": "imu", ...}'),
    "a table that is no name": ('{"table": ["imu"]}', 'no "table"'),
    "an unknown table": ('{"table": "gyro", "t": 0}', "table 'gyro': expected one of imu, tach, laser/a"),
    "a misspelt table": ('{"table": "tahc", "t": 0}', "did you mean 'tach'?"),
    "an undescribed table": (
        '{"table": "fixes", "t": 0, "chainage_m": 3, "sd_m": 1}',
        "table 'fixes': expected one of",
    ),
    "a missing column": ('{"table": "tach", "t": 0}', "tach: no column 'count'; expected t, count"),
    "no time": ('{"table": "tach", "count": 1}', "tach: no column 't'"),
    "text for a number": (TACH + '"12"}', "tach: 'count' is '12'; expected a number"),
    "true for a number": (TACH + "true}", "tach: 'count' is True; expected a number"),
    "a list for a number": (TACH + "[1]}", "tach: 'count' is [1]; expected a number"),
    "a description later": (
        json.dumps({"description": DESCRIPTION}),
        'no "table" but a description; expected it before',
    ),
    "escapes for the terminal": ('{"table": "\\u001b[2J"}', "'\\x1b[2J': expected"),
}


@pytest.mark.parametrize("case", BAD_LINES)
def test_a_bad_line_is_one_event_and_the_next_line_is_read(case: str) -> None:
    line, expected = BAD_LINES[case]
    (batch,) = read(lines({"description": DESCRIPTION}, imu(0), line, imu(1)))
    (event,) = batch.events
    assert (event.kind, event.rows) == ("bad-line", 1)
    assert event.detail.startswith("line 3: ")
    assert expected in event.detail
    assert event.detail.isprintable()
    assert len(event.detail) < 300
    assert batch.tables["imu"].shape[0] == 2
    assert batch.position == 4


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "null", "1e999", "1" + "0" * 400])
def test_values_that_are_missing_or_no_quantity_are_rows_for_the_report(value: str) -> None:
    source = JsonLinesSource(io.BytesIO(lines({"description": DESCRIPTION}, *map(imu, range(40)), TACH + value + "}")))
    intake = Intake.begin(source.description)
    events = [event for batch in source for event in intake.push(batch)[1]]
    rows, last = intake.finish()
    assert [(event.kind, event.table, event.rows) for event in [*events, *last]] == [("not-finite", "tach", 1)]
    assert rows.tach.shape == (0, 2)


def test_bad_lines_of_one_kind_are_counted_together() -> None:
    (batch,) = read(lines({"description": DESCRIPTION}, imu(0), *["x"] * 50, '{"table": "tach"}', imu(1)))
    first, second = batch.events
    assert (first.rows, second.rows) == (50, 1)
    assert first.detail == "line 3: not JSON; expected one object (50 such, the last is line 52)"


def test_a_fault_that_lasts_is_an_event_at_once_and_then_one_in_many_batches() -> None:
    rows = [row for i in range(600) for row in (imu(i), {"table": "tach", "t": str(i), "count": 1}, '{"table": "x"}')]
    source = JsonLinesSource(io.BytesIO(lines({"description": DESCRIPTION}, *rows)))
    intake = Intake.begin(source.description)
    batches = [intake.push(batch)[1] for batch in source]
    assert [event.rows for event in batches[0]] == [10, 10]
    assert not any(batches[1:])
    _, rest = intake.finish()
    assert [event.rows for event in rest] == [590, 590]
    assert rest[0].detail == ("line 33: tach: 't' is '10'; expected a number (590 such, the last is line 1800)")


def test_empty_lines_hold_nothing() -> None:
    (batch,) = read(b"\n  \n" + lines({"description": DESCRIPTION}, "", imu(0), "   ", imu(1), b"\t\r"))
    assert batch.tables["imu"].shape[0] == 2
    assert not batch.events


def test_an_end_within_a_line_is_no_crash() -> None:
    content = lines({"description": DESCRIPTION}, imu(0), imu(1))
    for cut in range(len(lines({"description": DESCRIPTION}, imu(0))), len(content)):
        (batch,) = read(content[:cut])
        whole = batch.tables["imu"].shape[0]
        assert whole + sum(event.rows for event in batch.events) in (1, 2)
        if batch.events:
            assert batch.events[0].detail == "line 3: the input ends within the line"


@pytest.mark.parametrize(
    ("first", "expected"),
    [
        (b"", "the stream is empty; expected"),
        (b"\n\n", "the stream is empty"),
        (lines(imu(0)), "line 1: no description; expected"),
        (b"\x00\xff\n", "line 1: not JSON"),
        (lines({"description": 3}), "line 1: the description is no object"),
        (lines({"description": {"id": "x"}}), "required key is missing"),
        (lines({"description": {**DESCRIPTION, "imu": {**DESCRIPTION["imu"], "axes": "FFF"}}}), "imu.axes"),
        (lines({"description": {**DESCRIPTION, "velocity": 3}}), "unknown key"),
        (lines({"description": {**DESCRIPTION, "laser": {"name": "a"}}}), "laser"),
        (lines({"description": {**DESCRIPTION, "format": "trackfg-recording/2"}}), "format"),
    ],
)
def test_without_a_description_there_is_one_error(first: bytes, expected: str) -> None:
    with pytest.raises(BadInputError) as raised:
        JsonLinesSource(io.BytesIO(first))
    assert expected in str(raised.value)


def test_no_file_of_a_description_is_opened() -> None:
    """Its name is kept, and that is all."""
    given = {**DESCRIPTION, "imu": {**DESCRIPTION["imu"], "file": "/etc/passwd"}}
    source = JsonLinesSource(io.BytesIO(lines({"description": given}, imu(0))))
    assert source.description.imu.file == "/etc/passwd"
    (batch,) = source
    assert not batch.events


@given(st.binary(max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_bytes_are_read_to_their_end(content: bytes) -> None:
    description = RecordingDescription.model_validate(
        {**DESCRIPTION, "imu": {**DESCRIPTION["imu"], "file": "-"}, "tach": None, "laser": []}
    )
    batches = read(content, description=description)
    assert batches[-1].position == len(content.splitlines(keepends=True)) or b"\r" in content or not content.isascii()


@given(
    st.lists(
        st.dictionaries(
            st.sampled_from(["table", "t", "count", "wx", "wy", "wz", "fx", "fy", "fz", "z"]),
            st.one_of(
                st.none(),
                st.booleans(),
                st.integers(),
                st.floats(),
                st.text(max_size=5),
                st.just("tach"),
                st.just("imu"),
            ),
        ),
        max_size=40,
    )
)
@settings(max_examples=100, deadline=None)
def test_any_objects_become_rows_or_events(rows: list[dict[str, Any]]) -> None:
    source = JsonLinesSource(io.BytesIO(lines({"description": DESCRIPTION}, *rows)))
    intake, bad, events = Intake.begin(source.description), 0, []
    for batch in source:
        bad += sum(event.rows for event in batch.events)
        events += intake.push(batch)[1]
    events += intake.finish()[1]
    assert intake.rows_in + bad == len(rows)
    assert intake.rows_out + sum(event.rows for event in events) == len(rows)


def test_a_known_line_is_refused() -> None:
    with_line = {**DESCRIPTION, "known_line": {"file": "net.geojson"}}
    with pytest.raises(BadInputError, match=r"a stream uses none.*trackfg smooth"):
        _ = JsonLinesSource(io.BytesIO(lines({"description": with_line}))).description
