"""Which lines of a text are rows of data: below the names, and without remarks and rows that sum the others up."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from trackfg.interchange.importing.delimited.cells import NUMBER, cells, is_value

_WORD = re.compile(r"[^\W\d_]{3}")

_MOST_SUMMARY_ROWS = 20
"""Rows below the data that name what they sum up: mean, maximum, number of rows; more of them are data."""

_REMARK = re.compile(r"#|%|//|!|\*\*")

_RULE = re.compile(r"[-+=|: ]*(---|===)[-+=|: ]*|\(?\d+ rows?( in set.*)?\)?")
"""A line that rules off a table, or says how many rows it has, as databases print it."""


def usual_width(rows: list[list[str]]) -> int:
    """Return how many cells most rows of data have."""
    counts = [len(row) for row in rows[len(rows) // 2 if len(rows) > 50 else 0 :] if any(row)]
    return max(set(counts), key=counts.count) if counts else 0


def first_data_row(rows: list[list[str]], width: int) -> int | None:
    """Return the first row of values: most of its cells are, or those in the columns in which all later ones are.

    A line above the names may have as many cells, of which all but a few are empty. So may the first rows of values.
    """
    later = [row for row in rows[len(rows) // 2 :] if len(row) == width]
    usual = float(np.median([sum(map(bool, row)) for row in later])) if later else 0.0
    always = [i for i in range(width) if len(later) > 1 and all(row[i] and is_value(row[i]) for row in later)]
    last_names = max((i for i, row in enumerate(rows) if len(row) == width and _is_of_names(row, usual)), default=-1)
    for i, row in enumerate(rows):
        if 0 in always and row and row[0] and not is_value(row[0]):
            continue  # a line with a name in front, as of LabVIEW's ``Samples``
        if always and len(row) == width and all(row[k] and is_value(row[k]) for k in always):
            return i
        filled = [cell for cell in row if cell]
        values = [cell for cell in filled if is_value(cell)]
        numbers = any(NUMBER.match(cell) for cell in values)
        mostly_values = len(values) == len(filled) or (numbers and 2 * len(values) >= len(filled))
        is_above_names = 2 * len(filled) < usual and i < last_names
        if len(row) == width and filled and mostly_values and not is_above_names:
            return i
    return None


def _is_of_names(row: list[str], usual: float) -> bool:
    """Return whether a row has half as many cells as is ``usual`` or more, and most of them are no values."""
    filled = [cell for cell in row if cell]
    return 2 * len(filled) >= usual and 2 * sum(map(is_value, filled)) < len(filled)


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
    return bool(_WORD.match(cell)) and not is_value(cell) and is_value(usual)
