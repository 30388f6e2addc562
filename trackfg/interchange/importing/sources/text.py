"""Tables in files: delimited text, spreadsheets and files of columns; one, or all of a folder or an archive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, refuse_empty
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.archives import is_archive, names_in, unpacked
from trackfg.interchange.importing.sources.table_files import GNSS_LOGS, holds_tables, read_table_files

_DEPTH = 3
"""Folders within folders in which files are looked for, if there is none outside them."""
_MOST_NAMED = 5
"""Files that are not read and are named."""
_PROSE = ("readme", "liesmich", "licence", "license", "copying")
"""Beginnings of the names of text files that say something of the tables beside them."""


class TextFormat(SourceFormat):
    """Delimited text, .xlsx, .xls, Parquet, SQLite, arrays, JSON: one file, or all of a folder or an archive."""

    key = "text"
    title = "text (.csv, .txt, ...), spreadsheets, Parquet, SQLite, .mat, .npz, JSON: a file, a folder or a zip of them"

    def recognises(self, path: Path) -> bool:
        """Return whether it is such a file, or a folder or archive that holds one."""
        if path.is_dir():
            return bool(_files(path))
        if is_archive(path):
            return any(_is_of_tables(name) for name in names_in(path))
        return holds_tables(path.name)

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read every file of that kind, in the order of their names; spreadsheets sheet by sheet, GNSS logs beside."""
        with temporary_folder() as folder:
            if path.is_dir():
                files = [(file.relative_to(path).as_posix(), file) for file in _files(path)]
            elif is_archive(path):
                files = unpacked(path, folder, lambda name: _is_of_tables(name) or _is_gnss_log(name))
            else:
                files = [(path.name, path)]
                return refuse_empty(read_table_files(files, folder, dialect_for, single=True), path, "table")
            first, *others = refuse_empty(read_table_files(files, folder, dialect_for), path, "delimited text")
            if path.is_dir() and (beside := _not_read(path, [file for _, file in files])):
                more = f" and {len(beside) - _MOST_NAMED} more" if len(beside) > _MOST_NAMED else ""
                note = f"not read of {path.name}: {', '.join(beside[:_MOST_NAMED])}{more}"
                first = replace(first, notes=(*first.notes, note))
            return [first, *others]


def _not_read(folder: Path, files: Sequence[Path]) -> list[str]:
    """Return the names of files beside those that are read, without hidden ones and prose."""
    beside = {file for parent in {file.parent for file in files} for file in parent.iterdir() if file.is_file()}
    names = (file.name for file in beside - set(files))
    return sorted(name for name in names if not name.casefold().startswith((".", *_PROSE)))


def _files(folder: Path) -> list[Path]:
    """Return the files of tables in a folder, else those in its folders, in the order of their names."""
    for depth in range(_DEPTH):
        files = sorted(file for file in folder.glob("*/" * depth + "*") if file.is_file())
        if any(_is_of_tables(file.name) for file in files):
            return [file for file in files if _is_of_tables(file.name) or _is_gnss_log(file.name)]
    return []


def _is_of_tables(name: str) -> bool:
    return holds_tables(name) and not Path(name).name.casefold().startswith(_PROSE)


def _is_gnss_log(name: str) -> bool:
    return Path(name).suffix.casefold() in GNSS_LOGS
