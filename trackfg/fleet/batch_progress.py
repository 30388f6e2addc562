"""The progress of batches that write to a store: each keeps a small file in it, for whoever looks at the store.

A batch writes its file as runs end, and every :data:`ALIVE_S` at least; it removes the file when it ends. The file of
a batch that was killed stays behind, and is removed by a later batch: the age of its file shows whether a batch
is still running, since the store may be at a URL and the batch on another machine. A file that is read while it is
written, or whose batch was killed then, says nothing. A later batch removes that, too; one that runs writes it again.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from trackfg.errors import TrackfgError
from trackfg.files.small_file import json_of
from trackfg.fleet.places import is_url, joined, matching, read, remove, write

_FOLDER = "progress"

ALIVE_S = 10.0
"""A batch writes its progress at least so often, s."""

_OFTEN_S = 1.0
"""Nor more often than this, s: writing to an object store takes a part of it."""

_LOST_S = 60.0
"""A batch that wrote nothing for so long has ended without saying so, s: six times its longest silence."""

_FAULTS = (OSError, TrackfgError)
"""What reading or writing a file of a store raises. No batch fails because its progress cannot be written."""


@dataclass(frozen=True)
class BatchState:
    """The progress of a batch: of ``runs``, ``done`` are over, ``failed`` of them without a result; times in Unix s."""

    name: str
    began_s: float
    news_s: float
    runs: int
    done: int
    failed: int

    @property
    def runs_per_minute(self) -> float:
        """Return the rate since it began."""
        return 60.0 * self.done / max(self.news_s - self.began_s, 1e-3)

    @property
    def remaining_s(self) -> float | None:
        """Return how long it will take yet at its rate; None before the first run is over."""
        return 60.0 * (self.runs - self.done) / self.runs_per_minute if self.done else None

    def lost(self, now_s: float) -> bool:
        """Return whether it must have ended without saying so."""
        return now_s - self.news_s > _LOST_S


@contextmanager
def shown_progress(store: str, runs: int) -> Iterator[Callable[[int, int], None]]:
    """Show in a store how far a batch is while the block runs; give what takes the numbers of runs over and failed."""
    name = f"{platform.node()}-{os.getpid()}"
    place, began = joined(store, _FOLDER, f"{name}.json"), time.time()
    written = -_OFTEN_S

    def show(done: int, failed: int) -> None:
        nonlocal written
        if time.monotonic() - written < _OFTEN_S:
            return
        written = time.monotonic()
        state = BatchState(name, began, time.time(), runs, done, failed)
        with suppress(*_FAULTS):
            _write(place, json.dumps(asdict(state)).encode() + b"\n")

    for other, state in _states(store):
        if state is None or state.lost(began):
            with suppress(*_FAULTS):
                remove(other)
    show(0, 0)
    try:
        yield show
    finally:
        with suppress(*_FAULTS):
            remove(place)


def batch_states(store: str) -> list[BatchState]:
    """Return the progress of each batch that has a file in a store, that of lost ones too."""
    return [state for _, state in _states(store) if state is not None]


def _states(store: str) -> Iterator[tuple[str, BatchState | None]]:
    """Yield each file of a batch's progress and what it says; None where that is nothing."""
    paths: list[str] = []
    with suppress(*_FAULTS):
        paths = matching(joined(store, _FOLDER), "*.json")
    for place in (joined(store, _FOLDER, path) for path in paths):
        state = None
        with suppress(*_FAULTS, ValueError, TypeError):
            state = BatchState(**json_of(read(place)))
        yield place, state


def _write(place: str, content: bytes) -> None:
    """Write a file where it is to be: what a batch that is killed left beside it, no other batch would replace."""
    if is_url(place):
        write(place, content)
        return
    path = Path(place)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
