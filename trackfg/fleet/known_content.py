"""Known content of files is kept, so that those that did not change are not read again.

Files count as unchanged while their names, sizes, times and inodes are the same; those at a URL, while what their
server says of them is the same. Among the times is that of the last change of status, which no program can set, so a
file that was replaced by one of the same size and date counts as changed. Two changes in one tick of a file system's
clock look like one, hence nothing is kept of a file that changed just now. All of this is a cache: where it is lost or
cannot be written, files are read.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trackfg.fleet.places import is_url, signature

_TICK_S = 2.0
"""Longest tick of the clock of a file system in use, s (FAT)."""

_TABLE = (
    "CREATE TABLE IF NOT EXISTS known (place TEXT PRIMARY KEY, folder TEXT, names TEXT, signature TEXT, content TEXT)"
)


@dataclass(frozen=True)
class Sight:
    """Files of a folder as they were at one moment; ``signature`` is None where one is missing or changed just then.

    ``place`` is what they are the content of.
    """

    place: str
    folder: str
    names: tuple[str, ...]
    signature: str | None


def sight(place: str | Path, folder: str | Path, names: Sequence[str]) -> Sight:
    """Look at the files that are the content of a place, without opening them."""
    return Sight(os.fspath(place), os.fspath(folder), tuple(names), _signature(os.fspath(folder), names))


def _signature(folder: str, names: Sequence[str]) -> str | None:
    if is_url(folder):
        return signature(folder, names)
    now, parts = time.time(), []
    for name in names:
        try:
            status = os.stat(os.path.join(folder, name))
        except (OSError, ValueError):
            return None
        if max(status.st_mtime, status.st_ctime) > now - _TICK_S:
            return None
        parts.append(f"{status.st_size} {status.st_mtime_ns} {status.st_ctime_ns} {status.st_ino}")
    return ";".join(parts)


class KnownContent:
    """Texts about the content of files, by place, kept in a file of SQLite; in memory alone for ``path`` None."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._known: dict[str, tuple[str, str, str, str]] = {}
        self._new: set[str] = set()
        if path is not None and path.exists():
            with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(path)) as connection:
                rows = connection.execute("SELECT place, folder, names, signature, content FROM known")
                self._known = {place: tuple(values) for place, *values in rows}

    def recall(self, place: str | Path) -> str | None:
        """Return what is known of the files of a place if they are as they were; else None."""
        folder, names, signature, content = self._known.get(os.fspath(place), ("", "[]", "", ""))
        return content if signature and _signature(folder, json.loads(names)) == signature else None

    def remember(self, seen: Sight, content: str) -> None:
        """Keep what was read from files since they were looked at."""
        if seen.signature is not None:
            self._known[seen.place] = (seen.folder, json.dumps(seen.names), seen.signature, content)
            self._new.add(seen.place)

    def save(self) -> None:
        """Write what was remembered since the last time, beside what other processes wrote."""
        if self._path is None or not self._new:
            return
        rows = [(place, *self._known[place]) for place in sorted(self._new)]
        with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(self._path)) as connection:
            with connection:
                connection.execute(_TABLE)
                connection.executemany("INSERT OR REPLACE INTO known VALUES (?, ?, ?, ?, ?)", rows)
            self._new.clear()
