"""Units of other systems: how they are written, and what becomes of those that a recording does not know.

A unit is read as a whole, ``mdeg/s``, ``m s^-2``, ``ft/s2``, ``rpm``, and may follow a number, which is then what one
count stands for: ``8.75 mdps/LSB``. A text that is no unit of a quantity is none, however much of it looks like one.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Literal, get_args

from trackfg.numerics.chainage.km_notation import METRES_PER
from trackfg.numerics.units import KMH, KNOT, MPH, STANDARD_GRAVITY, known_units, to_si

Quantity = Literal["angular rate", "acceleration", "angle", "speed", "length", "time", "frequency"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

_FOOT_M = 0.3048
"""International foot (NIST Special Publication 811, appendix B)."""

_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3}
"""Prefixes of SI, and the words for them; the sign of micro is written as ``u`` first."""
_PREFIX = r"(?P<prefix>[numck]|milli|micro|nano|centi|kilo)?"
_ANGLES = {"rad": 1.0, "radian": 1.0, "deg": math.radians(1.0), "degree": math.radians(1.0), "grad": math.radians(1.0)}
"""Of these ``grad`` is the German word for a degree."""
_LENGTHS = {
    **dict.fromkeys(("m", "meter", "metre"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet"), _FOOT_M),
    **dict.fromkeys(("in", "inch", "inche"), _FOOT_M / 12.0),
    **dict.fromkeys(("yd", "yard"), 3.0 * _FOOT_M),
    **dict.fromkeys(("mi", "mile"), METRES_PER["mi"]),
}
_TIMES = {
    **dict.fromkeys(("s", "sec", "second", "sek", "sekunde"), 1.0),
    **dict.fromkeys(("min", "minute"), 60.0),
    **dict.fromkeys(("h", "hr", "hour"), 3600.0),
}
_PER = r"\s?(?:/|per|_per_|_p_|p|_|\*|\.|\s|)\s?"
"""What stands between a unit and the time by which it is divided."""

_TURNS_A_MINUTE = ("rpm", "rev/min", "1/min", "min-1", "min^-1", "u/min", "r/min", "tr/min")
"""Turns a minute in English, German and French; one turn is 2 pi rad."""
_TURNS_A_SECOND = ("rps", "rev/s", "u/s", "tr/s")
_NAMED: dict[Quantity, dict[str, float]] = {
    "angular rate": {
        "dps": math.radians(1.0),
        **dict.fromkeys(_TURNS_A_MINUTE, math.tau / 60.0),
        **dict.fromkeys(_TURNS_A_SECOND, math.tau),
    },
    "acceleration": {
        **dict.fromkeys(("g", "gn", "g0", "gs", "g's"), STANDARD_GRAVITY),
        "gal": 1e-2,
        "mss": 1.0,
        "ms-2": 1.0,
    },
    "angle": {},
    "speed": {
        "kph": KMH,
        "kmh": KMH,
        "kmph": KMH,
        "mph": MPH,
        "fps": _FOOT_M,
        **dict.fromkeys(("kn", "kt", "knot"), KNOT),
    },
    "length": {},
    "time": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "msec": 1e-3},
    "frequency": {
        "khz": 1e3,
        **dict.fromkeys(("hz", "1/s", "s-1", "s^-1", "pulses/s", "pulse/s", "imp/s", "imp./s", "counts/s"), 1.0),
    },
}
"""Units with a name of their own."""
_PREFIXED = ("dps", "g", "gn", "g0", "gal")


def _words(units: dict[str, float]) -> str:
    return "|".join(sorted(map(re.escape, units), key=len, reverse=True))


def _over_time(units: dict[str, float], power: int) -> re.Pattern[str]:
    """Return the pattern of a unit over a time, or over its square."""
    square = r"(?:\^?2|/s|\s?/\s?s(?:ec)?)" if power == 2 else ""
    inverse = r"\^?-" + str(power)
    over = rf"{_PER}(?P<time>{_words(_TIMES)})s?{square}"
    times = rf"[\s*.·]?(?P<inverse>{_words(_TIMES)})\s?{inverse}"
    return re.compile(rf"{_PREFIX}\s?(?P<unit>{_words(units)})s?(?:{over}|{times})")


_PATTERNS: dict[Quantity, tuple[tuple[re.Pattern[str], dict[str, float], int], ...]] = {
    "angular rate": ((_over_time(_ANGLES, 1), _ANGLES, 1),),
    "acceleration": ((_over_time(_LENGTHS, 2), _LENGTHS, 2),),
    "angle": ((re.compile(rf"{_PREFIX}\s?(?P<unit>{_words(_ANGLES)})s?"), _ANGLES, 0),),
    "speed": ((_over_time(_LENGTHS, 1), _LENGTHS, 1),),
    "length": ((re.compile(rf"{_PREFIX}\s?(?P<unit>{_words(_LENGTHS)})s?"), _LENGTHS, 0),),
    "time": ((re.compile(rf"{_PREFIX}\s?(?P<unit>{_words(_TIMES)})s?"), _TIMES, 0),),
    "frequency": (),
}
_NUMBER = re.compile(r"(?P<number>-?\d+(?:[.,]\d*)?(?:e[+-]?\d+)?)\s?[*x]?\s?(?P<rest>\D.*)")
_COUNT = re.compile(r"\s?(?:/|per)\s?(?:lsb|counts?|digits?|bits?|ticks?|increments?)$")
"""What a sample's last bit is called: ``mg/LSB``."""


