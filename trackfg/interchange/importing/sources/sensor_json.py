"""The JSON export of Sensor Logger: a list of entries, each with its ``sensor``, ``time`` and values as text."""

from __future__ import annotations

import json
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.source_table import SourceTable

_BEGINNING = re.compile(rb'\s*\[\s*\{[^{}]*"sensor"\s*:')
_HEAD_BYTES = 65_536
"""The first entry, which describes the recording, is shorter."""
_UNREADABLE = (OSError, zipfile.BadZipFile, RuntimeError, EOFError, ValueError, zlib.error)
"""What a damaged file or zip raises."""


def is_sensor_json(path: Path) -> bool:
    """Return whether a file, or the only JSON file of a zip, is such an export. Never raises."""
    if not path.is_file() or path.suffix.casefold() not in (".json", ".zip"):
        return False
    try:
        with _opened(path) as stream:
            return _BEGINNING.match(stream.read(_HEAD_BYTES)) is not None
    except _UNREADABLE:
        return False


def read_sensor_json(path: Path, wanted: Sequence[str]) -> dict[str, SourceTable]:
    """Return the tables of the wanted sensors by name. Raises :class:`BadInputError` with the reason."""
    rows: dict[str, list[dict[str, str]]] = {name: [] for name in wanted}
    try:
        with _opened(path) as stream:
            for entry in json.load(stream):
                if entry["sensor"] in rows:
                    rows[entry["sensor"]].append(entry)
        return {name: _table(name, entries) for name, entries in rows.items() if entries}
    except (*_UNREADABLE, KeyError, TypeError, RecursionError) as error:
        raise BadInputError(
            f"{path.name}: cannot be read ({first_line(error)}); expected the JSON of Sensor Logger"
        ) from error


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open the file, or the only JSON file of a zip. Raises ``ValueError`` where a zip has none or several."""
    if path.suffix.casefold() == ".json":
        with path.open("rb") as stream:
            yield stream
        return
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.casefold().endswith(".json") and "__MACOSX" not in name]
        if len(names) != 1:
            raise ValueError(f"{len(names)} JSON files; expected one")
        with archive.open(names[0]) as member:
            yield member


def _table(name: str, entries: list[dict[str, str]]) -> SourceTable:
    frame = pd.DataFrame(entries).drop(columns="sensor")
    return SourceTable(name, frame.apply(pd.to_numeric, errors="coerce"))
