"""How a file of delimited text is written: its encoding, delimiter, decimal sign, header and units.

All of it is guessed from the first part of the file, and any of it may be given instead.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from trackfg.errors import BadInputError
from trackfg.interchange.importing.delimited.cells import BLANKS, cells, is_value
from trackfg.interchange.importing.delimited.data_rows import first_data_row, usual_width
from trackfg.interchange.importing.delimited.encoding import decoded, encoding_of
from trackfg.interchange.importing.delimited.header import header_of
from trackfg.interchange.importing.delimited.separators import decimal_of, delimiter_of
from trackfg.recording.strict_model import Model

_SAMPLE_BYTES = 200_000
"""What is looked at: some thousand rows."""

_OPEN_CELL = re.compile(r'(^|[;,\t|])\s*"[^"]*$')
"""A line that ends within a cell."""

_MOST_LINES = 100
"""Lines of a header with line breaks in its names."""


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
        return self.delimiter == BLANKS


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
    encoding = options.encoding or encoding_of(sample, path)
    lines = decoded(sample, encoding, path).splitlines()
    if len(sample) == _SAMPLE_BYTES and len(lines) > 1:
        lines = lines[:-1]  # it may be cut off
    if not any(line.strip() for line in lines):
        raise NoRowsError(f"{path.name}: the file is empty; expected a table")
    lines = _with_whole_header(lines)
    delimiter = options.delimiter or delimiter_of(lines)
    rows = [cells(line, delimiter) for line in lines]
    width = usual_width(rows)
    first = options.first_row - 1 if options.first_row is not None else first_data_row(rows, width)
    if first is None and len(sample) < _SAMPLE_BYTES and not any(is_value(cell) for row in rows for cell in row):
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
    decimal = options.decimal or decimal_of(rows[first:])
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
