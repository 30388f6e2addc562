"""Places along a line as people write them: ``12+345.6``, ``12k345``, ``km 12,345``, ``12345 m``, ``12 mi 34 ch``."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from trackfg.numerics.arrays import Array

KmNotation = Literal["km+m", "km"]
"""``12+345.67`` or ``12.34567``."""

_WORD = r"(?:km|pk|kp|p\.k\.)\.?\s*"
"""What stands before an official place: ``km 12+345``, ``PK 12+345``."""
_PLUS = re.compile(
    rf"^(?:{_WORD})?(?P<sign>-)?(?P<km>\d+(?:\.\d+)?)\s*(?:\+|km?)\s*(?P<m>(?:(?<=\+)-|(?<=\+ )-)?\d+(?:\.\d+)?)\s*m?$",
    re.IGNORECASE,
)
_KM = re.compile(rf"^(?:{_WORD}(?P<a>-?\d+(?:\.\d+)?)|(?P<b>-?\d+(?:\.\d+)?)\s*km)$", re.IGNORECASE)
_M = re.compile(r"^(?P<m>-?\d+(?:\.\d+)?)\s*(?P<unit>m?)$", re.IGNORECASE)
_MILES = re.compile(
    r"^(?:mp\s*)?(?P<mi>\d+(?:\.\d+)?)\s*(?:m|mi|miles?)\.?\s*"
    r"(?:(?P<ch>\d+(?:\.\d+)?)\s*(?:c|ch|chains?)\.?|(?P<yd>\d+(?:\.\d+)?)\s*(?:y|yds?|yards?)\.?|"
    r"(?P<ft>\d+(?:\.\d+)?)\s*(?:ft|feet)\.?)$"
    r"|^mp\s*(?P<a>\d+(?:\.\d+)?)$|^(?P<b>\d+(?:\.\d+)?)\s*(?:mi|miles?)$",
    re.IGNORECASE,
)
METRES_PER = {"m": 1.0, "ft": 0.3048, "km": 1000.0, "mi": 1609.344}
"""Units of a place that is a bare number."""
LENGTHS = ("m", "ft")
"""Units in which a bare number is a length along the track, and no official place."""
METRES_FROM_POST = {"m": 1.0, "ft": 0.3048, "yd": 0.9144, "ch": 20.1168}
"""Units of the length from a kilometre post or a milepost; a mile has 5280 ft, 1760 yd or 80 ch."""
Bare = Literal["m", "ft", "km", "mi"]


def metres_of(text: str, bare: Bare = "m") -> float | None:
    """Return the metres that a written place means; None where it means none. A bare number is in the unit ``bare``."""
    cell = _plain(text)
    if match := _PLUS.match(cell):
        value = 1000.0 * float(match["km"]) + float(match["m"])
        return -value if match["sign"] else value
    if match := _KM.match(cell):
        return 1000.0 * float(match["a"] or match["b"])
    if match := _M.match(cell):
        return float(match["m"]) * METRES_PER["m" if match["unit"] else bare]
    if match := _MILES.match(cell):
        whole = float(match["mi"] or match["a"] or match["b"])
        return METRES_PER["mi"] * whole + _from_post(match)
    return None


def is_metres(text: str, bare: Bare = "m") -> bool:
    """Return whether a written place is a length and no number of kilometres."""
    match = _M.match(_plain(text))
    return match is not None and (bool(match["unit"]) or bare in LENGTHS)


def post_and_metres(text: str) -> tuple[int, float] | None:
    """Return the whole kilometre and the metres from it of ``12+1003.5``; None for other notations."""
    match = _PLUS.match(_plain(text))
    return None if match is None or match["sign"] or "." in match["km"] else (int(match["km"]), float(match["m"]))


def milepost_and_metres(text: str) -> tuple[float, float] | None:
    """Return the place of the milepost and the length from it, m, of ``12 mi 345 ft``; None for other notations."""
    match = _MILES.match(_plain(text))
    if match is None or match["mi"] is None or "." in match["mi"]:
        return None
    return METRES_PER["mi"] * float(match["mi"]), _from_post(match)


def _from_post(match: re.Match[str]) -> float:
    return sum(METRES_FROM_POST[unit] * float(match[unit] or 0.0) for unit in ("ch", "yd", "ft"))


def resolution_m(text: str) -> float:
    """Return what the last digit of a written place stands for, m; a bare number is in kilometres."""
    cell = _plain(text)
    decimals = len(match[1]) if (match := re.search(r"\.(\d+)\D*$", cell)) else 0
    if (mile := _MILES.match(cell)) and mile["mi"]:
        unit = next(unit for unit in ("ch", "yd", "ft") if mile[unit])
        return float(10.0**-decimals) * METRES_FROM_POST[unit]
    in_metres = _PLUS.match(cell) or ((bare := _M.match(cell)) and bare["unit"])
    return float(10.0**-decimals) * (1.0 if in_metres else 1000.0)


def written_places(
    official_m: Array, notation: KmNotation = "km+m", *, decimals: int = 2, digits: int = 3, km: Array | None = None
) -> list[str]:
    """Return official places (n,), m, as text; before the zero with a minus, ``-0+050.00``.

    ``decimals`` are those of a metre, ``digits`` the fewest of whole metres. Metres count from the whole kilometres
    ``km`` (n,), where that is NaN or None from the one below.
    """
    whole = 10**decimals
    ticks = np.round(np.abs(official_m) * whole).astype(np.int64)
    signs = np.where(np.asarray(official_m) < 0.0, "-", "").tolist()
    kilometres = ticks // (1000 * whole)
    if notation == "km":
        below = (ticks - 1000 * whole * kilometres).tolist()
        return [f"{sign}{k}.{r:0{3 + decimals}d}" for sign, k, r in zip(signs, kilometres.tolist(), below, strict=True)]
    if km is not None:
        kilometres = np.where(np.isnan(km), kilometres, km).astype(np.int64)
    metres, rest = np.divmod(ticks - 1000 * whole * kilometres, whole)
    parts = zip(signs, kilometres.tolist(), metres.tolist(), rest.tolist(), strict=True)
    if decimals == 0:
        return [f"{sign}{k}+{m:0{digits}d}" for sign, k, m, _ in parts]
    return [f"{sign}{k}+{m:0{digits}d}.{r:0{decimals}d}" for sign, k, m, r in parts]


def _plain(text: str) -> str:
    return text.strip().replace(",", ".")
