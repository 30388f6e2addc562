"""Delimited text: a file, or a folder or zip of them, with spreadsheets and logs of GNSS receivers beside them."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from trackfg.errors import BadInputError
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.calendar_columns import with_whole_dates
from trackfg.interchange.importing.column_meaning import time_columns
from trackfg.interchange.importing.continued_files import with_joined_files
from trackfg.interchange.importing.long_table import wide_tables
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.gnss_log import read_gnss_log
from trackfg.interchange.importing.sources.spreadsheet import SPREADSHEETS, read_spreadsheet
from trackfg.interchange.importing.text_table import read_text

TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")

GNSS_LOGS = (".ubx", ".nmea")
"""Logs of a receiver that lie beside the text."""

_LARGEST_BYTES = 20_000_000_000
"""Of a zip, unpacked: more is a mistake or an attack."""


class TextFormat(SourceFormat):
    """Delimited text of any kind, .xlsx and .xls: one file, or all of a folder or a zip."""

    key = "text"
    title = "delimited text (.csv, .txt, .dat, ...), .xlsx and .xls: a file, a folder or a zip of them"

    def recognises(self, path: Path) -> bool:
        """Return whether it is such a file, or a folder or zip that holds one."""
        if path.is_dir():
            return any(file.suffix.casefold() in (*TEXT_SUFFIXES, *SPREADSHEETS) for file in path.iterdir())
        if path.suffix.casefold() == ".zip" and zipfile.is_zipfile(path):
            return any(PurePosixPath(name).suffix.casefold() in TEXT_SUFFIXES for name in names_in(path))
        return path.suffix.casefold() in (*TEXT_SUFFIXES, *SPREADSHEETS)

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read every file of that kind, in the order of their names; spreadsheets sheet by sheet, GNSS logs beside."""
        if path.is_dir():
            files = sorted(file for file in path.iterdir() if file.is_file())
            return refuse_empty(_all(files, dialect_for), path, "delimited text")
        if path.suffix.casefold() == ".zip" and starts_with(path, b"PK"):
            with temporary_folder() as folder:
                return refuse_empty(_all(unpacked(path, folder), dialect_for), path, "delimited text")
        return _all([path], dialect_for, single=True)


def _all(files: Sequence[Path], dialect_for: DialectFor, *, single: bool = False) -> list[SourceTable]:
    tables: list[SourceTable] = []
    for file in files:
        if file.suffix.casefold() in SPREADSHEETS:
            tables += read_spreadsheet(file)
        elif file.suffix.casefold() in GNSS_LOGS:
            tables.append(read_gnss_log(file))
        elif single or file.suffix.casefold() in TEXT_SUFFIXES:
            table = with_whole_dates(read_text(file, dialect_for(file.name)))
            time = time_columns(table)
            tables += wide_tables(table, time[0] if time is not None and len(time) == 1 else None)
    return with_joined_files(tables)


def names_in(path: Path) -> list[str]:
    """Return the names of the files in a zip; none where it is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (OSError, zipfile.BadZipFile, ValueError):
        return []


def unpacked(path: Path, folder: Path) -> list[Path]:
    """Unpack the text files of a zip into ``folder``, each under its bare name, and return their paths in order.

    Raises :class:`BadInputError` where the zip is damaged, too large, or has two files of one name.
    """
    files: list[Path] = []
    try:
        with zipfile.ZipFile(path) as archive:
            members = [m for m in archive.infolist() if not m.is_dir()]
            if sum(member.file_size for member in members) > _LARGEST_BYTES:
                raise BadInputError(f"{path.name}: is above {_LARGEST_BYTES / 1e9:g} GB unpacked; expected a recording")
            for member in members:
                name = PurePosixPath(member.filename.replace("\\", "/")).name
                if PurePosixPath(name).suffix.casefold() not in (*TEXT_SUFFIXES, *SPREADSHEETS):
                    continue
                target = folder / name
                if target.exists():
                    raise BadInputError(f"{path.name}: has two files {name!r}; expected each name once")
                with archive.open(member) as source, target.open("wb") as out:
                    while block := source.read(1 << 20):
                        out.write(block)
                files.append(target)
    except (OSError, zipfile.BadZipFile, RuntimeError, EOFError, ValueError, zlib.error) as error:
        # zipfile has RuntimeError for encrypted members and, as NotImplementedError, for an unknown compression;
        # EOFError and zlib.error for data that are cut short or damaged; ValueError for a name that is not UTF-8.
        raise BadInputError(f"{path.name}: cannot be unpacked ({error}); expected a zip") from error
    return sorted(files)
