"""The table of a satellite receiver's speeds over ground."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace, negative_magnitude, unusable_sigmas
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import speed_findings
from trackfg.io.formats.sensor_format import Impossible, ReadColumns, RowsAlone, SensorFormat, WrittenTable
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import to_si
from trackfg.recording.description import GnssSpeed
from trackfg.recording.findings import Finding, Section
from trackfg.recording.model import GNSS_SPEED_COLUMNS


class GnssSpeedFormat(SensorFormat[GnssSpeed]):
    """Speeds with their sigmas; rows are empty or missing where the receiver has none."""

    key = "gnss_speed"
    model = GnssSpeed
    canonical = GNSS_SPEED_COLUMNS
    may_be_silent = True

    def columns(self, part: GnssSpeed) -> tuple[str, ...]:
        """Return the speed, and its sigma where that has a column."""
        return (part.column,) if part.sd is None else (part.column, part.sd)

    def converter(self, part: GnssSpeed) -> RowsAlone:
        """Convert to m/s, with the sigma of all rows where they have none of their own."""
        return RowsAlone(partial(_speeds, part))

    def value_faults(self, part: GnssSpeed, read: ReadColumns) -> list[Finding]:
        """Return errors for speeds below zero, and sigmas that are not positive."""
        faults, speed = [], read.named[part.column]
        if speed is not None:
            faults += negative_magnitude(speed, ColumnPlace(part.file, part.column, read.t))
        sd = None if part.sd is None else read.named[part.sd]
        if part.sd is not None and sd is not None:
            faults += unusable_sigmas(sd, ColumnPlace(part.file, part.sd, read.t), part.unit)
        return faults

    def doubts(self, part: GnssSpeed, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """Return an error for speeds of no vehicle."""
        speed, hint = table["speed_mps"].to_numpy(), f"check {section.name}.unit"
        return speed_findings("gnss-speed-unit", speed, part, hint, limits)

    def impossible(self, part: GnssSpeed, columns: Sequence[Array]) -> Impossible | None:
        """Return which rows have speeds of no vehicle, and below zero."""
        speed = columns[0] * to_si("speed", part.unit)
        return Impossible("speed-jump", (speed > CheckLimits().speed_error_mps) | (speed < 0.0))

    def written(self, part: GnssSpeed, table: pd.DataFrame) -> WrittenTable:
        """Write m/s."""
        _, speed, sd = GNSS_SPEED_COLUMNS
        return WrittenTable({"column": speed, "unit": "m/s", "sd": sd}, table)


def _speeds(part: GnssSpeed, columns: Sequence[Array]) -> tuple[Array, Array]:
    factor = to_si("speed", part.unit)
    speed = columns[0] * factor
    return speed, np.full_like(speed, part.sd_mps) if part.sd is None else columns[1] * factor
