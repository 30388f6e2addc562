"""What the columns of a foreign table probably mean, from their names, their units and their values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.calendar_columns import COMPOSED
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times import guessed_unit
from trackfg.numerics.km_notation import is_metres, metres_of
from trackfg.numerics.units import STANDARD_GRAVITY

_AXIS = re.compile(
    r"(?:^|[\s_.\-/])([xyzXYZ])(?:$|[\s_.\-/\[(])|([xyz])(?=$|_|\d|\s)|(?<=[a-z])([XYZ])(?![a-z])|(?<=^[AGW])([XYZ])$"
)
_NAMED_AXIS = {
    "x": re.compile(r"roll|wank|longitudinal|\blong(?=acc|\W)|l(ä|ae)ngs"),
    "y": re.compile(r"pitch|nick|lateral|\blat(?=acc|\W)|quer"),
    "z": re.compile(r"yaw|gier|vertical|vertikal|\bvert(?=acc|\W)|hoch"),
}
"""Axes of a vehicle in words, English and German: of rotation rates, and of forces along the same axes."""
_PATTERNS = {
    "free_accel": r"linear.?acc|user.?acc|without.?g|ohne.?g|free.?acc|lin.?acc|gravity.?free",
    "gyro": (
        r"gyr|omega|ang(ular)?[\s_]*(vel|rate)|vitesse.(ang|de.rot)|drehrate|rotation.?rate|(roll|pitch|yaw).?rate|(wank|nick|gier).?(rate|geschw)|"
        r"\bw[\s_]?[xyz]\b|^w_?[xyz]|^g_?[xyz]\b|dtheta|delta.?(theta|ang)"
    ),
    "accel": r"acc(?!ur)|beschl|specific.?force|^f_?[xyz]\b|^[ab][\s_]?[xyz]\b|^f[xyz]_|dvel|delta.?v",
    "speed": r"speed|geschw|veloc|vitesse|twist.*linear\.x|^v$|^v[\s_\[(]|kmh|km/h",
    "count": (
        r"pulse|impuls|^(?!.*(packet|sample|frame|sat|error|message|msg|seq)).*count|"
        r"ticks|in[ck]rement|\benc(oder)?\b|encoder|tacho|zähl"
    ),
    "distance": r"odo|dist|^weg|wegstrecke|mileage",
    "balise": r"(balise|rfid|transponder|beacon|tag|epc)[\s_.-]?(id|nr|no|number|nummer|code)?\.?$",
    "station": r"chain|kilom|station(?!ary|.?(id|name|code|no|nr))|^km\b|^[pm][kp]$|^miles?$|post|position_km",
    "latitude": r"^lat|latitude|breite",
    "longitude": r"^lon|^lng|longitude|länge|laenge",
    "height": r"^alt|altitude|height|höhe|hoehe|^h$|ellh",
    "sd_horizontal": r"h(or\w*)?_?acc|horizontal.?accuracy|^accuracy|sd_?[neh]\b",
    "sd_vertical": r"v(er\w*)?_?acc\b|vertical.?accuracy|altitude.?accuracy|sd_?[uv]\b",
    "time": r"^t$|time|zeit|uhr|datum|date|utc|stamp|elapsed|epoch|heure|seconds?$|^ts$",
}
"""In the order in which they are tried. English, German, some French; anything else has to be stated."""

_GYRO_UNITS = {
    r"mrad": "mrad/s",
    r"(deg|°|grad)\s?/?\s?(s|sec)?$|(?<!ra)dps|deg_?p?s": "deg/s",
    r"(deg|°)/h": "deg/h",
    r"rad": "rad/s",
}
_IMU_UNITS = {
    "gyro": re.compile(r"(m?rad|deg|°|grad)\s?/\s?(s|sec|h)|dps"),
    "accel": re.compile(r"m?g|gal|m\s?/\s?s\s?(\^2|²|/s)"),
}
"""Units that say by themselves that a column is a gyro's or an accelerometer's."""
_WITH_GRAVITY = {"m/s^2": (0.8 * STANDARD_GRAVITY, 1.2 * STANDARD_GRAVITY), "g": (0.8, 1.2), "mg": (800.0, 1200.0)}
"""Median specific force of a vehicle on a track, with scale and bias of the worst sensors."""
_TIME_UNITS = {"ns": "ns", "us": "us", "µs": "us", "ms": "ms", "s": "s", "sec": "s", "seconds": "s"}
_INCREMENT = re.compile(r"^d_?(theta|vel|v(?![a-z]))|delta|incr", re.IGNORECASE)
"""What the name of an increment per sample begins with or contains."""
_INCREMENT_UNITS = {"gyro": {"rad": "rad", "deg": "deg"}, "accel": {"m/s": "m/s", "mps": "m/s"}, "free_accel": {}}
_ACCEL_UNITS = {r"^mg$": "mg", r"^g$|_g$": "g", r"gal": "gal", r"m.?/?.?s": "m/s^2"}


@dataclass(frozen=True)
class Triple:
    """Three columns x, y, z of a table and their unit; ``known`` is false where the unit is guessed from the values."""

    table: SourceTable
    columns: tuple[str, str, str]
    unit: str
    known: bool


def meaning(name: str) -> str | None:
    """Return the kind of quantity that a column's name means; None where it means none that is known."""
    folded = name.casefold().strip()
    kinds = _PATTERNS if axis_of(name) else [kind for kind in _PATTERNS if kind not in ("gyro", "accel", "free_accel")]
    return next((kind for kind in kinds if re.search(_PATTERNS[kind], folded)), None)


