"""A stream goes on from its checkpoint as if it had not been killed; a checkpoint that cannot be used is refused."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import os
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError, OutputError
from trackfg.recording.model import Recording
from trackfg.streaming.checkpoint import checkpoint
from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.run import Stream
from trackfg.streaming.sinks.parquet_parts import NOTHING_WRITTEN, ParquetParts, read_parts
from trackfg.streaming.sinks.sink import TABLES
from trackfg.streaming.sources.json_lines import JsonLinesSource
from trackfg.streaming.sources.mcap import McapSource
from trackfg.streaming.sources.source import RecordingSource, Source

Opened = Callable[[int], Source]
"""A source from a position on."""

LAG_S = 5.0


class KilledError(Exception):
    """The process ends here."""


class Killing(Checkpoints):
    """Checkpoints at some times of the stream, and an end without warning: at a time, or as its last act."""

    def __init__(self, path: Path, at_s: Collection[float], killed_s: float) -> None:
        super().__init__(path)
        self._at_s, self._killed_s, self._since_s = at_s, killed_s, -np.inf

    def read(self) -> Checkpoint:
        saved = super().read()
        self._since_s = -np.inf if saved.until_s is None else saved.until_s
        return saved

    def due(self, until_s: float) -> bool:
        if until_s >= self._killed_s:
            raise KilledError
        due = any(self._since_s < t <= until_s for t in self._at_s)
        self._since_s = until_s
        return due

    def write(self, checkpoint: Checkpoint) -> None:
        if checkpoint.finished:
            raise KilledError
        super().write(checkpoint)


def stream_of(source: Source, saved: Checkpoint | None = None) -> Stream:
    return Stream.of(source, FixedLagSmoother(source.description, lag_s=LAG_S), saved)


def undisturbed(folder: Path, opened: Opened) -> dict[str, bytes]:
    stream_of(opened(0)).run(ParquetParts(folder, rows_per_part=100))
    return contents(folder)


def killed(folder: Path, opened: Opened, *, at_s: Collection[float], kills_s: Collection[float]) -> dict[str, bytes]:
    """Checkpoints at some times, killed at some others and at the very end, then left alone."""
    path = folder.with_suffix(".checkpoint")
    Checkpoints(path).write(Checkpoint(stream_of(opened(0)).settings, NOTHING_WRITTEN))
    for kill_s in [*sorted(kills_s), np.inf]:
        checkpoints = Killing(path, at_s, kill_s)
        saved = checkpoints.read()
        stream, sink = (
            stream_of(opened(saved.position), saved),
            ParquetParts(folder, rows_per_part=100, state=saved.sink),
        )
        with pytest.raises(KilledError):
            stream.run(sink, checkpoints)
    saved = Checkpoints(path).read()
    counts = stream_of(opened(saved.position), saved).run(ParquetParts(folder, rows_per_part=100, state=saved.sink))
    assert counts.keyframes == len(read_parts(folder, "filtered"))
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for name in TABLES for path in (folder / name).iterdir()}


@pytest.fixture(scope="module")
def recording() -> Recording:
    """It stands for 30 s."""
    return simulate("mainline", seed=3, duration_s=60.0).recording


@pytest.fixture(scope="module")
def replayed(recording: Recording) -> Opened:
    return lambda position: RecordingSource(recording, batch_s=0.5, position=position)


@pytest.fixture(scope="module")
def whole(replayed: Opened, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return undisturbed(tmp_path_factory.mktemp("whole"), replayed)


def test_before_the_first_window_at_rest_and_at_the_end(
    replayed: Opened, whole: dict[str, bytes], tmp_path: Path
) -> None:
    assert killed(tmp_path / "out", replayed, at_s=[5.0, 20.0, 59.6], kills_s=[3.0, 9.0, 22.0]) == whole
    assert len(whole) > 15


@pytest.mark.parametrize("seed", range(2))
def test_at_any_moment(seed: int, replayed: Opened, whole: dict[str, bytes], tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    at_s, kills_s = rng.uniform(0.0, 60.0, 8), rng.uniform(0.0, 60.0, 3)
    assert killed(tmp_path / "out", replayed, at_s=at_s.tolist(), kills_s=kills_s.tolist()) == whole


def messages(recording: Recording) -> list[tuple[str, dict[str, Any]]]:
    """Rows as sensors send them, one of them nonsense now and then, and some of a table that nobody described."""
    names = ("t", "wx", "wy", "wz", "fx", "fy", "fz")
    keyed = [(row[0], "imu", dict(zip(names, row, strict=True))) for row in recording.imu.to_numpy()[::2].tolist()]
    assert recording.tach is not None
    keyed += [(row[0] + 0.01, "tach", {"t": row[0], "s": row[1]}) for row in recording.tach.to_numpy().tolist()]
    keyed += [(t, "door", {"open": 1}) for t in np.arange(0.2, 25.0, 1.0).tolist()]
    keyed += [(t, "imu", {"t": t}) for t in (4.1, 11.3, 18.2)]
    return [(table, row) for _, table, row in sorted(keyed, key=lambda one: one[0])]


DESCRIPTION = {
    "id": "rows",
    "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]},
    "tach": {"column": "s", "kind": "distance", "unit": "m", "signed": True},
}


def json_lines(rows: list[tuple[str, dict[str, Any]]], folder: Path) -> Opened:
    lines = [{"description": DESCRIPTION}, *({"table": table, **row} for table, row in rows)]
    text = "\n".join(map(json.dumps, lines)).encode()
    return lambda position: JsonLinesSource(io.BytesIO(text), position=position)


def mcap(rows: list[tuple[str, dict[str, Any]]], folder: Path) -> Opened:
    with (folder / "rows.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        topics = {
            topic: writer.register_channel(topic=topic, message_encoding="json", schema_id=0)
            for topic in ("description", "imu", "tach", "door")
        }
        for number, (topic, row) in enumerate([("description", DESCRIPTION), *rows]):
            data = json.dumps(row).encode()
            writer.add_message(topics[topic], log_time=number, data=data, publish_time=number)
        writer.finish()
    return lambda position: McapSource(folder / "rows.mcap", position=position)


@pytest.mark.parametrize(("kind", "counted"), [(json_lines, "bad-line"), (mcap, "other-topic")])
def test_rows_that_are_sent_again(kind: Callable[..., Opened], counted: str, tmp_path: Path) -> None:
    opened = kind(messages(simulate("trolley", seed=0, duration_s=25.0).recording), tmp_path)
    whole = undisturbed(tmp_path / "whole", opened)
    assert killed(tmp_path / "out", opened, at_s=[4.05, 19.0], kills_s=[6.0, 22.0]) == whole
    events = read_parts(tmp_path / "out", "events")
    assert events.loc[events["kind"] == counted, "rows"].sum() >= 25


@pytest.fixture(scope="module")
def saved(recording: Recording) -> Checkpoint:
    """Of a stream that has moved on by 15 s."""
    source = RecordingSource(recording, batch_s=0.5)
    stream = stream_of(source)
    for batch in source:
        stream.smoother.put(stream.intake.push(batch)[0])
        if batch.position == 15_000:
            break
    settings = {**stream.settings}
    return Checkpoint(
        settings, NOTHING_WRITTEN, 15_000, stream.intake.state(), stream.smoother.state(), 14.8, 5, {"gap": 1}
    )


@pytest.fixture(scope="module")
def content(saved: Checkpoint) -> bytes:
    return b"".join(saved.to_bytes())


def test_a_file_holds_a_checkpoint(saved: Checkpoint, content: bytes) -> None:
    again = Checkpoint.from_bytes(content)
    assert again.smoother is not None
    assert b"".join(again.to_bytes()) == content
    assert again.events == {"gap": 1}


@given(data=st.data())
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damage_is_found(content: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(content) - 1))
    flipped = bytearray(content)
    flipped[at] ^= data.draw(st.integers(1, 255))
    for damaged in (content[:at], bytes(flipped), content + b"\n", content[at:] if at else b""):
        with pytest.raises(BadInputError, match=r"damaged|expected the checkpoint of a stream"):
            Checkpoint.from_bytes(damaged)


def sealed(text: bytes) -> bytes:
    return text + hashlib.sha256(text).digest()


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_wrong_types_are_refused(
    content: bytes, replayed: Opened, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Although the digest is right."""
    head, text, numbers = content[:-32].split(b"\n", 2)
    values = json.loads(text)
    parent: Any = values
    key = data.draw(st.sampled_from(sorted(values)))
    while isinstance(parent[key], dict | list) and parent[key] and data.draw(st.integers(0, 3)):
        parent = parent[key]
        key = data.draw(st.sampled_from(sorted(parent) if isinstance(parent, dict) else range(len(parent))))
    parent[key] = data.draw(st.sampled_from([None, True, -1, 10**30, 0.5, "text", [], {}, [[[]]], {"a": 1}]))
    changed = sealed(b"\n".join([head, json.dumps(values).encode(), numbers]))
    with contextlib.suppress(BadInputError):
        again = Checkpoint.from_bytes(changed)
        stream_of(replayed(again.position), again)
        ParquetParts(tmp_path_factory.mktemp("parts"), state=again.sink)


