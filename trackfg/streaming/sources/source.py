"""A source is an iterator of batches of rows; a recording can be replayed as one.

Other sources: :mod:`trackfg.streaming.sources.json_lines`, :mod:`trackfg.streaming.sources.mcap`.
"""

from __future__ import annotations

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
STORED_BATCH_S = 1.0
"""Length of a batch of rows that are stored, s: fewer batches cost less."""


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
    """Batches of rows, and their description. ``canonical``: see :mod:`trackfg.streaming.rows`. ``live``: whether rows
    come when they come, and not when they are taken.
    """

    @property
    def description(self) -> RecordingDescription: ...

    @property
    def canonical(self) -> bool: ...

    @property
    def live(self) -> bool: ...

    @property
    def gnss_origin(self) -> Array | None:
        """Origin of canonical rows; None where it is not known, or comes with the first row."""

    def __iter__(self) -> Iterator[Batch]: ...


class RecordingSource:
    """A recording as a stream: each batch holds the rows of ``batch_s`` seconds, of all tables.

    As fast as they are taken, or at ``speed`` times real time: then a batch comes when its last row would have. Batches
    that were not taken in time come at once, until the stream has caught up. ``position`` counts milliseconds from the
    first row.
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

    def __iter__(self) -> Iterator[Batch]:
        start = min(rows[0, 0] for rows in self._tables.values())
        end = max(rows[-1, 0] for rows in self._tables.values())
        began, step = self._clock(), max(round(1e3 * self._batch_s), 1)
        positions = np.arange(self._position, 1e3 * (end - start) + step, step)
        edges = start + 1e-3 * positions
        cuts = {name: np.searchsorted(rows[:, 0], edges, side="left") for name, rows in self._tables.items()}
        for i in range(1, len(edges)):
            tables = {}
            for name, rows in self._tables.items():
                first, last = cuts[name][i - 1], cuts[name][i] if i < len(edges) - 1 else rows.shape[0]
                if last > first:
                    tables[name] = rows[first:last]
            if self._speed is not None:
                wait = i * self._batch_s / self._speed - (self._clock() - began)
                if wait > 0.0:
                    self._sleep(wait)
            yield Batch(tables, position=int(positions[i]))
