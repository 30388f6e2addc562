"""What the columns of a foreign table probably mean, from their names, their units and their values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import (
    axis_and_rest,
    complete_vectors,
    is_other,
    meaning,
    names_axis_in_words,
    parts_of,
)
from trackfg.interchange.importing.columns.time_columns import stated_rate_hz, time_columns, times_in
from trackfg.interchange.importing.columns.written_units import Quantity, factor_of, usual_name
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.chainage.km_notation import is_metres, metres_of
from trackfg.numerics.units import KMH, MPH, STANDARD_GRAVITY

InertialKind = Literal["gyro", "accel", "free_accel"]

QUANTITY_OF: dict[str, Quantity] = {"gyro": "angular rate", "accel": "acceleration", "free_accel": "acceleration"}
"""What a sensor measures, and below what its increments per sample are."""
INCREMENT_OF: dict[str, Quantity] = {"gyro": "angle", "accel": "speed", "free_accel": "speed"}

_INCREMENT = re.compile(r"^d_?(theta|vel|v(?![a-z]))|delta|inc(?=$|r|[\s_.\[(])", re.IGNORECASE)
"""What the name of an increment per sample begins with or contains."""
_INCREMENT_UNIT = "m/s"
"""Unit of an accelerometer whose samples are as large as gravity times their interval: nothing else is."""
_BARE = re.compile(r"(axis|achse)?[\s_]*[xyz][\s_]*(axis|achse|value|wert)?", re.IGNORECASE)
"""Names of columns that say their axis alone."""
_NUMBERED = re.compile(r"(?P<stem>.*?)[\s_]?[\[(]?(?P<number>\d)[\])]?")
_VALUES = re.compile(r"v|val|values?|data|", re.IGNORECASE)
_NUMBERS = ({1, 2, 3}, {0, 1, 2})
"""Names of the parts of a vector: a number behind the name of the sensor, or behind one that says nothing."""
_WHEEL = re.compile(r"wheel|whl|axle|\brad(drehzahl|geschw\w*)?\b|achs|колес")
"""What stands beside the unit of a speed, or of turns, in the name of a wheel's."""
_OF_A_WHEEL: tuple[Quantity, ...] = ("speed", "angular rate")
_OF_NO_SPEED: tuple[Quantity, ...] = ("length", "acceleration", "angle")
"""Quantities whose unit makes a column that is named like a speed none."""
_SPEEDS_OF_VEHICLES = (KMH, MPH)
"""Units, in m/s, that only the speed of a vehicle is given in, whatever its name; components and sigmas are in m/s."""
_BY_UNIT: tuple[tuple[Quantity, str], ...] = (
    *((quantity, "speed") for quantity in _OF_A_WHEEL),
    ("length", "distance"),
    ("frequency", "pulse rate"),
)
"""What a column named after a counter is by its unit: a tachometer may show a speed, too."""
_COUNTS = re.compile(
    r"|[-#1n]|0/1|bool\w*|ttl|digital|(pulse|count|tick|edge|rev|turn)s?|(imp|inc|ink)\w*\.?|lsb|raw|int\d*",
    re.IGNORECASE,
)
"""What stands in the place of a counter's unit."""
_SAYS_NOTHING = re.compile(r"data|values?|log|samples|raw|output|export|sheet\d*|tabelle\d*", re.IGNORECASE)
"""Names of files that say nothing of what is in them."""
_COUNT = r"(?:LSB|count|digit|bit)s?"
_NUMBER = r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?"
_UNIT_OF_A_COUNT = re.compile(rf"{_NUMBER}\s?[^\s\d]\S*?\s?(?:/|per)\s?{_COUNT}\b", re.IGNORECASE)
_COUNTS_OF_A_UNIT = re.compile(rf"({_NUMBER})\s?{_COUNT}\s?(?:/|per)\s?(\S+)", re.IGNORECASE)
"""What remarks say of one count, and how many counts they say that a unit has."""
_SCALE = re.compile(rf"^(?P<key>[ga]scale)\W(?P<number>{_NUMBER})\s*$", re.MULTILINE)
_UNIT_OF_SCALE = {"gscale": "rad/s", "ascale": "g"}
"""What a count of gyro and accelerometer is worth above the table of a GCSV log (Gyroflow), and in which unit."""
_GRAVITY_BAND = (0.8, 1.2)
"""Median specific force of a vehicle on a track, g, with scale and bias of the worst sensors."""
_FASTEST_TURN_DEG = 0.5
"""A rail vehicle turns by at most some 10 deg/s: rates above so much are no rad/s."""
_RATE = re.compile(r"/|per|-1|hz|rps", re.IGNORECASE)
"""What the written unit of a rate has; other words in its place, such as raw or LSB, are no unit."""
_SAMPLE = 10_000
"""Cells of a column that decide whether it holds whole numbers."""


