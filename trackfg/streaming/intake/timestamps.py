"""Timestamps of raw rows on the clock of the stream.

What a stamp at the start or end of a sampling interval needs, the interval, is taken from the first rows of the IMU,
which wait for it; then it stays, because stamps must not move against each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from trackfg.numerics import spans
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.rows import RowTables, described_tables

INTERVAL_ROWS = 50
"""Rows of which the median interval is taken: it must not hang on a few late stamps."""


class Timestamps:
    """Brings the times of raw rows to the common clock; values stay raw."""

    def __init__(self, description: RecordingDescription) -> None:
        self._parts = described_tables(description)
        self._interval_s = 0.0 if description.imu.stamp == "centre" else None
        self._waiting: list[Array] = []

    def on_common_clock(self, raw: RowTables, *, last: bool = False) -> dict[str, Array]:
        """The rows whose times are known now; ``last`` says that no others will come."""
        tables = {}
        for name, part in self._parts.items():
            rows = raw.get(name)
            if name == "imu" and self._interval_s is None:
                rows = self._first_imu_rows(rows, last=last)
            if rows is None or rows.shape[0] == 0:
                continue
            out = np.array(rows)
            interval = self._interval_s or 0.0
            out[:, 0] = canonical.on_common_clock(part, canonical.seconds(part, rows[:, 0]), interval)
            tables[name] = out
        return tables

    def _first_imu_rows(self, rows: Array | None, *, last: bool) -> Array | None:
        if rows is not None:
            self._waiting.append(rows)
        count = sum(batch.shape[0] for batch in self._waiting)
        if count == 0 or (count < INTERVAL_ROWS and not last):
            return None
        waiting = np.concatenate(self._waiting)
        t = canonical.seconds(self._parts["imu"], waiting[:, 0])
        self._interval_s = spans.median_interval(np.unique(t[np.isfinite(t)]))
        self._waiting = []
        return waiting

    def state(self) -> dict[str, Any]:
        """What carries over to the next batch, as JSON values."""
        return {"interval_s": self._interval_s, "waiting": [_json(rows) for rows in self._waiting]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._interval_s = state["interval_s"]
        self._waiting = [np.array([[float(x) for x in row] for row in rows]) for rows in state["waiting"]]


def _json(rows: Array) -> list[list[float | str]]:
    """These rows have not been looked at yet: what is not finite, JSON knows as text only."""
    return [[x if math.isfinite(x) else repr(x) for x in row] for row in rows.tolist()]
