"""The rows of one table that wait for the watermark."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


class SortedRows:
    """Sorted by time, none twice: of rows with one time the first to arrive stays."""

    def __init__(self, rows: Array | None = None) -> None:
        self._sorted = rows
        self._new: list[Array] = []

    def __len__(self) -> int:
        waiting = 0 if self._sorted is None else len(self._sorted)
        return waiting + sum(len(rows) for rows in self._new)

    def add(self, rows: Array) -> None:
        """Take rows in, in any order."""
        if rows.shape[0]:
            self._new.append(rows)

    def released(self, until_s: float) -> tuple[Array | None, Array]:
        """The rows up to ``until_s``, or None; and the times of the rows that were there already."""
        doubled = self._sort() if self._new else np.empty(0)
        if self._sorted is None:
            return None, doubled
        count = int(np.searchsorted(self._sorted[:, 0], until_s, side="right"))
        if count == 0:
            return None, doubled
        ready, rest = self._sorted[:count], self._sorted[count:]
        self._sorted = rest if rest.shape[0] else None
        return ready, doubled

    def _sort(self) -> Array:
        rows = np.concatenate(self._all())
        self._new = []
        steps = np.diff(rows[:, 0])
        if (steps > 0.0).all():
            self._sorted = rows
            return np.empty(0)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        again = np.concatenate([[False], np.diff(rows[:, 0]) == 0.0])
        self._sorted = rows[~again]
        return np.asarray(rows[again, 0])

    def _all(self) -> list[Array]:
        return self._new if self._sorted is None else [self._sorted, *self._new]

    def to_list(self) -> list[list[float]]:
        """All rows, as JSON values."""
        return [row for rows in self._all() for row in rows.tolist()]
