"""Rows of a stream come a few of each table at a time, as arrays: a data frame costs more than the rows in it.

A table is an array of shape (n, columns) whose first column is the time; the others are given by

==================  =================================================================================================
raw                 the recording's description: columns, units and axes as the sensor sends them (:func:`raw_columns`)
canonical           :mod:`trackfg.recording.model`: SI, FLU, one clock (:func:`canonical_columns`)
==================  =================================================================================================

Tables are called ``imu``, ``tach``, ``fixes``, ``gnss`` and, for each laser, ``laser/NAME``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.io.formats.registry import format_of, format_of_table, sensors_of
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription, Table
from trackfg.recording.model import IMU_COLUMNS, LASER_TABLE, Recording

LASER = LASER_TABLE

SAME_S = 1e-6
"""Times of a stream that differ by less are one, s: rounding of times of a day, and of sums of shifts, is 1e-11 s."""

_SINGLE = ("imu", "tach", "fixes", "gnss")
"""Tables of which there is one."""

RowTables = Mapping[str, Array]
"""Rows by table, raw or canonical; tables without rows may be left out."""


def described_tables(description: RecordingDescription) -> dict[str, Table]:
    """Return the parts of a description that have rows, by the table's name; the IMU first."""
    return dict(sensors_of(description))


def raw_columns(description: RecordingDescription) -> dict[str, tuple[str, ...]]:
    """Return the columns of each table as the sensors send them, the time first."""
    return {name: (part.time, *format_of(part).columns(part)) for name, part in sensors_of(description)}


def canonical_columns(table: str) -> tuple[str, ...]:
    """Return the columns of a table in canonical form, the time first."""
    return format_of_table(table).canonical


NO_SAMPLES = pd.DataFrame(columns=list(IMU_COLUMNS), dtype=np.float64)
"""The IMU's table of a recording whose other tables alone are needed."""


def joined_tables(parts: Sequence[RowTables]) -> dict[str, Array]:
    """Return each table's rows of all parts, in their order."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: np.concatenate([part[name] for part in parts if name in part]) for name in names}


def moved_earlier(rows: Array, by_s: float) -> Array:
    """Return rows (n, k) with times earlier by ``by_s``, s."""
    return np.column_stack([rows[:, 0] - by_s, rows[:, 1:]]) if by_s else rows


def no_rows(table: str) -> Array:
    """Return a canonical table of length 0."""
    return np.empty((0, len(canonical_columns(table))))


@dataclass(frozen=True)
class Rows:
    """Canonical rows, in each table sorted by time without repetition; a table without rows has length 0.

    Rows up to ``until_s`` (s) are complete: what comes later on the stream is later than this. ``gnss_origin`` is that
    of the recording: latitude (deg), longitude (deg), height (m), or None. ``breaks``: by table, spans (b, 2),
    s, as :func:`~trackfg.streaming.events.motion_breaks` gives them, with or before the first rows after them.
    """

    imu: Array = field(default_factory=lambda: no_rows("imu"))
    tach: Array = field(default_factory=lambda: no_rows("tach"))
    fixes: Array = field(default_factory=lambda: no_rows("fixes"))
    gnss: Array = field(default_factory=lambda: no_rows("gnss"))
    lasers: Mapping[str, Array] = field(default_factory=dict)
    until_s: float = -np.inf
    gnss_origin: Array | None = None
    breaks: Mapping[str, Array] = field(default_factory=dict)
    others: Mapping[str, Array] = field(default_factory=dict)
    """Tables of further sensors by name."""

    def __len__(self) -> int:
        return sum(table.shape[0] for table in self.tables().values())

    def tables(self) -> dict[str, Array]:
        """Return the tables by name."""
        lasers = {f"{LASER}{name}": table for name, table in self.lasers.items()}
        return {"imu": self.imu, "tach": self.tach, "fixes": self.fixes, "gnss": self.gnss, **self.others, **lasers}

    @classmethod
    def of(cls, tables: RowTables, until_s: float, origin: Array | None = None) -> Rows:
        """Return the rows of canonical tables by name."""
        lasers = {name.removeprefix(LASER): table for name, table in tables.items() if name.startswith(LASER)}
        imu, tach, fixes, gnss = (tables.get(name, no_rows(name)) for name in _SINGLE)
        others = {name: rows for name, rows in tables.items() if name not in _SINGLE and not name.startswith(LASER)}
        return cls(imu, tach, fixes, gnss, lasers, until_s, origin, others=others)

    def frame(self, table: str) -> pd.DataFrame:
        """Return one table with its columns' names."""
        rows = self.tables().get(table, no_rows(table))
        return pd.DataFrame(rows, columns=list(canonical_columns(table)))


def recording_rows(recording: Recording) -> Rows:
    """Return all rows of a recording at once."""
    arrays = {name: table[list(canonical_columns(name))].to_numpy() for name, table in recording.tables.items()}
    return Rows.of(arrays, np.inf, recording.gnss_origin)