def test_another_version_is_refused(content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "__version__", "99.0")
    with pytest.raises(BadInputError, match=r"written by trackfg .*, this is 99\.0"):
        Checkpoint.from_bytes(content)


def test_another_format_is_refused_by_its_name(content: bytes) -> None:
    older = content[:-32].replace(b"trackfg-checkpoint/9", b"trackfg-checkpoint/8", 1)
    with pytest.raises(BadInputError, match=r"format trackfg-checkpoint/8; expected trackfg-checkpoint/9"):
        Checkpoint.from_bytes(older + hashlib.sha256(older).digest())


def test_other_settings_are_refused(saved: Checkpoint, recording: Recording) -> None:
    source, description = RecordingSource(recording, position=15_000), recording.description
    other = description.model_copy(update={"id": "another"})
    config = SmoothConfig.model_validate({"output": {"rate_hz": 5.0}})
    rows = JsonLinesSource(io.BytesIO(), description)
    again = replace(simulate("mainline", seed=3, run=1, duration_s=30.0).recording, description=description)
    for opened, smoother, named in (
        (source, FixedLagSmoother(description, lag_s=6.0), "lag"),
        (source, FixedLagSmoother(description, config, lag_s=LAG_S), "configuration"),
        (source, FixedLagSmoother(other, lag_s=6.0), "description, lag"),
        (rows, FixedLagSmoother(description, lag_s=LAG_S), "source"),
        (RecordingSource(again), FixedLagSmoother(description, lag_s=LAG_S), "recording"),
    ):
        with pytest.raises(BadInputError, match=f"was made with another {named};"):
            Stream.of(opened, smoother, saved)


