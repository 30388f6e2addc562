"""The names and units of the columns of a table, from the rows above its data."""

from __future__ import annotations

import re

from trackfg.interchange.importing.columns.column_names import in_one_level, meaning
from trackfg.interchange.importing.columns.written_units import QUANTITIES, Quantity, factor_of

_IN_BRACKETS = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()]*)\s*[\])]$")

_UNIT_WORD = re.compile(
    r"-|1|%|v|mv|hz|deg ?c|°?c|k|[hm]?pa|m?bar|u?t|a\.?u\.?|counts?|pulses?|ticks?|imp\.?|lsb|raw|rps|utc|gps|date|"
    r"iso ?8601|hh:?mm:?ss.*|(dd|mm|yyyy|yy)[./-]?(mm|dd)[./-]?.*|bool|int|float|text|string",
    re.IGNORECASE,
)
"""What stands in a row of units besides units of motion."""

_COMMENT = re.compile(r"comments?|remarks?|notes?|bemerkung(en)?|kommentare?", re.IGNORECASE)
"""The last name of a header whose rows leave that cell out where there is nothing to say, as those of LabVIEW do."""

_SENSORS = ("gyro", "accel")

_MARKS = "#%/!* "
"""What a line that is a remark to its reader begins with: the header is often one."""

_AXES = ("x", "y", "z")

_ANGLES = ("latitude", "longitude")
_PARTS_OF_ANGLE = ("deg", "min", "sec")
_SIXTY = 60.0

_AFTER_COMMA = re.compile(r"^(.*\S),\s*(\S+)$")
"""A name with its unit behind a comma, as after ISO 80000: ``Speed, km/h``."""

_LIST_OF = re.compile(r"(columns?|fields?|format|header|units?|spalten|einheit(en)?)\s*[:=]", re.IGNORECASE)
"""The cell before the names, or the units, of the columns in a remark: ``# Columns: time gyro_x``."""

_UNIT_OF: dict[str, Quantity] = {
    "gyro": "angular rate",
    "accel": "acceleration",
    "speed": "speed",
    "latitude": "angle",
    "longitude": "angle",
    "height": "length",
    "distance": "length",
    "time": "time",
}
"""The quantity of the unit below a name, by what the name means."""


