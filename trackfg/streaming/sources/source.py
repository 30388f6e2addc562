"""A source is an iterator of batches of rows; a recording can be replayed as one.

Other sources: :mod:`trackfg.streaming.sources.json_lines`, :mod:`trackfg.streaming.sources.mcap`.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import Recording
from trackfg.results.events import Event
from trackfg.streaming.rows import recording_rows

BATCH_S = 0.1
"""Length of a batch of rows that are waited for, s."""
COMPARED_ROWS = 100
"""First rows of each table, or first lines, that identify a recording: no two have the same noise."""
STORED_BATCH_S = 20.0
"""Length of a batch of rows that are stored, s: fewer batches cost less, and a page still shows them go by, some ten a
second.
"""


@dataclass(frozen=True)
class Batch:
    """Rows by table as they arrived, and what the source itself could not read.

    ``position`` counts what the source has read so far (lines, messages, batches): a source opened at this position
    goes on with the batch after this one.
    """

    tables: Mapping[str, Array] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    position: int = 0


class Source(Protocol):
    """A source hands out batches of rows, and says what they are."""

    @property
    def description(self) -> RecordingDescription:
        """Sensors and columns of the rows."""

    @property
    def canonical(self) -> bool:
        """True where rows are canonical (:mod:`trackfg.streaming.rows`), not as the sensors send them."""

    @property
    def live(self) -> bool:
        """True where rows come when they come, and not when they are taken."""

    @property
    def length(self) -> int | None:
        """The position at the end, where it is known."""

    @property
    def gnss_origin(self) -> Array | None:
        """Origin of canonical rows; None where it is not known, or comes with the first row."""

    @property
    def first_rows(self) -> str:
        """A digest of the source's first rows, which identifies the recording; empty where it is not known."""

    def __iter__(self) -> Iterator[Batch]: ...


class RecordingSource:
    """A recording as a stream: each batch holds the rows of ``batch_s`` seconds, of all tables.

    As fast as they are taken, or at ``speed`` times real time: then a batch comes when its last row would have. Batches
    that were not taken in time come at once, until the stream has caught up. A time without rows has no batch.
    ``position`` counts milliseconds from the first row.
    """

    canonical = True

    def __init__(
        self,
        recording: Recording,
        *,
        batch_s: float | None = None,
        speed: float | None = None,
        position: int = 0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.description = recording.description
        self.gnss_origin = recording.gnss_origin
        self._tables = {name: rows for name, rows in recording_rows(recording).tables().items() if rows.shape[0]}
        self._batch_s = batch_s or (STORED_BATCH_S if speed is None else BATCH_S)
        self._speed, self._position = speed, position
        self._clock, self._sleep = clock, sleep
        self.live = speed is not None
        first = b"".join(name.encode() + rows[:COMPARED_ROWS].tobytes() for name, rows in self._tables.items())
        self.first_rows = hashlib.sha256(first).hexdigest()
        times = np.concatenate([rows[:, 0] for rows in self._tables.values()])
        self.length = round(1e3 * float(np.ptp(times)))

    def __iter__(self) -> Iterator[Batch]:
        start = min(rows[0, 0] for rows in self._tables.values())
        began, positions = self._clock(), self._positions(start)
        edges = start + 1e-3 * positions
        cuts = {name: np.searchsorted(rows[:, 0], edges, side="left") for name, rows in self._tables.items()}
        for i in range(1, len(edges)):
            tables = {}
            for name, rows in self._tables.items():
                first, last = cuts[name][i - 1], cuts[name][i] if i < len(edges) - 1 else rows.shape[0]
                if last > first:
                    tables[name] = rows[first:last]
            if self._speed is not None:
                wait = 1e-3 * (positions[i] - positions[0]) / self._speed - (self._clock() - began)
                if wait > 0.0:
                    self._sleep(wait)
            yield Batch(tables, position=int(positions[i]))

    def _positions(self, start: float) -> Array:
        """Return where the first batch begins and where each one ends, ms from the first row at ``start``, s.

        There is a batch only where there are rows: a row of another clock may be years away.
        """
        step = max(round(1e3 * self._batch_s), 1)
        t = 1e3 * (np.concatenate([rows[:, 0] for rows in self._tables.values()]) - start) - self._position
        number = np.unique(np.minimum(np.floor(t / step), np.ceil(t.max() / step) - 1.0))
        return self._position + step * np.append(0.0, number[number >= 0.0] + 1.0)
