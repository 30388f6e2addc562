"""The Earth: gravity, rotation, and positions between WGS 84 and a level frame (east, north, up at an origin).

The level frame's up is the difference in height, not the distance from the tangent plane. :func:`enu_to_geodetic` finds
the latter first: it is shorter than the former by about ``(e^2 + n^2) / 2R``, and each correction by the height that
comes out leaves 6e-5 of the error at 70 km, where the plane has turned by 0.011 rad.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

EARTH_RATE = 7.292115e-5
"""rad/s, WGS 84."""

EARTH_RADIUS = 6.371e6
"""m, mean radius."""

_A = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid, m (NIMA TR8350.2)."""

_F = 1.0 / 298.257223563
"""Its flattening."""

_B = _A * (1.0 - _F)
_E2 = _F * (2.0 - _F)
"""Semi-minor axis, m, and squared eccentricity of the ellipsoid."""
_CORRECTIONS = 6
"""Rounds of :func:`enu_to_geodetic` at most: each leaves 6e-5 of the error, so six reach the last bit."""
_SETTLED_M = 4e-9
"""Rounds end when heights are right to this: four last bits of an Earth's radius (9e-10 m)."""


def normal_gravity(latitude_deg: float, height_m: float = 0.0) -> float:
    """Return gravity on the WGS 84 ellipsoid, m/s^2 (Somigliana's formula with the free-air gradient)."""
    s2 = np.sin(np.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - _E2 * s2)
    return float(surface - 3.086e-6 * height_m)


def earth_rate_enu(latitude_deg: float) -> Array:
    """Return the Earth's rotation in ENU, rad/s. Shape (3,)."""
    latitude = np.radians(latitude_deg)
    return EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])


def transport_rate(velocity: Array) -> Array:
    """Return how fast the level frame turns under a vehicle with this velocity in n, rad/s; 0.65 deg/h at 20 m/s."""
    return np.stack([-velocity[..., 1], velocity[..., 0], np.zeros_like(velocity[..., 0])], axis=-1) / EARTH_RADIUS


def geodetic_to_ecef(geodetic: Array) -> Array:
    """Convert WGS 84 (latitude deg, longitude deg, height m) to ECEF in m. Shape (..., 3) to (..., 3)."""
    lat, lon = np.radians(geodetic[..., 0]), np.radians(geodetic[..., 1])
    height = geodetic[..., 2]
    n = _A / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    x = (n + height) * np.cos(lat) * np.cos(lon)
    y = (n + height) * np.cos(lat) * np.sin(lon)
    z = (n * (1.0 - _E2) + height) * np.sin(lat)
    return np.stack([x, y, z], axis=-1)


def ecef_from_enu(latitude_deg: float, longitude_deg: float) -> Array:
    """Return the rotation that maps ENU vectors at a place to ECEF. Shape (3, 3)."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array(
        [
            [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
            [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
            [0.0, cos_lat, sin_lat],
        ]
    )


def geodetic_to_enu(geodetic: Array, origin: Array) -> Array:
    """Return WGS 84 positions in the level frame n about ``origin`` (lat deg, lon deg, height m). Shape (..., 3), m.

    East and north on the tangent plane of the origin (short by 6e-5 of the distance at 70 km), up as the difference in
    height: level stays level.
    """
    rotation = ecef_from_enu(float(origin[0]), float(origin[1]))
    enu: Array = (geodetic_to_ecef(geodetic) - geodetic_to_ecef(origin)) @ rotation
    enu[..., 2] = geodetic[..., 2] - origin[2]
    return enu


def ecef_to_geodetic(ecef: Array) -> Array:
    """Convert ECEF, m, to (latitude deg, longitude deg, height m). Shape (..., 3)."""
    latitude, longitude, height = _geodetic(*np.moveaxis(ecef, -1, 0))
    return np.stack([np.degrees(latitude), np.degrees(longitude), height], axis=-1)


def _geodetic(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return latitude and longitude, rad, and height, m, of ECEF in m.

    Bowring, "Transformation from spatial to geographical coordinates", Survey Review 23 (1976), applied twice: better
    than 1e-9 m within 100 km of the surface. Sine and cosine come from the sides of their triangle.
    """
    p = np.hypot(x, y)
    opposite, adjacent = z * _A, p * _B
    second = _E2 / (1.0 - _E2)
    for _ in range(2):
        length = np.hypot(opposite, adjacent)
        sin, cos = opposite / length, adjacent / length  # of the reduced latitude
        above, beside = z + second * _B * (sin * sin * sin), p - _E2 * _A * (cos * cos * cos)
        opposite, adjacent = (1.0 - _F) * above, beside
    length = np.hypot(above, beside)
    sin, cos = above / length, beside / length
    height = p * cos + z * sin - _A * np.sqrt(1.0 - _E2 * sin * sin)
    return np.arctan2(above, beside), np.arctan2(y, x), height


def enu_to_geodetic(enu: Array, origin: tuple[float, float, float]) -> Array:
    """Convert positions in the level frame about ``origin`` to (latitude deg, longitude deg, height m). Shape (...,
    3).
    """
    R, centre = ecef_from_enu(origin[0], origin[1]), geodetic_to_ecef(np.asarray(origin))
    east, north, up = (np.array(enu[..., i], dtype=np.float64) for i in range(3))
    height = origin[2] + up
    up = up - (east * east + north * north) / (2.0 * EARTH_RADIUS)
    for _ in range(_CORRECTIONS):
        x, y, z = (centre[i] + R[i, 0] * east + R[i, 1] * north + R[i, 2] * up for i in range(3))
        latitude, longitude, trial_height = _geodetic(x, y, z)
        error = height - trial_height
        if np.all(np.abs(error) <= _SETTLED_M):
            break
        up = up + error
    return np.stack([np.degrees(latitude), np.degrees(longitude), trial_height], axis=-1)
