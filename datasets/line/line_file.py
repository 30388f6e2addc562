"""A line that is there already: from a TOML line description or LandXML, by suffix (docs/line-files.md).

LandXML says nothing of speed limits. Each curve then has the one at which the lateral acceleration is
:data:`UNCOMPENSATED_MPS2` in the plane of the track (0.65 m/s^2 is a cant deficiency of 100 mm on 1.5 m),

    v^2 = (0.65 m/s^2 + g cant / base) / |kappa|,  the cant positive where the outer rail is the higher one,

rounded down to 5 km/h, and the rest of the line has none: there the driver goes as fast as his vehicle does.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from trackfg.datasets.line.landxml import read_landxml
from trackfg.datasets.line.line import GivenLine, Line
from trackfg.datasets.line.line_description import read_line
from trackfg.errors import BadInputError
from trackfg.numerics import units
from trackfg.numerics.arrays import Array

UNCOMPENSATED_MPS2 = 0.65
"""Acceleration in the plane of the track that speed limits allow, m/s^2: a cant deficiency of 100 mm on 1.5 m."""

_GRID_M = 5.0
"""Step at which curves are looked at for their speed, m."""
_STEP_MPS = 5.0 * units.KMH
"""Speed limits are whole multiples of it: 5 km/h."""
_DEFAULT_GAUGE_M = 1.435
"""Gauge where the file gives none, m: standard gauge."""


def read_line_file(path: Path | str, alignment: str | None = None) -> GivenLine:
    """Return the line of a ``.toml`` or ``.xml`` file; ``alignment`` is the name of one of several in LandXML.

    Chainage is that of the description, or begins with the station of a LandXML alignment; its gauge is 1.435 m where
    it names none. Raises :class:`~trackfg.errors.BadInputError` for another suffix and a file that cannot be used.
    """
    path = Path(path)
    match path.suffix.lower():
        case ".toml" if alignment is not None:
            raise BadInputError(f"{path}: holds one line: expected LandXML (.xml) to choose {alignment!r} from")
        case ".toml":
            return read_line(path)
        case ".xml":
            designed = read_landxml(path, name=alignment, speed_limit_mps=np.inf)
            return GivenLine(
                designed.name,
                with_curve_limits(designed.line),
                designed.gauge_m or _DEFAULT_GAUGE_M,
                designed.station_start_m,
                designed.remarks,
                designed.kilometrage,
            )
    raise BadInputError(f"{path}: expected a line description (.toml) or LandXML (.xml)")


def with_curve_limits(line: Line) -> Line:
    """Return the line with the speed limits that its curves need, in steps of 5 m, instead of its own."""
    s = np.arange(0.0, line.length_m, _GRID_M)
    edges = np.append(s, line.length_m)
    # Both ends of a step and its middle: a limit must not begin after its curve.
    safe = np.min([_safe_speed(line, at) for at in (edges[:-1], 0.5 * (edges[:-1] + edges[1:]), edges[1:])], axis=0)
    limit = np.maximum(np.floor(safe / _STEP_MPS), 1.0) * _STEP_MPS
    first = np.flatnonzero(np.append(True, limit[1:] != limit[:-1]))
    return replace(line, limit_from_m=s[first], limit_mps=limit[first])


def _safe_speed(line: Line, s: Array) -> Array:
    curvature = line.curvature(s)
    # The right rail is the outer one in a curve to the left, and cant is the height of the left one.
    tilt = -np.sign(curvature) * line.cant(s) / line.cross_level_base_m
    with np.errstate(divide="ignore"):
        square = (UNCOMPENSATED_MPS2 + units.STANDARD_GRAVITY * tilt) / np.abs(curvature)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))