def test_a_full_disk_keeps_the_last_checkpoint(
    saved: Checkpoint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoints = Checkpoints(tmp_path / "checkpoint")
    checkpoints.write(saved)

    def full_disk(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as full:
        full.setattr(os, "fsync", full_disk)
        with pytest.raises(OutputError, match=r"checkpoint: cannot be written \(No space left on device\)"):
            checkpoints.write(Checkpoint(saved.settings, NOTHING_WRITTEN))
    assert checkpoints.read().position == 15_000
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint"]


def test_checkpoints_of_stored_rows_are_five_seconds_apart(tmp_path: Path) -> None:
    now_s = [100.0]
    usual = Checkpoints(tmp_path / "checkpoint", clock=lambda: now_s[0])
    given = Checkpoints(tmp_path / "checkpoint", every_s=60.0, clock=lambda: now_s[0])
    assert not usual.due(0.0)
    assert not given.due(0.0)
    now_s[0] += 4.9
    assert not usual.due(60.0)
    assert given.due(60.0)
    now_s[0] += 0.2
    assert usual.due(61.0)
    now_s[0] += 9.0
    assert not usual.due(120.0)


def test_no_checkpoint_is_said(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="nowhere: expected the checkpoint of a stream: No such file"):
        Checkpoints(tmp_path / "nowhere").read()


@pytest.mark.parametrize("every_s", [0.0, -1.0, np.nan, np.inf])
def test_a_checkpoint_needs_a_time(every_s: float, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="expected more than 0 s"):
        Checkpoints(tmp_path / "checkpoint", every_s=every_s)


@pytest.mark.slow
def test_checkpoints_do_not_grow(tmp_path: Path) -> None:
    sizes: list[int] = []

    class Measured(Checkpoints):
        def write(self, checkpoint: Checkpoint) -> None:
            super().write(checkpoint)
            if not checkpoint.finished and checkpoint.until_s is not None and checkpoint.until_s > 40.0:
                sizes.append(self.path.stat().st_size)

    source = RecordingSource(simulate("shuttle", seed=1, duration_s=130.0).recording, batch_s=5.0)
    stream_of(source).run(ParquetParts(tmp_path), Measured(tmp_path / "checkpoint", every_s=9.0))
    assert len(sizes) >= 9
    assert max(sizes) < 2.0 * min(sizes) < 3e6
