"""Text whose lines begin with what they are (``GYRO;0.01;...``), perhaps with sentences of a receiver among them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv

from trackfg.interchange.importing.delimited.cells import EMPTY_CELLS
from trackfg.interchange.importing.delimited.header import header_of
from trackfg.interchange.importing.source_table import SourceTable

_TAGGED = re.compile(r"([A-Za-z][A-Za-z_]\w*)([,;\t|])\s*[-+.\dA-Za-z]")
_SENTENCE = re.compile(r"\$(G[A-Z]|BD|QZ)[A-Z]{3},")
"""NMEA: the talker and the sentence."""
_NAME = re.compile(r"[^\W\d]\w*( ?[(\[].*[)\]])?")
"""The name of a cell, perhaps with its unit."""
_HEAD_BYTES = 200_000
_SHARE = 0.8
"""Of the lines that are no remarks and no sentences, so many begin with a tag."""


def has_sentences(path: Path) -> bool:
    """Return whether some lines at the start of a text are sentences of a receiver and others are none."""
    lines = _head(path)
    sentences = sum(bool(_SENTENCE.match(line)) for line in lines)
    return 0 < sentences < len(lines)


def delimiter_of_tagged(path: Path) -> str | None:
    """Return the delimiter of a text whose lines begin with tags, two or more with different numbers of cells, or one
    among sentences of a receiver; None for any other text.
    """
    lines = _head(path)
    others = [line for line in lines if not _SENTENCE.match(line)]
    tagged = [match for line in others if (match := _TAGGED.match(line))]
    if not tagged or len(tagged) < _SHARE * len(others):
        return None
    delimiter = tagged[0][2]
    widths = {(match[1], match.string.count(delimiter)) for match in tagged}
    tags = {tag for tag, _ in widths}
    several = len(tags) > 1 and len({width for _, width in widths}) > 1 and len(tags) < 0.1 * len(tagged)
    return delimiter if several or (len(tags) == 1 and len(others) < len(lines)) else None


def _head(path: Path) -> list[str]:
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    lines = [] if b"\0" in head else head.decode("utf-8", "replace").splitlines()
    lines = lines[:-1] if len(head) == _HEAD_BYTES else lines  # the last one may be cut off
    return [line for line in lines if line.strip() and line[0] not in "%#/!"]


def read_tagged(path: Path, delimiter: str) -> Sequence[SourceTable]:
    """Return a table for each tag. Names are those of a line that lists the cells of such lines, else c1, c2, ...: of a
    remark, or one such as ``FMT, 131, 43, IMU, Qfff, TimeUS,GyrX,GyrY,GyrZ``.

    Lines with another number of cells than most of their kind are left out, with a note.
    """
    kinds = {tag: _Kind(width) for tag, width in _widths(path, delimiter).items()}
    remarks, listed = list[str](), _lists_of_names(path, delimiter)
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            match = _TAGGED.match(line)
            if match and match[2] == delimiter and match[1] in kinds:
                kinds[match[1]].take(line[match.end(1) + 1 :], delimiter, number)
            elif line[:1] in "%#/!":
                remarks.append(line)
    tables = []
    for tag, kind in kinds.items():
        if kind.lines > 1:
            names, units = _names(tag, delimiter, kind.width, [*remarks, *listed])
            name, remark = f"{path.name}/{tag}", "".join(remarks)
            note = f"{name}: {kind.left_out} lines with other than {kind.width} cells are left out"
            frame, notes = kind.frame(delimiter, names), (note,) if kind.left_out else ()
            tables.append(SourceTable(name, frame, units, kind.first_row, remarks=remark, notes=notes))
    return tables


class _Kind:
    """The lines of a tag that have its usual ``width``, in cells."""

    def __init__(self, width: int) -> None:
        self.width, self.lines, self.left_out, self.first_row = width, 0, 0, 0
        self._text = bytearray()

    def take(self, rest: str, delimiter: str, number: int) -> None:
        """Take up what follows the tag in a line."""
        self.first_row = self.first_row or number
        if rest.count(delimiter) == self.width - 1:
            self._text += rest.encode()
            self.lines += 1
        else:
            self.left_out += 1

    def frame(self, delimiter: str, names: tuple[str, ...]) -> pd.DataFrame:
        """Return the cells as numbers and text."""
        read = pa.csv.ReadOptions(column_names=list(names))
        convert = pa.csv.ConvertOptions(null_values=EMPTY_CELLS, strings_can_be_null=True, timestamp_parsers=["none"])
        table = pa.csv.read_csv(pa.BufferReader(self._text), read, pa.csv.ParseOptions(delimiter=delimiter), convert)
        numeric = [pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in table.schema.types]
        columns = [c if n else c.cast(pa.string()) for c, n in zip(table.columns, numeric, strict=True)]
        frame: pd.DataFrame = pa.table(columns, names=table.column_names).to_pandas()
        return frame


def _parted(line: str, delimiter: str, width: int) -> tuple[list[str], list[str]]:
    """Return the cells of a line before the last ``width`` ones, and these."""
    cells = line.split(delimiter)
    return cells[:-width], cells[-width:]


def _widths(path: Path, delimiter: str) -> dict[str, int]:
    """Return the usual number of cells behind each tag."""
    counts: dict[str, Counter[int]] = {}
    for line in _head(path):
        match = _TAGGED.match(line)
        if match and match[2] == delimiter:
            counts.setdefault(match[1], Counter())[line.count(delimiter)] += 1
    return {tag: widths.most_common(1)[0][0] for tag, widths in counts.items()}


def _lists_of_names(path: Path, delimiter: str) -> list[str]:
    """Return the lines at the start of a text that end in names, and are no lines of data."""
    return [line for line in _head(path) if _NAME.fullmatch(line.rpartition(delimiter)[2].strip())]


def _names(tag: str, delimiter: str, width: int, lines: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the names of the cells of a tag: those that end a line in which they stand behind the tag."""
    for line in lines:
        front, names = ([cell.strip(" '\"\r\n\t%#/!") for cell in part] for part in _parted(line, delimiter, width))
        if tag in front and all(_NAME.match(cell) for cell in names):
            return header_of([names, [""] * width], 1, width, None)
    return header_of([[""] * width], 0, width, None)