def header_of(
    rows: list[list[str]], first: int, width: int, header_row: int | None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the names of the columns and their units: from brackets in the names, and from a row of units.

    Of two rows of names the upper one has one for several columns (``Gyro;;;Accel;;`` above ``X;Y;Z;X;Y;Z``). What
    stands below a row of units describes the columns, unless these are the names. A header may lack the name of a
    column that is always empty, as where rows end in a delimiter, or that of the first one, of numbers of rows.
    """
    data = [row for row in rows[first:] if len(row) == width]
    unmarked = (_with_parts_of_angles(_unmarked(row, width), width, data) for row in rows[:first])
    above = [row for row in (_fitted(row, width, data) for row in unmarked) if any(row)]
    named_row = rows[header_row - 1] if header_row is not None and 0 < header_row <= len(rows) else []
    units_at = next((i for i in range(len(above) - 1, -1, -1) if above[i] != named_row and _are_units(above[i])), None)
    units_row = None if units_at is None else above[units_at]
    if header_row is not None:
        names = _fitted(named_row, width, data) or named_row
    else:
        candidates = above if not units_at else above[:units_at]
        candidates = candidates[1:] if units_at == 0 else candidates
        if units_at and units_at < len(above) - 1 and _quantities(above[-1]) > _quantities(candidates[-1]):
            candidates = above[-1:]
        if units_at == 0 and not candidates:  # a row that looks like units is that of the names
            candidates, units_row = above, None
        names = candidates[-1] if candidates else []
        if len(candidates) > 1 and _repeat(names):
            names = _below(candidates[-2], names)
        elif len(candidates) > 1 and not _quantities(names) and _quantities(candidates[-2]) > 1:
            names = candidates[-2] if all(candidates[-2]) else names  # below them are numbers of channels
    names = [*names, *[""] * (width - len(names))][:width]
    units_row = _below_names(units_row or [""] * width, names)
    stated = {i: unit.strip("[]() ") for i, unit in enumerate(units_row) if unit}
    for i in _merged(names):
        sensor, unit = in_brackets(names[i])
        stated |= {i: unit} if unit and i not in stated else {}
        names[i : i + 3] = [f"{sensor} {axis}" for axis in _AXES]
        stated |= {j: stated[i] for j in (i + 1, i + 2) if i in stated and j not in stated}
    named, taken = [], dict[str, int]()
    arrays = _arrays(names)
    for i, name in enumerate(map(in_one_level, names)):
        plain, unit = in_brackets(name)
        if unit and i not in stated and not (plain in arrays and unit.isdigit()):
            name, stated[i] = plain, unit
        name = name.strip() or f"c{i + 1}"
        taken[name] = taken.get(name, 0) + 1
        named.append(name if taken[name] == 1 else f"{name}.{taken[name]}")
    return tuple(named), {named[i]: unit for i, unit in stated.items() if i < width}


def in_brackets(name: str) -> tuple[str, str]:
    """Return a name without the unit that it has in brackets or behind a comma at its end, and that unit; empty where
    it has none. An axis in brackets is none: ``Accelerometer (z)``.
    """
    match = _IN_BRACKETS.match(name)
    if match and match[2].strip() and match[2].casefold() not in _AXES:
        return match[1].strip(), match[2].strip()
    match = _AFTER_COMMA.match(name)
    if match and any(factor_of(match[2], quantity) is not None for quantity in QUANTITIES):
        return match[1], match[2]
    return name, ""


def _arrays(names: list[str]) -> set[str]:
    """Return the names before numbers in brackets that are those of several columns."""
    stems = [match[1].strip() for name in names if (match := _IN_BRACKETS.match(name)) and match[2].strip().isdigit()]
    return {stem for stem in stems if stems.count(stem) > 1}


def _fitted(row: list[str], width: int, data: list[list[str]]) -> list[str]:
    """Return a row above the data with a cell for each column; empty where it is none of names."""
    if len(row) == width + 1 and (not row[-1] or _COMMENT.fullmatch(row[-1])):
        return row[:-1]
    if 1 < len(row) < width and data and not any(any(cells[len(row) :]) for cells in data):
        return [*row, *[""] * (width - len(row))]
    numbered = bool(data) and all(cells[0].strip('"').isdigit() for cells in data)
    if 1 < len(row) == width - 1 and (numbered or _are_units(row)):
        return ["", *row]
    return row if len(row) == width else []


def _with_parts_of_angles(row: list[str], width: int, data: list[list[str]]) -> list[str]:
    """Return a row of names with three for each angle whose degrees, minutes and seconds are parted by blanks."""
    angles = [i for i, name in enumerate(row) if meaning(name) in _ANGLES]
    if not angles or len(row) + 2 * len(angles) != width:
        return row
    out: list[str] = []
    for i, name in enumerate(row):
        if i in angles and not all(_is_below_sixty(cells[len(out) + k]) for cells in data for k in (1, 2)):
            return row
        out += [f"{name} {part}" for part in _PARTS_OF_ANGLE] if i in angles else [name]
    return out


def _is_below_sixty(cell: str) -> bool:
    return cell.replace(".", "", 1).isdecimal() and float(cell) <= _SIXTY


def _unmarked(row: list[str], width: int) -> list[str]:
    """Return a row above the data without the mark of a remark, which may be a cell of its own before the others."""
    first = row[0].lstrip(_MARKS) if row else ""
    listed = row[1:] if row and not first else [first, *row[1:]]
    if len(listed) == width + 1 and _LIST_OF.fullmatch(listed[0]):
        return listed[1:]
    return [first, *row[1:]] if first else row[1:] if len(row) == width + 1 and row[0] else row


def _merged(names: list[str]) -> list[int]:
    """Return the first places of names that stand for the three axes of a sensor, as merged cells do: two more are
    empty, or ``1`` and ``2``, as of a GoPro.
    """
    places = range(len(names) - 2)
    unnamed = [i for i in places if names[i + 1 : i + 3] in (["", ""], ["1", "2"])]
    return [i for i in unnamed if meaning(f"{in_brackets(names[i])[0]} x") in _SENSORS]


def _below_names(units: list[str], names: list[str]) -> list[str]:
    """Return a row of units with each below its name: one that lacks a cell may lack the first or the last one."""
    if units[0] or not any(units):
        return units

    def fitting(row: list[str]) -> int:
        pairs = (
            (unit.strip("[]() "), _UNIT_OF.get(meaning(name) or "")) for unit, name in zip(row, names, strict=True)
        )
        return sum(quantity is not None and factor_of(unit, quantity) is not None for unit, quantity in pairs)

    return max((units, [*units[1:], ""]), key=fitting)


def _quantities(names: list[str]) -> int:
    """Return how many names mean a quantity."""
    return sum(meaning(name) is not None for name in names)


def _repeat(names: list[str]) -> bool:
    filled = [name for name in names if name]
    return len(set(filled)) < len(filled)


def _below(upper: list[str], names: list[str]) -> list[str]:
    """Return names after that of the group which the row above has for them: its last one that is not empty.

    The group's unit, in brackets, is that of each name that has none.
    """
    out, group = [], ""
    for cell, name in zip(upper, names, strict=True):
        group = cell or group
        match = _IN_BRACKETS.match(group) if name and not _IN_BRACKETS.match(name) else None
        out.append(f"{match[1]} {name} [{match[2]}]" if match else f"{group} {name}".strip())
    return out


def _are_units(row: list[str]) -> bool:
    filled = [cell for cell in row if cell]
    return bool(filled) and sum(_is_unit(cell) for cell in filled) > 0.5 * len(filled)


def _is_unit(cell: str) -> bool:
    word = cell.strip("[]() ")
    return bool(_UNIT_WORD.fullmatch(word)) or any(factor_of(word, quantity) is not None for quantity in QUANTITIES)
