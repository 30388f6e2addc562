"""The table of a tachometer on a further axle: each entry of ``[[tach]]`` but the first."""

from __future__ import annotations

from trackfg.io.formats.tach import TachFormat
from trackfg.recording.description import FurtherTach, Tach


class FurtherTachFormat(TachFormat):
    """Further tachs have the first tach's table, and are numbered from 2."""

    key = "further_tach"
    model = FurtherTach
    several = True

    def table_name(self, part: Tach, number: int) -> str:
        """Return a name with the number that the tach has in the file."""
        return f"tach/{number + 1}"
