"""The table of a satellite receiver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace, outside, unusable_sigmas
from trackfg.io.formats.sensor_format import Converter, Impossible, ReadColumns, SensorFormat, WrittenTable
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import Gnss
from trackfg.recording.findings import Finding
from trackfg.recording.model import GNSS_COLUMNS

_LATITUDES_DEG = (-90.0, 90.0)
_LONGITUDES_DEG = (-180.0, 360.0)


class GnssConverter(Converter):
    """Makes east, north and up of ``origin``: latitude (deg), longitude (deg), height (m); None until it is known."""

    def __init__(self, part: Gnss) -> None:
        self._part = part
        self.origin: Array | None = None

    def __call__(self, t: Array, columns: Sequence[Array]) -> tuple[Array, ...]:
        """Return positions and their sigmas, m, six columns."""
        if self.origin is None:
            self.origin = canonical.gnss_origin(self._part, columns)
        return (*canonical.gnss_position(self._part, self.origin, columns), *columns[3:])

    def state(self) -> Any:
        """Return the origin."""
        return None if self.origin is None else self.origin.tolist()

    def restore(self, state: Any) -> None:
        """Go on from a :meth:`state`."""
        self.origin = None if state is None else np.array(state)


class GnssFormat(SensorFormat[Gnss]):
    """Geodetic or local positions, in memory east, north and up."""

    key = "gnss"
    model = Gnss
    canonical = GNSS_COLUMNS

    def columns(self, part: Gnss) -> tuple[str, ...]:
        """Return three columns of the position, three of its sigmas."""
        return (*part.position, *part.sd)

    def converter(self, part: Gnss) -> GnssConverter:
        """Convert to metres about an origin."""
        return GnssConverter(part)

    def value_faults(self, part: Gnss, read: ReadColumns) -> list[Finding]:
        """Return errors for sigmas that are not positive, and positions that are not on the Earth."""
        faults = []
        for name in part.sd:
            if (sd := read.named[name]) is not None:
                faults += unusable_sigmas(sd, ColumnPlace(part.file, name, read.t))
        if part.frame == "geodetic":
            for name, limit in zip(part.position, (_LATITUDES_DEG, _LONGITUDES_DEG), strict=False):
                if (degrees := read.named[name]) is not None:
                    faults += outside(degrees, *limit, ColumnPlace(part.file, name, read.t))
        return faults

    def impossible(self, part: Gnss, columns: Sequence[Array]) -> Impossible | None:
        """Return which rows have positions that are not on the Earth."""
        if part.frame != "geodetic":
            return None
        latitude, longitude = columns[:2]
        low, high = _LONGITUDES_DEG
        return Impossible(
            "position-range", (np.abs(latitude) > _LATITUDES_DEG[1]) | (longitude < low) | (longitude > high)
        )

    def written(self, part: Gnss, table: pd.DataFrame) -> WrittenTable:
        """Write local positions; the recording has their origin."""
        return WrittenTable({"position": GNSS_COLUMNS[1:4], "sd": GNSS_COLUMNS[4:7], "frame": "local"}, table)
