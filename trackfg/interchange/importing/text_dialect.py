"""How a file of delimited text is written: its encoding, delimiter, decimal sign, header and units.

All of it is guessed from the first part of the file, and any of it may be given instead.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import in_one_level, meaning
from trackfg.interchange.importing.columns.written_units import QUANTITIES, Quantity, factor_of, number_and_unit
from trackfg.numerics.chainage.km_notation import metres_of
from trackfg.recording.strict_model import Model

_SAMPLE_BYTES = 200_000
"""What is looked at: some thousand rows."""

_DELIMITERS = (";", "\t", ",", "|")
_BLANKS = "blanks"
"""The delimiter of columns that are aligned by any number of blanks."""

_NUMBER = re.compile(
    r"[+\-\u2212]?(\d+([.,]\d*)?|[.,]\d+|\d{1,3}([.,'\u2019\u00a0\u202f ])\d{3}(\3\d{3})*([.,]\d*)?)([eEdD][+-]?\d+)?$"
)
"""Its digits may be in groups of three, and its sign that of typesetters, as Swedish and other locales write it."""
_DECIMAL_COMMA = re.compile(r"[+\-\u2212]?\d*,\d+([eE][+-]?\d+)?$")
_DECIMAL_POINT = re.compile(r"[+\-\u2212]?\d*\.\d+([eE][+-]?\d+)?$")
_GROUPS = re.compile(r"[+\-\u2212]?[1-9]\d{0,2}(\.\d{3})+$")
"""Digits in groups of three with points between, or a number with three decimals."""
_TIME_COMMA = re.compile(r"\d:\d{2},\d+$")
_OPEN_CELL = re.compile(r'(^|[;,\t|])\s*"[^"]*$')
"""A line that ends within a cell."""
_SHORT_WORD = 3
_MOST_LINES = 100
"""Lines of a header with line breaks in its names."""
_TEMPORAL = re.compile(r"(-?\d+ days?,? \+?)?\d{1,4}[-./:]\d{1,2}([-./:T ]\d{1,4}[^,;|\t]*(,\d+[^,;|\t]*)?)?$")
"""A date, a time of day, both, or a number of days and a time.

