"""Rows of a run in the order in which they arrive, so that a fault can be put into them, and a source that gives them.

Three forms of one run: ``canonical`` rows; ``raw`` ones, in other units, stamped at the start of their intervals; and
these as ``json`` lines.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import Recording
from trackfg.streaming.rows import raw_columns, recording_rows
from trackfg.streaming.sources.json_lines import JsonLinesSource
from trackfg.streaming.sources.source import BATCH_S, Batch, Source

Form = Literal["canonical", "raw", "json"]


class Arriving(NamedTuple):
    """Rows (n, c) of a table, the first column their stamp, and when they arrive, ``at`` (n,), s."""

    at: Array
    rows: Array

    def take(self, which: np.ndarray) -> Arriving:
        """Some of them."""
        return Arriving(self.at[which], self.rows[which])

    def with_rows(self, rows: Array) -> Arriving:
        """Other rows at the same times."""
        return Arriving(self.at, rows)

    def joined(self, other: Arriving) -> Arriving:
        """With these behind them."""
        return Arriving(np.concatenate([self.at, other.at]), np.concatenate([self.rows, other.rows]))


@dataclass(frozen=True)
class Stream:
    """All tables of a run as they arrive."""

    description: RecordingDescription
    form: Form
    gnss_origin: Array | None
    tables: Mapping[str, Arriving]

    def with_table(self, name: str, table: Arriving) -> Stream:
        """With this table in the place of the one of that name."""
        return replace(self, tables={**self.tables, name: table})

    def source(self, position: int = 0) -> Source:
        """That gives the rows as they arrive, from where it had read so far."""
        if self.form != "json":
            return _Arrivals(self, position)
        source = JsonLinesSource(io.BytesIO(_lines(self)), self.description, position=position)
        source.live = False  # how many keyframes there are must not hang on how busy the machine is
        return source


def stream_of(recording: Recording, form: Form) -> Stream:
    """A recording whose rows arrive at once."""
    tables = {name: rows for name, rows in recording_rows(recording).tables().items() if rows.shape[0]}
    arriving = {name: Arriving(rows[:, 0].copy(), rows) for name, rows in tables.items()}
    stream = Stream(recording.description, form, recording.gnss_origin, arriving)
    return stream if form == "canonical" else _raw(stream)


def _raw(stream: Stream) -> Stream:
    """Degrees, g, stamps at the start of an interval of the IMU, pulses."""
    imu, tach = stream.tables["imu"], stream.tables["tach"]
    interval = float(np.median(np.diff(imu.rows[:, 0])))
    rows = imu.rows.copy()
    rows[:, 0] -= 0.5 * interval
    rows[:, 1:4] = np.degrees(rows[:, 1:4])
    rows[:, 4:7] /= STANDARD_GRAVITY
    given = stream.description
    assert given.tach is not None
    counts = tach.rows.copy()
    counts[:, 1] *= float(given.tach.pulses_per_rev or 1.0) / (np.pi * float(given.tach.wheel_diameter_m or 1.0))
    counts[:, 1] = np.round(counts[:, 1])
    description = given.model_copy(
        update={
            "imu": given.imu.model_copy(update={"stamp": "start", "gyro_unit": "deg/s", "accel_unit": "g"}),
        }
    )
    tables = {**stream.tables, "imu": imu.with_rows(rows), "tach": tach.with_rows(counts)}
    return replace(stream, description=description, tables=tables)


@dataclass(frozen=True)
class _Arrivals:
    """Batches of what arrives within ``BATCH_S``."""

    stream: Stream
    position: int
    live = False
    length = None

    @property
    def description(self) -> RecordingDescription:
        return self.stream.description

    @property
    def canonical(self) -> bool:
        return self.stream.form == "canonical"

    @property
    def gnss_origin(self) -> Array | None:
        return self.stream.gnss_origin if self.canonical else None

    def __iter__(self) -> Iterator[Batch]:
        tables = {name: _in_order(table) for name, table in self.stream.tables.items() if table.at.size}
        begin = min(float(table.at[0]) for table in tables.values())
        end = max(float(table.at[-1]) for table in tables.values())
        edges = begin + BATCH_S * np.arange(1, int((end - begin) / BATCH_S) + 2)
        until = {name: np.searchsorted(table.at, edges) for name, table in tables.items()}
        for i in range(self.position, len(edges)):
            pieces = {name: tables[name].rows[(rows[i - 1] if i else 0) : rows[i]] for name, rows in until.items()}
            yield Batch({name: rows for name, rows in pieces.items() if rows.shape[0]}, position=i + 1)


def _in_order(table: Arriving) -> Arriving:
    return table.take(np.argsort(table.at, kind="stable"))


def _lines(stream: Stream) -> bytes:
    """As they arrive. What is no number, JSON knows as null."""
    columns = raw_columns(stream.description)
    order = np.concatenate([table.at for table in stream.tables.values()])
    lines = [
        json.dumps({"table": name, **dict(zip(columns[name], map(_value, row), strict=True))}).encode() + b"\n"
        for name, table in stream.tables.items()
        for row in table.rows.tolist()
    ]
    return b"".join(lines[i] for i in np.argsort(order, kind="stable"))


def _value(x: float) -> float | None:
    return None if np.isnan(x) else x