@dataclass(frozen=True)
class Triple:
    """Three columns x, y, z of a table and their unit.

    ``known``: the source states the unit; else it is guessed from the values. An empty unit: neither shows it.
    """

    table: SourceTable
    columns: tuple[str, str, str]
    unit: str
    known: bool

    def values(self) -> np.ndarray:
        """Return the values (3, n) of rows that have all three."""
        values = np.stack([self.table.numbers(name) for name in self.columns])
        return np.asarray(values[:, np.isfinite(values).all(axis=0)])


def full_name(table: SourceTable, name: str) -> str:
    """Return the name of a column, after that of its table where it says no more than an axis: ``gyro x``."""
    return f"{stem_of(table.name)} {name}" if _BARE.fullmatch(name.strip()) else name


def stem_of(name: str) -> str:
    """Return what the name of a table says of its content: that of its file, or of the folder of a ``data.csv``."""
    parts = [re.sub(r"\.[A-Za-z0-9]{1,8}$", "", part) for part in name.split("/")]
    words = [part for part in parts if not _SAYS_NOTHING.fullmatch(part)]
    return words[-1] if words else parts[-1]


def kind_in(table: SourceTable, name: str) -> str | None:
    """Return the kind of quantity of a table's column: by an inertial unit, its name, or cells that are places."""
    name, column = full_name(table, name), name
    kind, unit = meaning(name), _stated_unit(table, column)
    axis, _ = axis_and_rest(name, unit)
    if axis and kind != "free_accel" and not is_other(name) and (by_unit := _kind_by_unit(unit)):
        return by_unit
    turns_or_rolls = any(unit and factor_of(unit, quantity) is not None for quantity in _OF_A_WHEEL)
    if kind is None and turns_or_rolls and _WHEEL.search(name.casefold()):
        return "speed"
    if kind is None and axis is None and unit and factor_of(unit, "speed") in _SPEEDS_OF_VEHICLES:
        return "speed"
    if kind == "speed" and any(unit and factor_of(unit, quantity) is not None for quantity in _OF_NO_SPEED):
        return None
    if kind == "count" and factor_of(unit, "time") is not None:
        # Of pulses per 100 ms a table that is written faster holds each, and one written more seldom lacks some.
        return None
    if kind == "count":
        by_unit = next((of for quantity, of in _BY_UNIT if factor_of(unit, quantity) is not None), None)
        return by_unit or (kind if _COUNTS.fullmatch(unit.strip("[]() ")) else None)
    return "station" if kind is None and _holds_places(table.frame[column]) else kind


def _stated_unit(table: SourceTable, name: str) -> str:
    return table.units.get(name) or parts_of(name).unit


def _kind_by_unit(unit: str) -> str | None:
    return next((kind for kind in ("gyro", "accel") if unit and factor_of(unit, QUANTITY_OF[kind]) is not None), None)


def _holds_places(column: pd.Series) -> bool:
    """Return whether all cells are places written as such, ``12+345`` or ``12.345 km``, not bare numbers."""
    if not pd.api.types.is_string_dtype(column):
        return False
    cells = column.dropna()
    return len(cells) > 0 and all(metres_of(cell) is not None and not is_metres(cell) for cell in cells)


def triples(table: SourceTable, kind: InertialKind) -> list[Triple]:
    """Return the triples of columns of one kind, by name or else by unit, with equal names but for the axis.

    Axes in letters are those of the sensor, in words (``forward``, ``lateral``, ``down``) those of the vehicle: a
    triple has axes of both only where there is no other.
    """
    by_notation: dict[tuple[str, bool], dict[str, str]] = {}
    by_axis: dict[str, dict[str, str]] = {}
    for name in table.columns:
        full = full_name(table, name)
        axis, rest = axis_and_rest(full, _stated_unit(table, name))
        if axis and kind == kind_in(table, name) and pd.api.types.is_numeric_dtype(table.frame[name]):
            by_notation.setdefault((rest, names_axis_in_words(full)), {})[axis] = name
            by_axis.setdefault(rest, {}).setdefault(axis, name)
    vectors = complete_vectors(by_notation) or complete_vectors(by_axis) or _numbered(table, kind)
    return [triple_of(table, columns, kind) for columns in vectors]


