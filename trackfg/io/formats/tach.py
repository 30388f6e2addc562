"""The table of a wheel tachometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace, falling, negative_speed
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import tach_findings
from trackfg.io.formats.sensor_format import Converter, Impossible, ReadColumns, SensorFormat, WrittenTable
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.canonical import TachReading
from trackfg.recording.description import Tach
from trackfg.recording.findings import Finding, Section
from trackfg.recording.model import TACH_COLUMNS

FASTEST_MPS = CheckLimits().speed_error_mps
"""No vehicle on rails is faster (m/s)."""


class TachConverter(Converter):
    """Makes the nominal distance; a speed is integrated on from the last row."""

    def __init__(self, part: Tach) -> None:
        self._part = part
        self._last: TachReading | None = None

    def __call__(self, t: Array, columns: Sequence[Array]) -> tuple[Array, ...]:
        """Return the cumulative distance, one column."""
        (values,) = columns
        distance = canonical.tach_distance(self._part, t, values, self._last)
        if self._part.kind == "speed":
            speed = canonical.tach_speed(self._part, values)
            self._last = TachReading(float(t[-1]), float(speed[-1]), float(distance[-1]))
        return (distance,)

    def state(self) -> Any:
        """Return the state of the integral."""
        return None if self._last is None else asdict(self._last)

    def restore(self, state: Any) -> None:
        """Go on from a :meth:`state`."""
        self._last = None if state is None else TachReading(**state)


class TachFormat(SensorFormat[Tach]):
    """A count, a distance or a speed, in memory a distance."""

    key = "tach"
    model = Tach
    canonical = TACH_COLUMNS

    def columns(self, part: Tach) -> tuple[str, ...]:
        """Return the one column of counts, distances or speeds."""
        return (part.column,)

    def converter(self, part: Tach) -> TachConverter:
        """Convert to metres of the nominal wheel."""
        return TachConverter(part)

    def gap_limits_s(self, limits: CheckLimits) -> tuple[float, float | None] | None:
        """A tach may be silent at rest."""
        return limits.tach_gap_warning_s, None

    def value_faults(self, part: Tach, read: ReadColumns) -> list[Finding]:
        """Return an error for a tach that is declared unsigned and runs backwards."""
        values = read.named[part.column]
        if part.signed or values is None:
            return []
        check = negative_speed if part.kind == "speed" else falling
        return check(values, ColumnPlace(part.file, part.column, read.t))

    def doubts(self, part: Tach, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """Return findings for speeds and wheels of no vehicle."""
        return tach_findings(part, section, table, limits)

    def impossible(self, part: Tach, columns: Sequence[Array]) -> Impossible | None:
        """Return which rows have speeds of no vehicle; what a count or a distance may do shows from row to row."""
        if part.kind != "speed":
            return None
        speed = canonical.tach_speed(part, columns[0])
        return Impossible("tach-jump", (np.abs(speed) > FASTEST_MPS) | ((speed < 0.0) & (not part.signed)))

    def written(self, part: Tach, table: pd.DataFrame) -> WrittenTable:
        """Write counts where these reproduce the distances to the last bit, else a distance."""
        if (counts := _pulse_counts(part, table)) is not None:
            return WrittenTable({"kind": "pulses", "unit": "1", "column": "count"}, counts)
        keys = {"kind": "distance", "unit": "m", "column": TACH_COLUMNS[1], "integrated": part.integrates_speed}
        return WrittenTable(keys, table)


def _pulse_counts(part: Tach, table: pd.DataFrame) -> pd.DataFrame | None:
    if part.kind != "pulses":
        return None
    pulse, distance = canonical.pulse_m(part), table["distance_m"].to_numpy()
    count = np.rint(distance / pulse)
    if not np.array_equal(count * pulse, distance):
        return None
    return pd.DataFrame({"t_s": table["t_s"], "count": count})
