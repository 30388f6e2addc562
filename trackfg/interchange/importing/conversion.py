"""The tables of a source become a recording, as a mapping says.

The recording has the source's own columns, units and axes, so that a wrong axis or unit is corrected by one edit of its
``recording.toml``; only times (seconds on one clock), places (m) and units that a recording does not know are
converted. What is read of each table, :mod:`trackfg.interchange.importing.sensors` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import refuse_used
from trackfg.interchange.importing.common_clock import on_one_clock
from trackfg.interchange.importing.mapping import Mapping
from trackfg.interchange.importing.sensors.balise_passages import PLACES_FILE
from trackfg.interchange.importing.sensors.sensor_reading import read_sensor
from trackfg.interchange.importing.sensors.sensor_table import SensorTable
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import as_datetime
from trackfg.io.description_reader import FILE_NAME, FORMAT
from trackfg.io.reader import LoadedRecording, load
from trackfg.io.writer import write_table
from trackfg.recording.findings import Finding, errors

_TIME_DIGITS = 9
"""Decimals of times, s: dates are whole nanoseconds."""
_MOST_NAMED = 5
"""Errors of a recording that are named."""


@dataclass(frozen=True)
class Imported:
    """What an import made: the folder, what ``trackfg check`` says of its structure and values, and rows by table."""

    folder: Path
    loaded: LoadedRecording
    rows: dict[str, int]


@dataclass
class Conversion:
    """A recording in memory, until it is written: its description, its tables by file, and the mapping's name.

    ``notes`` say what was assumed and what was left out; ``origins`` are names of the user's own, by file, and
    ``clocks`` those of the columns of time: here, and the user's own.
    """

    description: dict[str, Any]
    files: dict[str, pd.DataFrame]
    mapping_name: str
    notes: tuple[str, ...]
    origins: dict[str, str]
    clocks: dict[str, tuple[str, str]]

    def write(self, folder: Path) -> Imported:
        """Write the recording, complete or not at all; each table is dropped from memory once it is written.

        Raises :class:`BadInputError` where the recording could not be read back.
        """
        refuse_used(folder, "recordings are never overwritten")
        rows = {name: len(frame) for name, frame in self.files.items()}
        with replaced_folder(folder) as new:
            for name in rows:
                write_table(self.files.pop(name), new / name)
            (new / FILE_NAME).write_text(tomli_w.dumps(self.description), encoding="utf-8")
            loaded = load(new)
            if loaded.recording is None:
                raise BadInputError(f"{self.mapping_name}: the recording would not be usable: {self._refusal(loaded)}")
        return Imported(folder, loaded, rows)

    def _refusal(self, loaded: LoadedRecording) -> str:
        """Return the errors, in the names of the user's own files and columns: the recording is not there yet.

        What is wrong in a table of several sensors is reported once.
        """
        faults = list({one.sentence: one for one in map(self._of_the_source, errors(loaded.findings))}.values())
        also = "; ".join(one.sentence for one in faults[1:_MOST_NAMED])
        more = f" ({len(faults) - _MOST_NAMED} more)" if len(faults) > _MOST_NAMED else ""
        return f"{faults[0]}" + (f". Also: {also}{more}" if also else "")

    def _of_the_source(self, finding: Finding) -> Finding:
        file = finding.file or ""
        clock_column, source_column = self.clocks.get(file, ("", ""))
        column = source_column if clock_column and finding.column == clock_column else finding.column
        return replace(finding, file=self.origins.get(file, finding.file), column=column)


def write_imported(tables: Sequence[SourceTable], mapping: Mapping, folder: Path, *, run_id: str) -> Imported:
    """Write the recording that ``mapping`` makes of ``tables``: :func:`converted`, then :meth:`Conversion.write`."""
    return converted(tables, mapping, run_id=run_id).write(folder)


def converted(tables: Sequence[SourceTable], mapping: Mapping, *, run_id: str) -> Conversion:
    """Return the recording that ``mapping`` makes of ``tables``, which are not needed afterwards.

    ``run_id`` is used where the mapping has no ``id``. Raises :class:`BadInputError` where a column is missing or
    unreadable, and where clocks cannot be brought together; the message names file, column and row.
    """
    mapping = mapping.of_source(tables)
    parts = [read_sensor(sensor, tables, mapping) for sensor in mapping.sensors]
    parts, start_ns = on_one_clock(parts, mapping, tables)
    description, files = _described(parts, mapping, start_ns, run_id)
    notes = dict.fromkeys(text for part in parts for text in (*part.times.notes, *part.notes))
    origins = {part.file: part.origin for part in parts}
    clocks_of = {part.file: (part.time_column, " and ".join(part.sensor.time_columns)) for part in parts}
    return Conversion(description, files, mapping.name, tuple(notes), origins, clocks_of)


def _described(
    parts: Sequence[SensorTable], mapping: Mapping, start_ns: int | None, run_id: str
) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    description: dict[str, Any] = {"format": FORMAT, "id": mapping.top.get("id", run_id)}
    if start_ns is not None:
        description["start"] = as_datetime(start_ns)
    description |= {key: mapping.top[key] for key in ("track", "kilometrage") if key in mapping.top}
    files: dict[str, pd.DataFrame] = {}
    for part in parts:
        columns = {name: np.asarray(values) for name, values in part.columns.items()}
        # No clock is finer than 1 ns, so that a time is the same however its source has written it.
        with np.errstate(over="ignore"):  # damaged times may be of any size
            columns = {part.time_column: np.round(part.times.since(start_ns), _TIME_DIGITS), **columns}
        files[part.file] = pd.DataFrame(columns, copy=False)
        if part.places is not None:
            files[PLACES_FILE] = part.places
        section = {"file": part.file, "time": part.time_column, **part.keys}
        if "[" in part.sensor.section:
            description.setdefault(part.sensor.kind, []).append(section)
        else:
            description[part.sensor.kind] = section
    return description, files
