"""The table of one displacement sensor."""

from __future__ import annotations

import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import laser_findings
from trackfg.io.formats.sensor_format import RowsAlone, SensorFormat, WrittenTable
from trackfg.recording import canonical
from trackfg.recording.description import Laser
from trackfg.recording.findings import Finding, Section
from trackfg.recording.model import LASER_COLUMNS, LASER_TABLE


class LaserFormat(SensorFormat[Laser]):
    """A sensor shows where one rail is, along one axis. A table is called by the sensor's name."""

    key = "laser"
    model = Laser
    canonical = LASER_COLUMNS
    several = True

    def columns(self, part: Laser) -> tuple[str, ...]:
        """Return the one column of displacements."""
        return (part.column,)

    def converter(self, part: Laser) -> RowsAlone:
        """Convert to metres."""
        return RowsAlone(lambda columns: (canonical.laser_displacement(part, columns[0]),))

    def table_name(self, part: Laser, number: int) -> str:
        """Return a name made of the laser's own."""
        return f"{LASER_TABLE}{part.name}"

    def doubts(self, part: Laser, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """Return an error for a unit that is off by 1000."""
        return laser_findings(part, section, table, limits)

    def written(self, part: Laser, table: pd.DataFrame) -> WrittenTable:
        """Write metres."""
        return WrittenTable({"column": LASER_COLUMNS[1], "unit": "m"}, table)