def kind_in(table: SourceTable, name: str) -> str | None:
    """Return the kind of quantity of a table's column: by an inertial unit, its name, or cells that are places."""
    kind = meaning(name)
    if axis_of(name) and kind != "free_accel" and (by_unit := _kind_by_unit(table.units.get(name, ""))):
        return by_unit
    return "station" if kind is None and _holds_places(table.frame[name]) else kind


def _holds_places(column: pd.Series) -> bool:
    """Return whether all cells are places written as such, ``12+345`` or ``12.345 km``, not bare numbers."""
    if not pd.api.types.is_string_dtype(column):
        return False
    cells = column.dropna()
    return len(cells) > 0 and all(metres_of(cell) is not None and not is_metres(cell) for cell in cells)


def axis_of(name: str) -> str | None:
    """Return the axis that a column's name ends in or has apart, ``"x"``, ``"y"`` or ``"z"``, or names; else None."""
    axis, _ = _axis_and_rest(name)
    return axis


def _axis_and_rest(name: str) -> tuple[str | None, str]:
    """Return the axis in a name, None where there is none, and the name's other letters in alphabetical order."""
    folded = name.casefold()
    found = [next(filter(None, match)) for match in _AXIS.findall(name)]
    if found:
        axis = found[-1].casefold()
        return axis, "".join(sorted(folded.replace(axis, "", 1)))
    for axis, words in _NAMED_AXIS.items():
        if words.search(folded):
            return axis, "".join(sorted(words.sub("", folded, count=1)))
    return None, folded


def triples(table: SourceTable, kind: Literal["gyro", "accel", "free_accel"]) -> list[Triple]:
    """Return the triples of columns of one kind, by name or else by unit, with equal names but for the axis."""
    found: dict[str, dict[str, str]] = {}
    for name in table.columns:
        axis, rest = _axis_and_rest(name)
        if axis and kind == kind_in(table, name):
            found.setdefault(rest, {})[axis] = name
    out = []
    for axes in found.values():
        if len(axes) == 3:
            columns = (axes["x"], axes["y"], axes["z"])
            unit, known = _unit(table, columns, kind)
            out.append(Triple(table, columns, unit, known))
    return out


def has_gravity(triple: Triple) -> bool:
    """Return whether an acceleration holds gravity, whatever its name says: ROS has it in ``linear_acceleration``."""
    low, high = _WITH_GRAVITY.get(triple.unit, (np.inf, np.inf))
    values = np.stack([triple.table.numbers(name) for name in triple.columns])
    with np.errstate(over="ignore"):  # damaged values may be of any size
        return bool(low < np.nanmedian(np.linalg.norm(values, axis=0)) < high)


def _kind_by_unit(unit: str) -> str | None:
    return next((kind for kind, units in _IMU_UNITS.items() if units.fullmatch(unit.casefold().strip())), None)


