"""Units of other systems: how they are written, and what becomes of those that a recording does not know."""

from __future__ import annotations

import re
from typing import Literal

from trackfg.numerics.km_notation import METRES_PER
from trackfg.numerics.units import MPH

_FOOT_M = 0.3048
_KNOT_MPS = 1852.0 / 3600.0
"""International foot and knot (NIST Special Publication 811, appendix B)."""

_CONVERSIONS = {
    "mrad/s": ("rad/s", 1e-3),
    "deg/h": ("deg/s", 1.0 / 3600.0),
    "mg": ("g", 1e-3),
    "gal": ("m/s^2", 1e-2),
    "mph": ("m/s", MPH),
    "kn": ("m/s", _KNOT_MPS),
    "ft/s": ("m/s", _FOOT_M),
    "cm": ("m", 1e-2),
    "ft": ("m", _FOOT_M),
    "km": ("m", METRES_PER["km"]),
    "mi": ("m", METRES_PER["mi"]),
}
"""Units that a recording does not know: the one that it gets, and the factor."""

_WRITTEN = {
    "speed": {
        r"km\s?[/_]?\s?h|kph": "km/h",
        r"mph|mi(les?)?\s?/\s?h": "mph",
        r"\bk(no?)?ts?\b|\bkn\b|knots?|(?<=_)k(n|ts)": "kn",
        r"ft\s?/\s?s|\bfps": "ft/s",
        r"\bm\s?/\s?s|mps|m\*s-1|m_s\b": "m/s",
    },
    "length": {
        r"(?<![a-z])mm(?![a-z])": "mm",
        r"(?<![a-z])cm(?![a-z])": "cm",
        r"(?<![a-z])km(?![a-z])": "km",
        r"(?<![a-z])(ft|feet|foot)(?![a-z])": "ft",
        r"(?<![a-z])mi(les?)?(?![a-z])|milepost": "mi",
        r"(?<![a-z])m(et(er|re)s?)?(?![a-z])": "m",
    },
}
"""Units by how they are written, in the order in which they are tried."""


def written_unit(text: str, quantity: Literal["speed", "length"]) -> str | None:
    """Return the unit that a column states, in its name or beside it; None where it states none."""
    folded = text.casefold()
    return next((unit for pattern, unit in _WRITTEN[quantity].items() if re.search(pattern, folded)), None)


def recorded_unit(unit: str) -> tuple[str, float]:
    """Return the unit that a recording gets, and what values are multiplied by."""
    return _CONVERSIONS.get(unit, (unit, 1.0))
