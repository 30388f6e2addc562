"""Timestamps of raw rows are brought to the clock of the stream.

A stamp at the start or end of a sampling interval is moved to its centre. The interval is the median over the first
rows of the IMU, which wait for it; then it is kept, because stamps must not move against each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics import spans
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.rows import RowTables, described_tables

INTERVAL_ROWS = 50
"""Rows over which the median interval is taken: a few late stamps must not decide it."""


@dataclass
class Timestamps:
    """Brings the times of raw rows to the common clock; values stay raw. ``interval_s``: None until it is known."""

    description: RecordingDescription
    interval_s: float | None
    waiting: list[Array] = field(default_factory=list)

    @classmethod
    def of(cls, description: RecordingDescription) -> Timestamps:
        """Return the stage before the first row."""
        return cls(description, 0.0 if description.imu.stamp == "centre" else None)

    def on_common_clock(self, raw: RowTables, *, last: bool = False) -> dict[str, Array]:
        """Return the rows whose times are known now; ``last``: no others will come."""
        tables = {}
        for name, part in described_tables(self.description).items():
            rows = raw.get(name)
            if name == "imu" and self.interval_s is None:
                rows = self._first_imu_rows(rows, last=last)
            if rows is None or rows.shape[0] == 0:
                continue
            out = np.array(rows)
            interval = self.interval_s or 0.0
            out[:, 0] = canonical.on_common_clock(part, canonical.seconds(part, rows[:, 0]), interval)
            tables[name] = out
        return tables

    def _first_imu_rows(self, rows: Array | None, *, last: bool) -> Array | None:
        if rows is not None:
            self.waiting.append(rows)
        count = sum(batch.shape[0] for batch in self.waiting)
        if count == 0 or (count < INTERVAL_ROWS and not last):
            return None
        waiting = np.concatenate(self.waiting)
        t = canonical.seconds(self.description.imu, waiting[:, 0])
        self.interval_s = spans.median_interval(np.unique(t[np.isfinite(t)]))
        self.waiting = []
        return waiting
