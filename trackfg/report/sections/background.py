"""Lines and named points of the user's GeoJSON file or GeoPackage lie behind the path on a page's map.

Both are read by :mod:`trackfg.io.features`. A layer of a GeoPackage whose reference system is undefined is in the run's
own east and north.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackfg.errors import BadInputError
from trackfg.io.features import LOCAL, SUFFIXES, Feature, in_wgs_84, read_features
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import geodetic_to_enu
from trackfg.results.result import Result

_NAMES = ("name", "ref", "id")
"""Properties that name a point, the first that it has."""
_NEAR_M = 150.0
"""A named point nearer to the path is a station on the strips: half a long platform and the width of a yard, m."""

Origin = tuple[float, float, float]


@dataclass(frozen=True)
class Background:
    """Lines (n, 2) and named points in the east and north of a result, m."""

    lines: tuple[Array, ...] = ()
    points: tuple[tuple[str, float, float], ...] = ()

    def stations(self, result: Result) -> list[tuple[str, float]]:
        """Return name and chainage, m, of the points beside the path, each where the path is nearest."""
        path = result.trajectory[["east_m", "north_m"]].to_numpy()
        chainage = result.trajectory["chainage_m"].to_numpy()
        points = []
        for name, east, north in self.points if len(path) else ():
            away = np.hypot(*(path - (east, north)).T)
            nearest = int(np.argmin(away))
            if away[nearest] <= _NEAR_M:
                points.append((name, float(chainage[nearest])))
        return points


def read_background(path: str | os.PathLike[str], origin: Origin | None) -> Background:
    """Read a background. ``origin`` is that of the result: latitude and longitude, deg, and height, m.

    Raises :class:`BadInputError` for a file that is neither GeoJSON nor a GeoPackage, for a reference system that is
    not known here, and for one on the Earth where the result has no origin.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise BadInputError(f"{path}: expected a background that ends in {', '.join(SUFFIXES)}")
    lines, points = [], []
    for feature in read_features(path):
        name = _name(feature)
        for vertices in feature.parts:
            in_plane = _in_plane(path, feature, vertices, origin)
            if len(vertices) > 1:
                lines.append(in_plane)
            elif name and len(vertices):
                east, north = in_plane[0].tolist()
                points.append((name, east, north))
    return Background(tuple(lines), tuple(points))


def _name(feature: Feature) -> str:
    lower = {key.lower(): value for key, value in feature.properties.items()}
    return next((str(lower[key]) for key in _NAMES if lower.get(key) not in (None, "")), "")


def _in_plane(path: Path, feature: Feature, vertices: Array, origin: Origin | None) -> Array:
    """Return vertices (n, 2) in the run's east and north, at the height of its origin."""
    if feature.system == LOCAL:
        return vertices
    if origin is None:
        raise BadInputError(
            f"{path}: is in latitude and longitude, but the result knows no place on the Earth; expected one of a run "
            "with GNSS. Hint: a GeoPackage with an undefined reference system is taken in the run's east and north"
        )
    geodetic = in_wgs_84(vertices, feature.system, f"{path}: {feature.where}")
    with_height = np.column_stack([geodetic, np.full(len(geodetic), origin[2])])
    return geodetic_to_enu(with_height, np.asarray(origin))[:, :2]
