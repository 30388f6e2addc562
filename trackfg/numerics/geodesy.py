"""From the map's frame (east, north, up at an origin) to WGS 84: the inverse of
:func:`trackfg.numerics.frames.geodetic_to_enu`.

That frame's up is the difference in height, not the distance from the tangent plane, so the latter is found first: it
falls short of the former by about ``(e^2 + n^2) / 2R``, and each correction by the height that comes out leaves 6e-5 of
the error at 70 km (the plane has turned by 0.011 rad there).
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.frames import Array, ecef_from_enu, geodetic_to_ecef

_A = 6378137.0
_F = 1.0 / 298.257223563
_B = _A * (1.0 - _F)
_E2 = _F * (2.0 - _F)
_CORRECTIONS = 6


def ecef_to_geodetic(ecef: Array) -> Array:
    """ECEF in m to WGS 84 (latitude deg, longitude deg, height m). Shape (..., 3) to (..., 3).

    Bowring, "Transformation from spatial to geographical coordinates", Survey Review 23 (1976), applied twice: better
    than 1e-9 m within 100 km of the surface.
    """
    x, y, z = ecef[..., 0], ecef[..., 1], ecef[..., 2]
    p = np.hypot(x, y)
    reduced = np.arctan2(z * _A, p * _B)
    for _ in range(2):
        second = _E2 / (1.0 - _E2)
        latitude = np.arctan2(z + second * _B * np.sin(reduced) ** 3, p - _E2 * _A * np.cos(reduced) ** 3)
        reduced = np.arctan2((1.0 - _F) * np.sin(latitude), np.cos(latitude))
    sin, cos = np.sin(latitude), np.cos(latitude)
    height = p * cos + z * sin - _A * np.sqrt(1.0 - _E2 * sin * sin)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height], axis=-1)


def enu_to_geodetic(enu: Array, origin: tuple[float, float, float]) -> Array:
    """Positions in the level frame about ``origin`` to (latitude deg, longitude deg, height m). Shape (..., 3)."""
    place = np.asarray(origin)
    rotation = ecef_from_enu(origin[0], origin[1])
    centre = geodetic_to_ecef(place)
    height = origin[2] + enu[..., 2]
    plane = np.array(enu, dtype=np.float64)
    geodetic = plane
    for _ in range(_CORRECTIONS):
        geodetic = ecef_to_geodetic(centre + plane @ rotation.T)
        plane[..., 2] += height - geodetic[..., 2]
    return geodetic
