"""Units at the rim: SI inside, the user's units only where files are read and written.

A unit is named as in ``recording.toml``; :func:`to_si` gives the factor that turns it into SI.
"""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""m/s^2, by definition (3rd CGPM, 1901); what the accelerometer unit "g" means."""

KMH = 1.0 / 3.6
"""m/s per km/h."""

KNOT = 1852.0 / 3600.0
"""m/s per knot: a nautical mile, 1852 m, an hour (NIST Special Publication 811, appendix B)."""

MPH = 0.44704
"""m/s per mph: the international mile is 1609.344 m (NIST Special Publication 811, appendix B)."""

DEG_PER_H = math.radians(1.0) / 3600.0
"""rad/s per deg/h."""

_FACTORS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angular rate": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "acceleration": {"m/s^2": 1.0, "g": STANDARD_GRAVITY},
    "length": {"m": 1.0, "mm": 1e-3},
    "speed": {"m/s": 1.0, "km/h": KMH},
    "count": {"1": 1.0},
}


def known_units(quantity: str) -> tuple[str, ...]:
    """Return the unit names accepted for ``quantity`` ("time", "angular rate", "acceleration", "length", "speed",
    "count").
    """
    return tuple(_FACTORS[quantity])


def to_si(quantity: str, unit: str) -> float:
    """Return the factor that multiplies a value in ``unit`` to give SI. Raises ``KeyError`` for an unknown unit."""
    return _FACTORS[quantity][unit]
