"""The table of a sensor in a recording, before all tables are on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from trackfg.interchange.importing.mapping import MappedSensor
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import Times
from trackfg.numerics.arrays import Array


class SensorTable(NamedTuple):
    """A sensor has its times, its columns, its section in the description, and perhaps a table beside it, ``places``.

    ``notes`` say what was left out; ``whole`` is the source's table whose rows these are, None where they are others.
    """

    sensor: MappedSensor
    times: Times
    columns: Mapping[str, Array | pd.Series]
    keys: dict[str, Any]
    places: pd.DataFrame | None = None
    notes: tuple[str, ...] = ()
    whole: SourceTable | None = None

    @property
    def file(self) -> str:
        """The name of the file that it becomes."""
        return f"{self.sensor.section.replace('[', '_').rstrip(']')}.parquet"

    @property
    def time_column(self) -> str:
        """The name of the column of time in that file."""
        return "t" if "t" not in self.columns else "t_s"

    @property
    def origin(self) -> str:
        """The user's name of its table, and of which table its rows are counted where that is another."""
        return self.whole.name if self.whole is not None else f"{self.file} of {' and '.join(self.sensor.files)}"