def _numbered(table: SourceTable, kind: InertialKind) -> list[tuple[str, str, str]]:
    """Return the columns of vectors whose parts are numbered, from 1 or from 0: ``Acceleration_1`` to ``_3``.

    The name before the number, or the table's where it says nothing, is that of a sensor of this ``kind``.
    """
    groups: dict[str, dict[int, str]] = {}
    for name in table.columns:
        match = _NUMBERED.fullmatch(name.strip())
        if match and pd.api.types.is_numeric_dtype(table.frame[name]):
            sensor = stem_of(table.name) if _VALUES.fullmatch(match["stem"]) else match["stem"]
            if meaning(f"{sensor} x") == kind:
                groups.setdefault(match["stem"], {})[int(match["number"])] = name
    vectors = [[parts[i] for i in sorted(parts)] for parts in groups.values() if set(parts) in _NUMBERS]
    return [(x, y, z) for x, y, z in vectors]


def nameless_triples(table: SourceTable) -> list[tuple[str, str, str]]:
    """Return the columns x, y, z of triples whose names say no more than their axes: of no quantity that is known."""
    groups: dict[str, dict[str, str]] = {}
    for name in table.columns:
        axis, rest = axis_and_rest(name)
        plain = axis is not None and kind_in(table, name) is None and not is_other(full_name(table, name))
        if axis is not None and plain and pd.api.types.is_numeric_dtype(table.frame[name]):
            groups.setdefault(rest, {})[axis] = name
    return complete_vectors(groups)


def triple_of(table: SourceTable, columns: tuple[str, str, str], kind: InertialKind) -> Triple:
    """Return columns x, y, z of a table as a sensor's, with the unit that the source states or the values show."""
    return Triple(table, columns, *_unit(table, columns, kind))


def keeps_gravity(triple: Triple) -> bool:
    """Return whether nearly all vectors are as long as gravity in a usual unit: rates seldom are, or as even."""
    lengths = np.linalg.norm(triple.values(), axis=0)
    factor = factor_of(triple.unit, "acceleration")
    if factor is None or not lengths.size:
        return False
    low, high = np.quantile(lengths, (0.1, 0.9)) * factor / STANDARD_GRAVITY
    return bool(_GRAVITY_BAND[0] < low and high < _GRAVITY_BAND[1])


def has_gravity(triple: Triple) -> bool:
    """Return whether an acceleration holds gravity, whatever its name says: ROS has it in ``linear_acceleration``."""
    factor = factor_of(triple.unit, "acceleration")
    return factor is not None and bool(
        _GRAVITY_BAND[0] < _median_size(triple.values()) * factor / STANDARD_GRAVITY < _GRAVITY_BAND[1]
    )


def _median_size(values: np.ndarray) -> float:
    """Return the median length of vectors (3, n); 0 without any."""
    with np.errstate(over="ignore"):  # damaged values may be of any size
        return float(np.median(np.linalg.norm(values, axis=0))) if values.size else 0.0


def _unit(table: SourceTable, columns: tuple[str, str, str], kind: InertialKind) -> tuple[str, bool]:
    """Return the unit of three columns, and whether the source states it; empty where nothing shows it."""
    stated = _stated_unit(table, columns[0])
    units = [_stated_unit(table, name) for name in columns]
    if len({factor_of(unit, QUANTITY_OF[kind]) for unit in units}) > 1:
        raise BadInputError(
            f"{table.name}: columns {', '.join(columns)} are in {', '.join(unit or 'no unit' for unit in units)}; "
            "expected one unit for all three"
        )
    if (unit := usual_name(stated, QUANTITY_OF[kind])) is not None:
        return unit, True
    per_sample = factor_of(stated, INCREMENT_OF[kind]) is not None
    if per_sample and _INCREMENT.search(columns[0]):
        return stated, True
    values = Triple(table, columns, "", known=False).values()
    if values.size == 0:
        raise BadInputError(f"{table.name}: columns {', '.join(columns)} are empty; expected values")
    if kind != "gyro":
        return _unit_by_gravity(table, values)
    if per_sample:
        return f"{stated}/s", False  # degrees or radians that a table calls so for short
    if _are_counts(values):
        return next((scale for scale in _scales(table) if factor_of(scale, "angular rate") is not None), ""), False
    if _RATE.search(stated):
        return "", False  # one that is not known: motion cannot distinguish a gon from a degree
    return ("deg/s" if _turns_fast(values) else "rad/s"), False


