"""Sections of the runs of a store, read once from their results and kept while the pages are served."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.fleet.freshness import Inputs
from trackfg.fleet.places import PlaceError, local_files
from trackfg.fleet.store import Store
from trackfg.mapping.trends.line_history import joined as joined_series
from trackfg.mapping.trends.line_history import section_table, sections_of_run
from trackfg.mapping.trends.series import Series
from trackfg.results.result import GEOMETRY_FILES, read_geometry
from trackfg.results.summary import Summary

AT_ONCE = 50
"""Results that are read for one request, a second or two; while a page is open it asks on, and the rest are read."""

NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)
"""Stands for the beginning of a run whose recording has none."""
_IDENTITY = ("run", *Inputs._fields)
"""Columns of the catalogue that differ whenever a result does."""

Key = tuple[object, ...]
Row = dict[str, Any]


class StoredSections:
    """Sections of runs by what they were computed from. Requests come in threads: one at a time reads."""

    def __init__(self, store: Store) -> None:
        self._store, self._lock = store, threading.Lock()
        self._runs: dict[Key, Series | None] = {}
        self._lines: dict[str, tuple[tuple[Key, ...], Series, pd.DataFrame]] = {}

    def read(self, rows: Sequence[Row]) -> int:
        """Read results of the catalogue's rows that were not read yet, the newest first; return how many are left."""
        with self._lock:
            unread = [row for row in rows if row["status"] == "done" and _key(row) not in self._runs]
            unread.sort(key=lambda row: row["start"] or NO_DATE, reverse=True)
            for row in unread[:AT_ONCE]:
                self._runs[_key(row)] = self._of_result(row)
            return max(0, len(unread) - AT_ONCE)

    def lines(self, rows: Sequence[Row]) -> dict[str, tuple[Series, pd.DataFrame]]:
        """Return of each line the series of its sections, and a table of them, as far as results were read.

        Runs that know where they are (by a fix, or recognised on a map) count alone where there are any, and likewise
        runs with a date.
        """
        by_line: dict[str, list[Row]] = {}
        for row in rows:
            if self._runs.get(_key(row)) is not None:
                by_line.setdefault(row["line"], []).append(row)
        return {line: self._line(line, by_line[line]) for line in sorted(by_line)}

    def _line(self, line: str, rows: list[Row]) -> tuple[Series, pd.DataFrame]:
        rows = [row for row in rows if row["anchored"] or row["map_recognised_m"]] or rows
        rows = [row for row in rows if row["start"] is not None] or rows
        keys = tuple(sorted((_key(row) for row in rows), key=str))
        with self._lock:
            if line not in self._lines or self._lines[line][0] != keys:
                series = joined_series([run for key in keys if (run := self._runs[key]) is not None])
                self._lines[line] = keys, series, section_table(series)
            return self._lines[line][1:]

    def _of_result(self, row: Row) -> Series | None:
        """Return the sections of a run; None where its result cannot be read, or is shorter than a section."""
        try:
            geometry, summary = geometry_of(self._store, row["run"])
        except (BadInputError, PlaceError):
            return None
        if len(geometry) < 2:
            return None
        sections = sections_of_run(geometry, row["run"], row["start"] or NO_DATE, summary)
        has_values = any(pd.notna(value).any() for value in sections.value.values())
        return sections if has_values else None


def geometry_of(store: Store, run: str) -> tuple[pd.DataFrame, Summary]:
    """Return geometry and summary of a run's result. Raises :class:`BadInputError` or :class:`PlaceError`."""
    with local_files(store.result(run), GEOMETRY_FILES) as folder:
        return read_geometry(folder)


def _key(row: Row) -> Key:
    return tuple(row[name] for name in _IDENTITY)
