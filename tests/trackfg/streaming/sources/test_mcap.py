"""MCAP files give the rows that their messages hold, also without their end; nothing else in them does harm."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from trackfg.errors import BadInputError
from trackfg.streaming.sources.mcap import McapSource

DESCRIPTION: dict[str, Any] = {
    "id": "down",
    "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]},
    "tach": {"column": "count", "kind": "distance", "unit": "m"},
}


def imu(i: int) -> dict[str, Any]:
    return {"t": 0.01 * i, "wx": 0.0, "wy": 0.0, "wz": 0.01, "fx": 0.1, "fy": 0, "fz": 9.8}


def mcap(
    messages: list[tuple[str, object]],
    *,
    encoding: str = "json",
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4000,
) -> bytes:
    """A file of messages by topic, objects as JSON."""
    stream = io.BytesIO()
    writer = Writer(stream, compression=compression, chunk_size=chunk_size)
    writer.start()
    channels: dict[str, int] = {}
    for number, (topic, content) in enumerate(messages):
        if topic not in channels:
            channels[topic] = writer.register_channel(topic=topic, message_encoding=encoding, schema_id=0)
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        writer.add_message(channels[topic], log_time=number, data=data, publish_time=number)
    writer.finish()
    return stream.getvalue()


RUN: list[tuple[str, object]] = [
    ("description", DESCRIPTION),
    *(row for i in range(100) for row in (("imu", imu(i)), ("/tach", {"t": 0.01 * i, "count": i}))),
]


def write(folder: Path, content: bytes) -> Path:
    path = folder / "run.mcap"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("compression", list(CompressionType))
def test_messages_are_rows(compression: CompressionType, tmp_path: Path) -> None:
    source = McapSource(write(tmp_path, mcap(RUN, compression=compression)), batch_s=0.1)
    assert source.description.id == "down"
    batches = list(source)
    rows = np.concatenate([batch.tables["imu"] for batch in batches])
    np.testing.assert_array_equal(rows, [list(imu(i).values()) for i in range(100)])
    assert sum(batch.tables["tach"].shape[0] for batch in batches if "tach" in batch.tables) == 100
    assert batches[-1].position == 201
    assert not any(batch.events for batch in batches)
    rest = list(McapSource(tmp_path / "run.mcap", source.description, batch_s=0.1, position=batches[3].position))
    assert [batch.position for batch in rest] == [batch.position for batch in batches[4:]]
    np.testing.assert_array_equal(rest[0].tables["imu"], batches[4].tables["imu"])


def test_bad_messages_and_other_topics_are_events(tmp_path: Path) -> None:
    messages = [*RUN, ("imu", b"\x00\x01"), ("imu", {"t": 3}), ("camera", b"\xff\xd8"), ("camera", b"\xff\xd8")]
    *_, last = McapSource(write(tmp_path, mcap(messages)))
    assert [(event.kind, event.table, event.rows) for event in last.events] == [
        ("bad-message", "", 1),
        ("bad-message", "", 1),
        ("other-topic", "camera", 2),
    ]
    assert last.events[0].detail == "message 202: not JSON; expected one object"
    assert last.events[1].detail.startswith("message 203: imu: no column 'wx'")
    description = McapSource(tmp_path / "run.mcap").description
    *_, last = McapSource(write(tmp_path, mcap(RUN[1:3], encoding="cdr")), description)
    assert "encoded as 'cdr'; expected 'json'" in last.events[0].detail


def test_a_file_without_its_end_gives_what_it_has(tmp_path: Path) -> None:
    content = mcap(RUN, chunk_size=1000)
    description = McapSource(write(tmp_path, content)).description
    for cut in range(2000, len(content) - 400, 501):
        batches = list(McapSource(write(tmp_path, content[:cut]), description))
        rows = sum(table.shape[0] for batch in batches for table in batch.tables.values())
        assert rows > 0
        broken = [event for event in batches[-1].events if event.kind == "broken-input"]
        assert rows == 200 or len(broken) == 1


def test_a_damaged_file_ends_in_an_event_or_one_error(tmp_path: Path) -> None:
    content = bytearray(mcap(RUN, chunk_size=1000))
    description = McapSource(write(tmp_path, bytes(content))).description
    rng, read = np.random.default_rng(1), 0
    for _ in range(150):
        spoilt = bytearray(content)
        for place in rng.integers(0, len(content), 5):
            spoilt[place] = rng.integers(0, 256)
        with contextlib.suppress(BadInputError):
            for batch in McapSource(write(tmp_path, bytes(spoilt)), description, batch_s=0.1):
                assert all(event.detail.isprintable() for event in batch.events)
                read += 1
    assert read > 150


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "expected MCAP"),
        (b"t,wx,wy\n0,1,2\n", "expected MCAP, a folder, or - for JSON lines"),
        (b"t,wx,wy\n0,1,2\n", "no MCAP file; "),
        (b'{"table": "imu", "t": 0}\n', "Hint: for JSON lines, trackfg stream - -o OUT < "),
        (mcap(RUN)[:20], "cannot be read ("),
        (mcap([]), "no messages"),
        (mcap(RUN[1:]), "message 1: topic 'imu'; expected the topic 'description' first"),
        (mcap([("description", b"x")]), "message 1: not JSON"),
        (mcap([("description", {"id": 3})]), "message 1, column 'id': is 3; expected a valid string"),
    ],
)
def test_without_a_description_there_is_one_error(content: bytes, expected: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError) as raised:
        McapSource(write(tmp_path, content))
    assert expected in str(raised.value)


def test_a_missing_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="No such file"):
        McapSource(tmp_path / "none.mcap")


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_does_not_unpack_to_any_size(
    compression: CompressionType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trackfg.streaming.sources.mcap.LARGEST_RECORD", 100_000)
    bomb = mcap([*RUN, ("imu", b" " * 5_000_000)], compression=compression, chunk_size=10_000)
    assert len(bomb) < 100_000
    *_, last = McapSource(write(tmp_path, bomb))
    assert [event.kind for event in last.events] == ["broken-input"]
    assert "unpacks to more than 100000 bytes" in last.events[0].detail
