"""The table of a sensor of the speed over ground: a Doppler radar, or an optical sensor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace, negative_speed
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import speed_findings
from trackfg.io.formats.sensor_format import Impossible, ReadColumns, RowsAlone, SensorFormat, WrittenTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import to_si
from trackfg.recording.description import Speed
from trackfg.recording.findings import Finding, Section
from trackfg.recording.model import SPEED_COLUMNS


class SpeedFormat(SensorFormat[Speed]):
    """Speeds, with rows that are empty or missing where the sensor had no echo."""

    key = "speed"
    model = Speed
    canonical = SPEED_COLUMNS
    several = True
    may_be_silent = True

    def columns(self, part: Speed) -> tuple[str, ...]:
        """Return the one column of speeds."""
        return (part.column,)

    def converter(self, part: Speed) -> RowsAlone:
        """Convert to m/s, NaN below the sensor's lowest speed, where it says nothing."""
        return RowsAlone(partial(_speed, part))

    def value_faults(self, part: Speed, read: ReadColumns) -> list[Finding]:
        """Return an error for a sensor that is declared unsigned and goes backwards."""
        speed = read.named[part.column]
        if part.signed or speed is None:
            return []
        return negative_speed(speed, ColumnPlace(part.file, part.column, read.t), "speed")

    def doubts(self, part: Speed, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """Return an error for speeds of no vehicle."""
        speed, hint = table["speed_mps"].to_numpy(), f"check {section.name}.unit"
        return speed_findings("speed-unit", speed, part, hint, limits)

    def impossible(self, part: Speed, columns: Sequence[Array]) -> Impossible | None:
        """Return which rows have speeds of no vehicle, and below zero although the sensor is declared unsigned."""
        speed = columns[0] * to_si("speed", part.unit)
        wrong = (np.abs(speed) > CheckLimits().speed_error_mps) | ((speed < 0.0) & (not part.signed))
        return Impossible("speed-jump", wrong)

    def written(self, part: Speed, table: pd.DataFrame) -> WrittenTable:
        """Write m/s."""
        return WrittenTable({"column": SPEED_COLUMNS[1], "unit": "m/s"}, table)


def _speed(part: Speed, columns: Sequence[Array]) -> tuple[Array]:
    speed = columns[0] * to_si("speed", part.unit)
    return (np.where(np.abs(speed) < part.lowest_mps, np.nan, speed),)
