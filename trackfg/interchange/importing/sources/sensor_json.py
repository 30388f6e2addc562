"""The JSON export of Sensor Logger: a list of entries, each with its ``sensor``, ``time`` and values as text."""

from __future__ import annotations

import json
import math
import re
import zipfile
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_format import readable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.archives import UNREADABLE

_BEGINNING = re.compile(rb'\s*\[\s*\{[^{}]*"sensor"\s*:')
_JSON = "the JSON of Sensor Logger"
_HEAD_BYTES = 65_536
"""The first entry, which describes the recording, is shorter."""


def is_sensor_json(path: Path) -> bool:
    """Return whether a file, or the only JSON file of a zip, is such an export. Never raises."""
    if not path.is_file() or path.suffix.casefold() not in (".json", ".zip"):
        return False
    try:
        with _opened(path) as stream:
            return _BEGINNING.match(stream.read(_HEAD_BYTES)) is not None
    except UNREADABLE:
        return False


def described(path: Path) -> dict[str, str]:
    """Return what the first entry says of the phone and of the app's settings, in lower case; nothing without it."""
    with readable(path, _JSON, UNREADABLE), _opened(path) as stream:
        head = stream.read(_HEAD_BYTES).decode("utf-8", "replace")
        entry, _ = json.JSONDecoder().raw_decode(head, head.index("{"))
    return {name: str(value).strip().casefold() for name, value in entry.items()}


def read_sensor_json(path: Path, wanted: Sequence[str]) -> dict[str, SourceTable]:
    """Return the tables of the wanted sensors by name. Raises :class:`BadInputError` with the reason."""
    sensors = {name: _Sensor() for name in wanted}

    def take(entry: dict[str, str]) -> None:
        """Keep the numbers of an entry alone: as objects all entries are six times as large as their file."""
        if (sensor := sensors.get(entry.get("sensor", ""))) is not None:
            sensor.take(entry)

    faults = (*UNREADABLE, KeyError, TypeError, OverflowError, RecursionError)
    with readable(path, _JSON, faults), _opened(path) as stream:
        json.load(stream, object_hook=take)
    return {name: sensor.table(name) for name, sensor in sensors.items() if sensor.names}


class _Sensor:
    """The entries of a sensor: their times, ns since 1970, and the other values by the first entry's names."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._times, self._values = array("q"), array("d")

    def take(self, entry: dict[str, str]) -> None:
        """Take up an entry; what is no number in it is NaN."""
        self.names = self.names or tuple(name for name in entry if name not in ("sensor", "time"))
        self._times.append(int(entry["time"]))
        self._values.extend(_number(entry.get(name)) for name in self.names)

    def table(self, name: str) -> SourceTable:
        """Return the entries as a table."""
        values = np.frombuffer(self._values).reshape(-1, len(self.names))
        return SourceTable(name, pd.DataFrame(values, columns=list(self.names)).assign(time=np.array(self._times)))


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except (TypeError, ValueError):
        return math.nan


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