It has at most one comma, before decimals; other signs and words begin a new cell.
"""
_LISTED = re.compile(r"[\[(][\s\d.,;eE+-]+[\])]$")
"""Numbers in brackets, as lists are written."""
_WORD = re.compile(r"[^\W\d_]{3}")
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
_MOST_SUMMARY_ROWS = 20
"""Rows below the data that name what they sum up: mean, maximum, number of rows; more of them are data."""
_MARKS = "#%/!* "
"""What a line that is a remark to its reader begins with: the header is often one."""
_REMARK = re.compile(r"#|%|//|!|\*\*")
_RULE = re.compile(r"[-+=|: ]*(---|===)[-+=|: ]*|\(?\d+ rows?( in set.*)?\)?")
"""A line that rules off a table, or says how many rows it has, as databases print it."""
_AXES = ("x", "y", "z")
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
EMPTY_CELLS = (
    *("", "-", "--", "---", "----", "*", "**", "***", "?", ".", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "#N/A", "#NV"),
    *(
        "#DIV/0!",
        "#VALUE!",
        "#REF!",
        "#NUM!",
        "#NAME?",
        "#NULL!",
        "#WERT!",
        "#BEZUG!",
        "#ZAHL!",
        "#VALEUR!",
        "#NOMBRE!",
    ),
    *("null", "NULL", "Null", "None", "none", "nil", "\\N", "missing", "inf", "-inf", "Inf", "-Inf", "INF", "-INF"),
    *(
        f"{sign}1.#{name}{zeros}"
        for sign in ("", "-")
        for name in ("QNAN", "IND", "INF", "SNAN")
        for zeros in ("", "0", "00")
    ),
)
"""What a cell without a value holds, also as spreadsheets show a formula without one, and as C libraries of Windows
print it (``-1.#IND``)."""
_EMPTY = frozenset(cell.casefold() for cell in EMPTY_CELLS)


class DialectOptions(Model):
    """What a mapping states of the text files that match ``files`` (a pattern); the rest is guessed.

    ``header_row`` is the row with the names of the columns and ``first_row`` the first one with data, both counted from
    1 with every line; ``header_row = 0``: there are no names, and columns are called ``c1``, ``c2``, ...
    """

    files: str = "*"
    encoding: str | None = None
    delimiter: Annotated[str, Field(min_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    header_row: Annotated[int, Field(ge=0)] | None = None
    first_row: Annotated[int, Field(ge=1)] | None = None


class NoRowsError(BadInputError):
    """A file of text holds nothing, or names of columns alone."""


@dataclass(frozen=True)
class Dialect:
    """The dialect is complete: ``first_row`` counts lines from 1, ``names`` and ``units`` are those of the columns."""

    encoding: str
    delimiter: str
    decimal: str
    first_row: int
    names: tuple[str, ...]
    units: dict[str, str]
    remarks: str = ""

    @property
    def by_blanks(self) -> bool:
        """Return whether columns are parted by any number of blanks."""
        return self.delimiter == _BLANKS


def dialect_of(path: Path, options: DialectOptions | None = None) -> Dialect:
    """Guess how a file is written, as far as ``options`` do not state it.

    Raises :class:`BadInputError` where the file is empty or no text, or has no two rows alike.
    """
    try:
        return _guessed(path, options or DialectOptions())
    except csv.Error as error:
        raise BadInputError(f"{path.name}: cannot be read ({error}); expected delimited text") from error


def _guessed(path: Path, options: DialectOptions) -> Dialect:
    with path.open("rb") as stream:
        sample = stream.read(_SAMPLE_BYTES)
    encoding = options.encoding or _encoding(sample, path)
    lines = _text(sample, encoding, path).splitlines()
    if len(sample) == _SAMPLE_BYTES and len(lines) > 1:
        lines = lines[:-1]  # it may be cut off
    if not any(line.strip() for line in lines):
        raise NoRowsError(f"{path.name}: the file is empty; expected a table")
    lines = _with_whole_header(lines)
    delimiter = options.delimiter or _delimiter(lines)
    rows = [cells(line, delimiter) for line in lines]
    width = _usual_width(rows)
    first = options.first_row - 1 if options.first_row is not None else first_data_row(rows, width)
    if first is None and len(sample) < _SAMPLE_BYTES and not any(_is_value(cell) for row in rows for cell in row):
        raise NoRowsError(
            f"{path.name}: no rows of numbers found below the names of columns; expected a table. Hint: where its "
            "sensor measured nothing, leave the file out"
        )
    if first is None or first >= len(rows):
        raise BadInputError(
            f"{path.name}: no rows of numbers found (delimiter {delimiter!r}); expected a table. Hint: state "
            "delimiter, header_row and first_row under [[text]] in the mapping"
        )
    names, units = header_of(rows, first, width, options.header_row)
    decimal = options.decimal or _decimal(rows[first:])
    return Dialect(encoding, delimiter, decimal, first + 1, names, units, "\n".join(lines[:first]))


def _with_whole_header(lines: list[str]) -> list[str]:
    """Return the lines with a header that is one line: names in quotes may have line breaks.

    The lines of the first cell with such a break are joined into the last of them, and the others left empty.
    """
    first = next((i for i, line in enumerate(lines[:_MOST_LINES]) if _OPEN_CELL.search(line)), None)
    if first is None:
        return lines
    quotes = 0
    for last, line in enumerate(lines[first : first + _MOST_LINES], start=first):
        quotes += line.count('"')
        if quotes % 2 == 0:
            whole = " ".join(lines[first : last + 1])
            return [*lines[:first], *[""] * (last - first), whole, *lines[last + 1 :]]
    return lines


def cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without the blanks around them."""
    if delimiter == _BLANKS:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


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


def is_remark(line: str, delimiter: str) -> bool:
    """Return whether a line among the data is a remark: one marked as such, or one cell that begins with a word."""
    if not line.isprintable():
        return False
    if _RULE.fullmatch(line.strip()):
        return True
    filled = [cell for cell in cells(line, delimiter) if cell]
    return len(filled) > 0 and bool(_REMARK.match(filled[0]) or (len(filled) == 1 and _WORD.match(filled[0])))


def summary_rows(lines: Sequence[str], delimiter: str) -> int:
    """Return how many of the last lines of a table sum it up: a word in place of the time or number that others have.

    Empty lines among them count too.
    """
    usual = next(iter(cells(lines[0], delimiter)), "") if lines else ""
    rows = (cells(line, delimiter) for line in reversed(lines[-_MOST_SUMMARY_ROWS - 1 :]))
    last = next((i for i, row in enumerate(rows) if any(row) and not names_a_summary(row[0], usual)), 0)
    return last if any(line.strip() for line in lines[len(lines) - last :]) else 0


def names_a_summary(cell: str, usual: str) -> bool:
    """Return whether the first cell of a row is a word, where a ``usual`` one is a time or a number."""
    return bool(_WORD.match(cell)) and not _is_value(cell) and _is_value(usual)


def _encoding(sample: bytes, path: Path) -> str:
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if sample.startswith(mark):
            return name
    if b"\0" in sample:
        wide = _wide_encoding(sample)
        if wide is None:
            raise BadInputError(f"{path.name}: is not text (it has null bytes); expected delimited text")
        return wide
    whole = sample[: sample.rfind(b"\n") + 1 or len(sample)]
    if not _decodes(whole, "utf-8") and _is_chinese(sample):
        return "gb18030"
    encoding = next((name for name in ("utf-8", "cp1252", "cp932") if _decodes(whole, name)), "cp1252")
    is_cyrillic = encoding == "cp1252" and _is_cyrillic(whole) and _decodes(whole, "cp1251")
    return "cp1251" if is_cyrillic else encoding


def _decodes(sample: bytes, encoding: str) -> bool:
    try:
        sample.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _wide_encoding(sample: bytes) -> str | None:
    """Return UTF-16 without a mark, of which most characters of a table have one null byte; else None."""
    for name, nulls in (("utf-16-le", sample[1::2]), ("utf-16-be", sample[::2])):
        text = sample[: len(sample) // 2 * 2]
        if nulls.count(0) > 0.8 * len(nulls) and sample.count(0) < 1.1 * nulls.count(0) and _decodes(text, name):
            return name
    return None


def _is_chinese(sample: bytes) -> bool:
    """Return whether bytes above 127 come in pairs of GB 2312, as single letters with accents do not."""
    letters = re.findall(rb"[\x80-\xff]+", sample)
    return bool(letters) and all(re.fullmatch(rb"([\xa1-\xf7][\xa1-\xfe])+", run) for run in letters)


def _is_cyrillic(sample: bytes) -> bool:
    """Return whether most bytes above 127 are in words of them, as letters with accents are not."""
    letters = re.findall(rb"[\xc0-\xff\xa8\xb8]+", sample)
    in_words = sum(len(run) for run in letters if len(run) >= _SHORT_WORD)
    return 2 * in_words > sum(map(len, letters)) > 0


def _text(sample: bytes, encoding: str, path: Path) -> str:
    try:
        return sample.decode(encoding, errors="replace")
    except LookupError:
        raise BadInputError(f"{path.name}: unknown encoding {encoding!r}; expected one such as utf-8, cp1252") from None


def _delimiter(lines: list[str]) -> str:
    """Return the delimiter that parts most rows into the same number of cells, at least two; ties go to more cells."""
    lines = [line for line in lines if line.strip()]
    tail = lines[len(lines) // 2 :][:200] if len(lines) > 50 else lines  # header and remarks are before
    best = (0.0, 1, _BLANKS)
    for delimiter in (*_DELIMITERS, _BLANKS):
        rows = [cells(line, delimiter) for line in tail]
        counts = [len(row) for row in rows]
        usual = max({count for count in counts if count > 1}, key=counts.count, default=0)
        if usual == 0:
            continue
        plain = _plain_share(rows, usual)
        score = counts.count(usual) / len(counts) * plain
        if score > best[0] + 0.05:
            best = (score, usual, delimiter)
    return best[2]


def _plain_share(rows: list[list[str]], width: int) -> float:
    """Return the share of cells that are a number, a time or a place as a whole, a little for any other text."""
    shares = [1.0 if _is_value(cell) else 0.3 for row in rows if len(row) == width for cell in row]
    return sum(shares) / len(shares) if shares else 0.0


@lru_cache(maxsize=1 << 16)
def _is_value(cell: str) -> bool:
    cell = cell.strip('"')
    if cell.casefold() in _EMPTY or any(pattern.match(cell) for pattern in (_NUMBER, _TEMPORAL, _LISTED)):
        return True
    return metres_of(cell) is not None or number_and_unit(cell) is not None


def _usual_width(rows: list[list[str]]) -> int:
    counts = [len(row) for row in rows[len(rows) // 2 if len(rows) > 50 else 0 :] if any(row)]
    return max(set(counts), key=counts.count) if counts else 0


def first_data_row(rows: list[list[str]], width: int) -> int | None:
    """Return the first row of values: most of its cells are, or those in the columns in which all later ones are.

    A line above the names may have as many cells, of which all but a few are empty. So may the first rows of values.
    """
    later = [row for row in rows[len(rows) // 2 :] if len(row) == width]
    usual = float(np.median([sum(map(bool, row)) for row in later])) if later else 0.0
    always = [i for i in range(width) if len(later) > 1 and all(row[i] and _is_value(row[i]) for row in later)]
    last_names = max((i for i, row in enumerate(rows) if len(row) == width and _is_of_names(row, usual)), default=-1)
    for i, row in enumerate(rows):
        if always and len(row) == width and all(row[k] and _is_value(row[k]) for k in always):
            return i
        filled = [cell for cell in row if cell]
        values = [cell for cell in filled if _is_value(cell)]
        numbers = any(_NUMBER.match(cell) for cell in values)
        mostly_values = len(values) == len(filled) or (numbers and 2 * len(values) >= len(filled))
        is_above_names = 2 * len(filled) < usual and i < last_names
        if len(row) == width and filled and mostly_values and not is_above_names:
            return i
    return None


def _is_of_names(row: list[str], usual: float) -> bool:
    """Return whether a row has half as many cells as is ``usual`` or more, and most of them are no values."""
    filled = [cell for cell in row if cell]
    return 2 * len(filled) >= usual and 2 * sum(map(_is_value, filled)) < len(filled)


def header_of(
    rows: list[list[str]], first: int, width: int, header_row: int | None
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the names of the columns and their units: from brackets in the names, and from a row of units.

    Of two rows of names the upper one has one for several columns (``Gyro;;;Accel;;`` above ``X;Y;Z;X;Y;Z``). What
    stands below a row of units describes the columns, unless these are the names. A header may lack the name of a
    column that is always empty, as where rows end in a delimiter, or that of the first one, of numbers of rows.
    """
    data = [row for row in rows[first:] if len(row) == width]
    above = [row for row in (_fitted(_unmarked(row, width), width, data) for row in rows[:first]) if any(row)]
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


def _decimal(rows: list[list[str]]) -> str:
    """Return the decimal sign. Where points may be between groups of digits, decimal commas of times decide."""
    commas = points = groups = times = 0
    for cells_of_row in rows[:500]:
        row = [cell if (parts := number_and_unit(cell)) is None else parts[0] for cell in cells_of_row]
        commas += sum(bool(_DECIMAL_COMMA.match(cell)) for cell in row)
        points += sum(bool(_DECIMAL_POINT.match(cell)) for cell in row)
        groups += sum(bool(_GROUPS.match(cell)) for cell in row)
        times += sum(bool(_TIME_COMMA.search(cell)) for cell in row)
    grouped = times > 0 and groups >= points > 0
    return "," if commas > points or grouped else "."  # with commas between cells, too, as of cells in quotation marks
