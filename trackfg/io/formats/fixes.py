"""The table of balises, RFID tags and mile posts."""

from __future__ import annotations

import pandas as pd

from trackfg.checks.columns import ColumnPlace, unusable_sigmas
from trackfg.io.formats.sensor_format import ReadColumns, RowsAlone, SensorFormat, WrittenTable
from trackfg.recording.description import Fixes
from trackfg.recording.findings import Finding
from trackfg.recording.model import FIX_COLUMNS


class FixesFormat(SensorFormat[Fixes]):
    """Chainages with their sigmas."""

    key = "fixes"
    model = Fixes
    canonical = FIX_COLUMNS

    def columns(self, part: Fixes) -> tuple[str, ...]:
        """Return the columns of chainage and its sigma."""
        return (part.chainage, part.sd)

    def converter(self, part: Fixes) -> RowsAlone:
        """Change nothing: fixes are recorded in metres."""
        return RowsAlone(tuple)

    def value_faults(self, part: Fixes, read: ReadColumns) -> list[Finding]:
        """Return errors for sigmas that are not positive."""
        sd = read.named[part.sd]
        return [] if sd is None else unusable_sigmas(sd, ColumnPlace(part.file, part.sd, read.t))

    def written(self, part: Fixes, table: pd.DataFrame) -> WrittenTable:
        """Write the table as it is in memory."""
        return WrittenTable({"chainage": FIX_COLUMNS[1], "sd": FIX_COLUMNS[2]}, table)
