"""From raw rows to canonical ones, a few at a time, by the formulas of :mod:`trackfg.recording.canonical`.

Rows come in order, their times on the common clock already. What carries over from batch to batch is where the
integral of a speed stands and the origin of the GNSS positions: joined, the batches are what reading the whole
recording at once gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.canonical import TachReading
from trackfg.recording.description import Fixes, Gnss, Imu, Laser, RecordingDescription, Table, Tach
from trackfg.streaming.events import LossReport
from trackfg.streaming.rows import RowTables, described_tables

FASTEST_MPS = CheckLimits().speed_error_mps


class Conversion:
    """The tables of one description, made canonical."""

    def __init__(self, description: RecordingDescription) -> None:
        self._parts = described_tables(description)
        self._R = canonical.imu_rotation(description.imu)
        self._tach: TachReading | None = None
        self.gnss_origin: Array | None = None
        """Latitude (deg), longitude (deg), height (m); None until it is known."""

    def converted(self, raw: RowTables, report: LossReport) -> dict[str, Array]:
        """Canonical rows; those with impossible positions or speeds go to the ``report``."""
        tables = {}
        for name, rows in raw.items():
            rows = self._possible(name, rows, report)
            if rows.shape[0]:
                t, *columns = rows.T
                tables[name] = np.column_stack([t, *self._columns(self._parts[name], t, columns)])
        return tables

    def _possible(self, name: str, rows: Array, report: LossReport) -> Array:
        part = self._parts[name]
        if isinstance(part, Gnss) and part.frame == "geodetic":
            wrong = (np.abs(rows[:, 1]) > 90.0) | (rows[:, 2] < -180.0) | (rows[:, 2] > 360.0)
            kind = "position-range"
        elif isinstance(part, Tach) and part.kind == "speed":
            speed = canonical.tach_speed(part, rows[:, 1])
            wrong = (np.abs(speed) > FASTEST_MPS) | ((speed < 0.0) & (not part.signed))
            kind = "tach-jump"
        else:
            return rows
        report.lose(kind, name, rows[wrong, 0])
        return rows[~wrong]

    def _columns(self, part: Table, t: Array, columns: list[Array]) -> tuple[Array, ...]:
        match part:
            case Imu():
                return canonical.imu_in_body(part, self._R, columns)
            case Tach():
                return (self._distance(part, t, columns[0]),)
            case Fixes():
                return tuple(columns)
            case Gnss():
                if self.gnss_origin is None:
                    self.gnss_origin = canonical.gnss_origin(part, columns)
                return (*canonical.gnss_position(part, self.gnss_origin, columns), *columns[3:])
            case Laser():
                return (canonical.laser_displacement(part, columns[0]),)
        raise TypeError(type(part))

    def _distance(self, part: Tach, t: Array, values: Array) -> Array:
        distance = canonical.tach_distance(part, t, values, self._tach)
        if part.kind == "speed":
            speed = canonical.tach_speed(part, values)
            self._tach = TachReading(float(t[-1]), float(speed[-1]), float(distance[-1]))
        return distance

    def state(self) -> dict[str, Any]:
        """What carries over to the next batch, as JSON values."""
        return {
            "tach": None if self._tach is None else asdict(self._tach),
            "gnss_origin": None if self.gnss_origin is None else self.gnss_origin.tolist(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._tach = None if state["tach"] is None else TachReading(**state["tach"])
        self.gnss_origin = None if state["gnss_origin"] is None else np.array(state["gnss_origin"])
