"""The table of one displacement sensor."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.io.formats.sensor_format import Converter, SensorFormat, WrittenTable
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import Laser
from trackfg.recording.findings import Finding, Section
from trackfg.recording.model import LASER_COLUMNS, LASER_TABLE


class LaserConverter(Converter):
    """Makes metres."""

    def __init__(self, part: Laser) -> None:
        self._part = part

    def __call__(self, t: Array, columns: Sequence[Array]) -> tuple[Array, ...]:
        """The displacement, one column."""
        return (canonical.laser_displacement(self._part, columns[0]),)


class LaserFormat(SensorFormat[Laser]):
    """Where one rail is, along one axis. A table is called by the sensor's name."""

    key = "laser"
    model = Laser
    canonical = LASER_COLUMNS
    several = True

    def columns(self, part: Laser) -> tuple[str, ...]:
        """One."""
        return (part.column,)

    def converter(self, part: Laser) -> LaserConverter:
        """Convert to metres."""
        return LaserConverter(part)

    def table_name(self, part: Laser, number: int) -> str:
        """Return a name made of the laser's own."""
        return f"{LASER_TABLE}{part.name}"

    def doubts(self, part: Laser, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """A unit that is off by 1000."""
        from trackfg.checks import plausibility  # late: with SciPy's filters it takes as long as a batch's planning

        return plausibility.laser_findings(part, section, table, limits)

    def written(self, part: Laser, table: pd.DataFrame) -> WrittenTable:
        """Write metres."""
        return WrittenTable({"column": LASER_COLUMNS[1], "unit": "m"}, table)