def _unit_by_gravity(table: SourceTable, values: np.ndarray) -> tuple[str, bool]:
    """Return the unit in which the specific force is that of gravity: a usual one, or what one count is worth."""
    size = _median_size(values)
    if not 0.0 < size < np.inf:
        return "", False
    candidates = ("m/s^2", "g", "mg", *(unit for unit in _scales(table) if factor_of(unit, "acceleration")))
    ratios = {unit: size * (factor_of(unit, "acceleration") or 0.0) / STANDARD_GRAVITY for unit in candidates}
    nearest = min(candidates, key=lambda unit: abs(np.log(ratios[unit])))
    if _GRAVITY_BAND[0] < ratios[nearest] < _GRAVITY_BAND[1]:
        return nearest, True
    if _are_counts(values):
        return f"{1000.0 / size:.6g} mg", False
    interval = _interval_s(table)
    of_increments = interval is not None and _GRAVITY_BAND[0] < size / (STANDARD_GRAVITY * interval) < _GRAVITY_BAND[1]
    return (_INCREMENT_UNIT, True) if of_increments else ("", False)


def _interval_s(table: SourceTable) -> float | None:
    """Return the usual interval of a table's rows, s; None where it has no times and states no sampling rate."""
    columns = time_columns(table)
    if columns is None:
        rate = stated_rate_hz(table)
        return None if rate is None else 1.0 / rate
    try:
        times = times_in(table, columns)
    except BadInputError:
        return None
    return float(np.median(np.diff(times.since(times.first_ns)))) if len(table.frame) > 1 else None


def _turns_fast(rates: np.ndarray) -> bool:
    """Return whether rates (3, n) are too fast to be rad/s of a rail vehicle."""
    return float(np.quantile(np.abs(rates), 0.99)) > _FASTEST_TURN_DEG


def unit_of_turns(triple: Triple) -> str:
    """Return the probable unit of a gyro's increments per sample."""
    return "deg" if _turns_fast(triple.values() / (_interval_s(triple.table) or 1.0)) else "rad"


def are_increments(triple: Triple) -> bool:
    """Return whether columns of an accelerometer are changes of velocity from sample to sample."""
    return bool(triple.unit) and factor_of(triple.unit, INCREMENT_OF["accel"]) is not None


def is_called_increment(triple: Triple) -> bool:
    """Return whether the names of columns are those of increments per sample."""
    return _INCREMENT.search(triple.columns[0]) is not None


def _are_counts(values: np.ndarray) -> bool:
    """Return whether values are what a converter gives, whole numbers of which some are large."""
    some = values[:, :: max(1, values.shape[1] // _SAMPLE)]
    return bool((some == np.floor(some)).all() and np.abs(some).max(initial=0.0) >= 2.0)


def _scales(table: SourceTable) -> list[str]:
    """Return what remarks above the table say of one count: ``8.75 mdps/LSB``, or inversely ``131 LSB/(deg/s)``."""
    inverse = ((float(match[1]), match[2].strip("().,;")) for match in _COUNTS_OF_A_UNIT.finditer(table.remarks))
    scales = [f"{match['number']} {_UNIT_OF_SCALE[match['key']]}" for match in _SCALE.finditer(table.remarks)]
    counts = [f"{1.0 / count:.9g} {unit}" for count, unit in inverse if count]
    return _UNIT_OF_A_COUNT.findall(table.remarks) + counts + scales


def first_of(table: SourceTable, kind: str) -> str | None:
    """Return the first column whose name means ``kind``; None where there is none."""
    return next((name for name in table.columns if kind_in(table, name) == kind), None)


def has_axes_beside(table: SourceTable, name: str) -> bool:
    """Return whether a column is one of a vector: others have the same name but for the axis."""
    axis, rest = axis_and_rest(name)
    same = [other for other in table.columns if axis is not None and axis_and_rest(other)[1] == rest]
    return len({parts_of(other).axis for other in same}) > 1