def _unit(table: SourceTable, columns: tuple[str, str, str], kind: str) -> tuple[str, bool]:
    stated = table.units.get(columns[0]) or columns[0].rpartition("_")[2]
    if _INCREMENT.search(columns[0]) and (unit := _INCREMENT_UNITS[kind].get(stated.casefold().replace("°", "deg"))):
        return unit, True
    for pattern, unit in (_GYRO_UNITS if kind == "gyro" else _ACCEL_UNITS).items():
        if re.search(pattern, stated.casefold().replace("²", "^2").strip()):
            return unit, True
    values = np.stack([table.numbers(name) for name in columns])
    values = values[:, np.isfinite(values).all(axis=0)]
    if values.size == 0:
        raise BadInputError(f"{table.name}: columns {', '.join(columns)} are empty; expected values")
    if kind == "gyro":
        # A rail vehicle turns by at most some 10 deg/s: values above 0.5 are degrees.
        return ("deg/s" if float(np.quantile(np.abs(values), 0.99)) > 0.5 else "rad/s"), False
    with np.errstate(over="ignore"):  # damaged values may be of any size
        size = float(np.median(np.linalg.norm(values, axis=0)))
    units = {"m/s^2": STANDARD_GRAVITY, "g": 1.0, "mg": 1000.0}
    return min(units, key=lambda unit: abs(np.log(max(size, 1e-9) / units[unit]))), False


def first_of(table: SourceTable, kind: str) -> str | None:
    """Return the first column whose name means ``kind``; None where there is none."""
    return next((name for name in table.columns if kind_in(table, name) == kind), None)


def time_columns(table: SourceTable) -> tuple[str, ...] | None:
    """Return the column of the time, or those of date and time of day; None where none is found.

    A date that was put together of its parts is preferred, then a column whose name means a time, of several the finest
    one; else the first that grows steadily.
    """
    if COMPOSED in table.columns:
        return (COMPOSED,)
    named = [name for name in table.columns if meaning(name) == "time"]
    text = [name for name in named if pd.api.types.is_string_dtype(table.frame[name])]
    if len(text) >= 2:
        first, second = (str(table.frame[name].iloc[0]) for name in text[:2])
        if ":" not in first and ":" in second:
            return (text[0], text[1])
        if ":" in first and ":" not in second:
            return (text[1], text[0])
    numeric = [name for name in named if name not in text and _grows(table.numbers(name))]
    if numeric:
        return (max(numeric, key=lambda name: _resolution(table.numbers(name))),)
    if text:
        return (text[0],)
    return next(
        ((name,) for name in table.columns if not pd.api.types.is_string_dtype(table.frame[name])
         and len(table.frame) > 2 and _grows(table.numbers(name)) and _steady(table.numbers(name))),
        None,
    )  # fmt: skip


def _grows(values: np.ndarray) -> bool:
    step = np.diff(values)
    return bool(np.isfinite(values).all() and values.size > 1 and (step >= 0).mean() > 0.999 and (step > 0).any())


def _resolution(values: np.ndarray) -> int:
    """Return how many different values there are: a Unix time in ms is finer than a counter of seconds."""
    return int(np.unique(values).size)


def _steady(values: np.ndarray) -> bool:
    step = np.diff(values)
    return bool((step > 0).all() and np.median(np.abs(step - np.median(step))) < 0.2 * np.median(step))


def time_unit(
    table: SourceTable, columns: tuple[str, ...], beside: tuple[SourceTable, str] | None = None
) -> str | None:
    """Return the unit of a numeric time column, from its name, its stated unit or its values; None for text.

    ``beside``: the table of the inertial sensor and its column of times, which events within it are counted like.
    """
    if len(columns) == 2 or pd.api.types.is_string_dtype(table.frame[columns[0]]):
        return None
    stated = table.units.get(columns[0], "").casefold() or columns[0].casefold().rpartition("_")[2]
    if stated in _TIME_UNITS:
        return _TIME_UNITS[stated]
    values = table.numbers(columns[0])
    if beside is not None and not pd.api.types.is_string_dtype(beside[0].frame[beside[1]]):
        t = beside[0].numbers(beside[1])
        if np.nanmin(t) <= np.nanmin(values) and np.nanmax(values) <= np.nanmax(t):
            return time_unit(beside[0], (beside[1],))
    return guessed_unit(values)
