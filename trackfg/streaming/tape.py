"""The rows of a stream that are still needed, and the recording that a stretch of them makes.

Inertial samples become intervals edge to edge as they come (:mod:`trackfg.inertial`); the newest one waits until the
next tells where its own interval ends. How rows were grouped on their way makes no difference.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from trackfg.description import RecordingDescription
from trackfg.frames import Array
from trackfg.inertial import Intervals, laid_out
from trackfg.recording import IMU_COLUMNS, TACH_COLUMNS, Recording

_NO_SAMPLES = pd.DataFrame(columns=list(IMU_COLUMNS), dtype=np.float64)
_FIRST_SAMPLES = 10
"""As many tell the sampling interval."""


@dataclass
class Tape:
    """``dt`` is the sampling interval, s; None until enough samples are there."""

    description: RecordingDescription
    gnss_origin: Array | None = None
    dt: float | None = None
    data: Intervals | None = None
    waiting: Array = field(default_factory=lambda: np.zeros((0, len(IMU_COLUMNS))))
    """Samples not laid out yet, as rows of the recording's columns."""
    samples: Array = field(default_factory=lambda: np.zeros((0, len(IMU_COLUMNS))))
    """Those laid out."""
    tach: Array = field(default_factory=lambda: np.zeros((0, len(TACH_COLUMNS))))
    positions: dict[str, pd.DataFrame] = field(default_factory=dict)
    """By table: ``fixes`` and ``gnss``."""

    def put(
        self,
        imu: Array | None = None,
        tach: Array | None = None,
        fixes: pd.DataFrame | None = None,
        gnss: pd.DataFrame | None = None,
    ) -> None:
        """Append rows, each table in order of time: arrays with the columns of the recording, or tables."""
        if tach is not None and len(tach):
            self.tach = np.concatenate([self.tach, tach])
        for name, table in (("fixes", fixes), ("gnss", gnss)):
            if table is not None and len(table):
                known = self.positions.get(name)
                self.positions[name] = table if known is None else pd.concat([known, table], ignore_index=True)
        if imu is not None and len(imu):
            self.waiting = np.concatenate([self.waiting, imu])
            self._lay_out()

    @property
    def until(self) -> float:
        """Up to where the inertial record is laid out, s."""
        return -np.inf if self.data is None else float(self.data.edges[-1])

    def _lay_out(self) -> None:
        """All samples that wait, but the last."""
        rows = self.waiting
        if self.dt is None:
            if len(rows) < _FIRST_SAMPLES:
                return
            self.dt = float(np.median(np.diff(rows[:_FIRST_SAMPLES, 0])))
        if len(rows) < 2:
            return
        begin = None if self.data is None else float(self.data.edges[-1])
        new = laid_out(rows[:, 0], rows[:, 1:4], rows[:, 4:], self.dt, begin)
        new = new.take(slice(0, len(new) - 1))
        self.data = new if self.data is None else self.data.joined(new)
        self.samples = np.concatenate([self.samples, rows[:-1]])
        self.waiting = rows[-1:]

    def intervals(self, begin: float, end: float) -> Intervals:
        """The inertial intervals that lie between two times."""
        assert self.data is not None
        edges = self.data.edges
        low, high = int(np.searchsorted(edges, begin - 1e-9)), int(np.searchsorted(edges, end + 1e-9, side="right")) - 1
        return self.data.take(slice(low, high))

    def positions_between(self, begin: float, end: float) -> Recording:
        """A recording of fixes and GNSS alone."""
        fixes, gnss = (self._between(name, begin, end) for name in ("fixes", "gnss"))
        return Recording(self.description, _NO_SAMPLES, None, fixes, gnss, gnss_origin=self.gnss_origin)

    def recording(self, begin: float, end: float) -> Recording:
        """The rows from one time to another."""
        imu = self.samples[slice(*np.searchsorted(self.samples[:, 0], [begin, end]).tolist())]
        tach = None
        if self.description.tach is not None:
            rows = slice(*np.searchsorted(self.tach[:, 0], [begin, end]).tolist())
            tach = pd.DataFrame(self.tach[rows], columns=list(TACH_COLUMNS))
        return replace(self.positions_between(begin, end), imu=pd.DataFrame(imu, columns=list(IMU_COLUMNS)), tach=tach)

    def rate_at(self, t: float) -> Array:
        """The gyro's mean rate about a time, rad/s, shape (1, 3)."""
        assert self.data is not None
        rows = slice(*np.searchsorted(self.samples[:, 0], [t - 0.05, t + 0.05]).tolist())
        return np.asarray(self.samples[rows, 1:4].mean(axis=0, keepdims=True))

    def forget(self, before: float) -> None:
        """Rows that end before a time."""
        if self.data is None:
            return
        gone = max(int(np.searchsorted(self.data.edges, before, side="right")) - 1, 0)
        self.data = self.data.take(slice(gone, len(self.data)))
        self.samples = self.samples[np.searchsorted(self.samples[:, 0], self.data.edges[0]) :]
        self.tach = self.tach[max(int(np.searchsorted(self.tach[:, 0], before)) - 1, 0) :]
        self.positions = {name: table[table["t_s"] >= before] for name, table in self.positions.items()}

    def _between(self, name: str, begin: float, end: float) -> pd.DataFrame | None:
        table = self.positions.get(name)
        if table is None:
            return None
        rows = table["t_s"].to_numpy()
        chosen: pd.DataFrame = table[(rows >= begin) & (rows < end)]
        return chosen