QUANTITY_CELL = r"^([+\-\u2212]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s?([^\d\s.,;:+\-]\S*(?: [^\d\s]\S*)?)$"
"""The number of a cell, with a decimal point or comma, and what stands behind it."""


def number_and_unit(cell: str) -> tuple[str, str] | None:
    """Return the number of a cell and the unit behind it, as they are written; None where it is not such a cell."""
    match = re.match(QUANTITY_CELL, cell.strip())
    if match is None or all(factor_of(match[2], quantity) is None for quantity in QUANTITIES):
        return None
    return match[1], match[2]


@lru_cache(maxsize=4096)
def factor_of(text: str, quantity: Quantity) -> float | None:
    """Return the factor that turns values in a written unit into SI; None where it is no unit of that quantity."""
    unit = _folded(text)
    if unit not in _NAMED[quantity] and (match := _NUMBER.fullmatch(unit)):
        factor = _plain_factor(match["rest"], quantity)
        return None if factor is None else float(match["number"].replace(",", ".")) * factor
    return _plain_factor(unit, quantity)


_PLAIN = str.maketrans(
    {"µ": "u", "μ": "u", "°": "deg", "º": "deg", "²": "2", "⁻": "-", "¹": "1", "′": "'"}
    | dict(zip("адгкмрсч", "adgkmrsh", strict=True))
)
"""Signs, and the Cyrillic letters of units: ``м/с²``, ``км/ч``, ``рад/с``, ``град/с``."""


_DAMAGED = (
    *(("ådeg", "deg"), ("âdeg", "deg"), ("â2", "2")),
    *(("ø", "deg"), ("¡", "deg"), ("ý", "2")),
    ("\ufffd/", "deg/"),
)
"""Signs of a degree and of a square that were read in another encoding than they were written in: UTF-8 as Windows-1252
has an Â before them, DOS has ø and ý, an old Macintosh ¡. Of a sign that is lost before a slash only a degree is left.
"""


def _folded(text: str) -> str:
    unit = text.strip().strip("[](){}<>").strip().casefold().translate(_PLAIN)
    for damaged, sign in _DAMAGED:
        unit = unit.replace(damaged, sign)
    return unit.replace("**", "^").replace("sec2", "s2")


def _plain_factor(unit: str, quantity: Quantity) -> float | None:
    unit = _COUNT.sub("", unit)
    named = _NAMED[quantity]
    if unit in named:
        return named[unit]
    if unit[-1:] == "s" and unit[:-1] in named:
        return named[unit[:-1]]
    if unit[:1] in _PREFIXES and unit[1:] in named and unit[1:] in _PREFIXED:
        return _PREFIXES[unit[0]] * named[unit[1:]]
    for pattern, units, power in _PATTERNS[quantity]:
        if match := pattern.fullmatch(unit):
            groups = match.groupdict()
            time = groups.get("time") or groups.get("inverse")
            factor = units[match["unit"]] * _prefix(match["prefix"])
            return factor if time is None else factor / _TIMES[time] ** power
    return None


def _prefix(written: str | None) -> float:
    return 1.0 if not written else _PREFIXES["u" if written == "micro" else written[0]]


def recorded_unit(
    text: str, quantity: Literal["angular rate", "acceleration", "speed", "length"]
) -> tuple[str, float] | None:
    """Return the recorded unit of a written one, and the factor on its values: the same unit where a recording knows
    it, else that of SI. None where it is no unit of that quantity.
    """
    factor = factor_of(text, quantity)
    if factor is None:
        return None
    units, name = known_units(quantity), usual_name(text, quantity)
    return (str(name), 1.0) if name in units else (units[0], factor)


def usual_name(text: str, quantity: Quantity) -> str | None:
    """Return a written unit, by the name that recordings have for it if they have one; None for no such unit."""
    factor = factor_of(text, quantity)
    if factor is None or quantity in ("time", "angle", "frequency"):
        return None if factor is None else text
    units = known_units(quantity)
    return next((unit for unit in units if math.isclose(to_si(quantity, unit), factor, rel_tol=1e-12)), text)


def unit_in(text: str, quantity: Quantity) -> str | None:
    """Return the unit of that quantity which a name ends in or has apart (``speed_kmh``, ``km/h front``); else None."""
    if factor_of(text, quantity) is not None:
        return usual_name(text.strip(), quantity)
    words = [word for word in re.split(r"[\s_()\[\];:]+|(?<!\d),|,(?!\d)", text) if word]
    ends = ["".join(words[-2:]), *words[::-1]] if len(words) > 1 else []
    unit = next((word for word in ends if factor_of(word, quantity) is not None), None)
    if unit is None and (match := re.search(r"(?<=[a-z])_?(kmh|kph|mph|mps|dps|knots?|kts)$", text.casefold())):
        unit = match[1]
    return None if unit is None else usual_name(unit, quantity)
