"""ASAM MDF measurement files (.mf4, .mdf): each channel group is a table on its own times.

Channels that have a group each, on the same times, are one table.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.files.libraries import library
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable, column_of, holds_numbers
from trackfg.interchange.importing.times.clock import as_ns

_FIRST_YEAR = 1990
"""Earlier dates are those of loggers whose clock was not set; MDF is of 1991."""


class Mdf(SourceFormat):
    """A group is read at a time, so that memory holds one, and nothing is resampled to other groups' times."""

    key = "mdf"
    title = "ASAM MDF 3 and 4 (.mf4, .mdf)"

    def recognises(self, path: Path) -> bool:
        """Return whether the file begins as MDF files do."""
        return starts_with(path, b"MDF     ", b"UnFinMF ")

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read every group with numbers: a table by its name, or ``group_N``, with the times in ``time_s``.

        Codes that the file has words for are text.
        """
        asammdf = library("asammdf", "mdf")
        tables, reason = [], ""
        with _without_messages_at_deletion():
            try:
                with asammdf.MDF(path) as file:
                    tables = [table for table in _joined([*_groups(file)]) if len(table.columns) > 1]
            except Exception as error:  # the library raises errors of many kinds for damaged files
                reason = first_line(error)
        if reason:
            raise BadInputError(f"{path.name}: cannot be read ({reason}); expected an ASAM MDF file")
        tables = [table for table in in_usual_shape_of_types(tables) if _holds_channels(table)]
        return refuse_empty(tables, path, "channel group with rows of numbers")


def _holds_channels(table: SourceTable) -> bool:
    """Return whether a table has numbers besides its times."""
    return holds_numbers(table.frame.drop(columns="time_s", errors="ignore"))


@contextmanager
def _without_messages_at_deletion() -> Iterator[None]:
    """Keep the library from printing tracebacks when objects of a damaged file, made in part, are deleted."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
        gc.collect()
    finally:
        sys.unraisablehook = hook


def _joined(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables, those of a single channel on the same times as one where their names differ."""
    groups: list[dict[str, SourceTable]] = []
    on_times: dict[bytes, dict[str, SourceTable]] = {}
    for table in tables:
        group: dict[str, SourceTable] = {}
        if table.frame.shape[1] == 2:
            group = on_times.setdefault(table.frame["time_s"].to_numpy().tobytes(), group)
        channel = table.columns[-1]
        if channel in group:
            group = {}
        if not group:
            groups.append(group)
        group[channel] = table
    return [_side_by_side([*group.values()]) for group in groups]


def _side_by_side(tables: Sequence[SourceTable]) -> SourceTable:
    """Return one table with the columns of tables on the same times."""
    frame = pd.concat([tables[0].frame, *(table.frame.iloc[:, 1:] for table in tables[1:])], axis=1)
    units = {name: unit for table in tables for name, unit in table.units.items()}
    return replace(tables[0], frame=frame, units=units)


def _start_ns(file: Any) -> int | None:
    """Return the date at which times are 0; None where the start has no time zone or is too early."""
    start = file.header.start_time
    return as_ns(start) if start.tzinfo is not None and start.year >= _FIRST_YEAR else None


def _groups(file: Any) -> Iterator[SourceTable]:
    taken, start_ns = dict[str, int](), _start_ns(file)
    for index, group in enumerate(file.groups):
        frame, units = _group(file, index)
        if not frame.empty:
            name = getattr(group.channel_group, "acq_name", "") or f"group_{index + 1}"
            taken[name] = taken.get(name, 0) + 1
            yield SourceTable(name if taken[name] == 1 else f"{name}.{taken[name]}", frame, units, start_ns=start_ns)


def _group(file: Any, index: int) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the channels of numbers or text of a group, the time first, and their units."""
    whole = file.get_group(index, time_from_zero=False)
    pairs = ((str(name), column_of(values.to_numpy())) for name, values in whole.items())
    columns = {name: cells for name, cells in pairs if cells is not None}
    if not columns:
        return pd.DataFrame(), {}
    units = {channel.name: channel.unit or "" for channel in file.groups[index].channels}
    return pd.DataFrame({"time_s": np.asarray(whole.index, dtype=np.float64), **columns}), {"time_s": "s", **units}
