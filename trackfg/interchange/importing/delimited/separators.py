"""The delimiter between the cells of a text, and the decimal sign in them, guessed from its rows."""

from __future__ import annotations

import re

from trackfg.interchange.importing.columns.written_units import number_and_unit
from trackfg.interchange.importing.delimited.cells import BLANKS, cells, is_value

_DELIMITERS = (";", "\t", ",", "|")

_DECIMAL_COMMA = re.compile(r"[+\-\u2212]?\d*,\d+([eE][+-]?\d+)?$")

_DECIMAL_POINT = re.compile(r"[+\-\u2212]?\d*\.\d+([eE][+-]?\d+)?$")

_GROUPS = re.compile(r"[+\-\u2212]?[1-9]\d{0,2}(\.\d{3})+$")
"""Digits in groups of three with points between, or a number with three decimals."""

_TIME_COMMA = re.compile(r"\d:\d{2},\d+$")


def delimiter_of(lines: list[str]) -> str:
    """Return the delimiter that parts most rows into the same number of cells, at least two; ties go to more cells."""
    lines = [line for line in lines if line.strip()]
    tail = lines[len(lines) // 2 :][:200] if len(lines) > 50 else lines  # header and remarks are before
    best = (0.0, 1, BLANKS)
    for delimiter in (*_DELIMITERS, BLANKS):
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
    shares = [1.0 if is_value(cell) else 0.3 for row in rows if len(row) == width for cell in row]
    return sum(shares) / len(shares) if shares else 0.0


def decimal_of(rows: list[list[str]]) -> str:
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
