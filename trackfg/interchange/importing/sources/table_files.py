"""Files of tables are read by their suffix, and made tables with a column for each channel."""

from __future__ import annotations

import bz2
import gzip
import lzma
import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.delimited.dialect import NoRowsError
from trackfg.interchange.importing.delimited.tagged_lines import delimiter_of_tagged, has_sentences, read_tagged
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.shapes.continued_files import without_rowless_parts
from trackfg.interchange.importing.shapes.pair_lines import has_pairs, read_pairs
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape, of_typed_columns
from trackfg.interchange.importing.source_format import DialectFor
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.columnar import (
    ARRAY_SUFFIXES,
    ARROW_SUFFIXES,
    SQLITE_SUFFIXES,
    read_arrays,
    read_arrow,
    read_sqlite,
)
from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log, read_positions
from trackfg.interchange.importing.sources.receivers.gpx import TRACK
from trackfg.interchange.importing.sources.receivers.rtklib import SOLUTION
from trackfg.interchange.importing.sources.records import JSON_SUFFIXES, holds_records, read_records
from trackfg.interchange.importing.sources.ros_echo import with_columns_of_ros
from trackfg.interchange.importing.sources.spreadsheet import SPREADSHEETS, read_spreadsheet
from trackfg.interchange.importing.unread_formats import unread_format

TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".lvm", ".prn", ".gcsv")
GNSS_LOGS = (".ubx", ".nmea", SOLUTION, TRACK)
"""Logs of a receiver, solutions of RTKLIB and tracks of GPX that lie beside the tables."""
_OPENERS: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
"""Compressed files, by the suffix after that of what is in them."""

_READERS: dict[tuple[str, ...], Callable[[Path], list[SourceTable]]] = {
    SPREADSHEETS: read_spreadsheet,
    ARROW_SUFFIXES: read_arrow,
    ARRAY_SUFFIXES: read_arrays,
    JSON_SUFFIXES: read_records,
    SQLITE_SUFFIXES: read_sqlite,
}
TABLE_SUFFIXES = (*TEXT_SUFFIXES, *(suffix for suffixes in _READERS for suffix in suffixes))
"""Files that hold tables by themselves."""


def holds_tables(name: str) -> bool:
    """Return whether a file of this name holds tables, perhaps compressed."""
    return _content_suffix(Path(name)) in TABLE_SUFFIXES


def _content_suffix(path: Path) -> str:
    suffixes = [suffix.casefold() for suffix in path.suffixes]
    return suffixes[-2] if len(suffixes) > 1 and suffixes[-1] in _OPENERS else (suffixes[-1] if suffixes else "")


def read_table_files(
    files: Sequence[tuple[str, Path]], scratch: Path, dialect_for: DialectFor, *, single: bool = False
) -> list[SourceTable]:
    """Read files, each with the name that its tables get; ``single``: the only one is text whatever its suffix.

    ``scratch`` is a folder for what is compressed. Raises :class:`BadInputError`.
    """
    tables: list[SourceTable] = []
    rowless: dict[str, NoRowsError] = {}
    for name, file in files:
        suffix = _content_suffix(file)
        if suffix in TABLE_SUFFIXES or suffix in GNSS_LOGS or single:
            try:
                parts = _read(_decompressed(file, scratch), suffix, dialect_for)
            except NoRowsError as error:
                rowless[name] = error
                continue
            tables += [replace(table, name=_renamed(table.name, file, name)) for table in parts]
    tables, alone = without_rowless_parts(tables, list(rowless))
    if alone:
        raise rowless[alone[0]]
    return in_usual_shape(tables)


def _renamed(table: str, file: Path, name: str) -> str:
    """Return a table's name with the name of its file in the source, which a folder of a zip may come before."""
    stem = file.name.removesuffix(file.suffix) if file.suffix.casefold() in _OPENERS else file.name
    return name.removesuffix(file.name) + stem + table.removeprefix(stem) if table.startswith(stem) else table


def _read(file: Path, suffix: str, dialect_for: DialectFor) -> list[SourceTable]:
    reader = next((read for suffixes, read in _READERS.items() if suffix in suffixes), None)
    if reader is not None:
        return [of_typed_columns(table) for table in reader(file)]
    if suffix in GNSS_LOGS:
        return [read_positions(file)]
    if (unread := unread_format(file)) is not None:
        raise BadInputError(unread)
    if holds_records(file):
        return [of_typed_columns(table) for table in read_records(file)]
    options = dialect_for(file.name)
    receiver = _among_lines(file) if has_sentences(file) else []
    if options is None and has_pairs(file):
        return [read_pairs(file), *receiver]
    delimiter = None if options is not None else delimiter_of_tagged(file)
    if delimiter is not None:
        return [*read_tagged(file, delimiter), *receiver]
    return [with_columns_of_ros(read_text(file, options)), *receiver]


def _among_lines(file: Path) -> list[SourceTable]:
    """Return the positions of a receiver's sentences among other lines; none where they have no position."""
    try:
        return [read_gnss_log(file)]
    except BadInputError:
        return []


def _decompressed(file: Path, scratch: Path) -> Path:
    """Return a file, or its content in ``scratch`` where it is compressed. Raises :class:`BadInputError`."""
    opener = _OPENERS.get(file.suffix.casefold())
    if opener is None:
        return file
    target = scratch / file.stem
    try:
        with opener(file, "rb") as source, target.open("wb") as out:
            shutil.copyfileobj(source, out, 1 << 20)
    except (OSError, EOFError, ValueError, lzma.LZMAError, zlib.error) as error:
        raise BadInputError(f"{file.name}: cannot be unpacked ({first_line(error)}); expected {file.suffix}") from error
    return target
