"""A log that continues from file to file is one table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.time_columns import time_columns, times_in
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import Times

_PAUSE_S = 2.0
"""A logger may lose samples while it opens the next file, s; runs of their own are further apart."""


def with_joined_files(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables, of which those that continue each other are one.

    They have the same columns and names that differ in digits only; the name of the whole has ``*`` for these.
    """
    parts: dict[tuple[str, ...], list[SourceTable]] = {}
    for table in tables:
        parts.setdefault((_whole(table.name), *table.columns), []).append(table)
    out = []
    for (name, *_), same in parts.items():
        ordered = _in_order(same) if len(same) > 1 else None
        if ordered is None:
            out += same
        else:
            frame = pd.concat([table.frame for table in ordered], ignore_index=True)
            notes = tuple(note for table in ordered for note in table.notes)
            out.append(replace(ordered[0], name=name, frame=frame, notes=notes))
    return out


def without_rowless_parts(tables: Sequence[SourceTable], rowless: Sequence[str]) -> tuple[list[SourceTable], list[str]]:
    """Return the tables without those that hold no rows and continue one that does, on which is a note.

    ``rowless`` are names of files that hold no table at all; second come those of them that continue none.
    """
    beside: dict[str, list[str]] = {}
    for name in (*rowless, *(table.name for table in tables if table.frame.empty)):
        beside.setdefault(_whole(name), []).append(name)
    out, left_out = list[SourceTable](), set[str]()
    for table in tables:
        names = [] if table.frame.empty else beside.pop(_whole(table.name), [])
        left_out |= set(names)
        notes = tuple(f"{name}: has no rows: left out" for name in names)
        out.append(replace(table, notes=(*table.notes, *notes)) if notes else table)
    kept = [table for table in out if not (table.frame.empty and table.name in left_out)]
    return kept, [name for name in rowless if name not in left_out]


def _whole(name: str) -> str:
    """Return the name of the table that a table of this name may be a part of."""
    return re.sub(r"\d+", "*", name)


def _in_order(tables: list[SourceTable]) -> list[SourceTable] | None:
    """Return the tables in the order of their times, without the rows with which the one before has ended.

    None where one does not begin where another one ends, or with other rows than that one's last.
    """
    try:
        times = [_times(table) for table in tables]
    except BadInputError:
        return None
    order = sorted(range(len(tables)), key=lambda i: times[i].since(None)[0])
    parts = [tables[order[0]]]
    for earlier, later in pairwise(order):
        end, t = float(times[earlier].since(None)[-1]), times[later].since(None)
        again = int(np.searchsorted(t, end, side="right")) if t[0] < end else 0
        rows, part = tables[earlier].frame.tail(again), tables[later].frame
        if (times[earlier].ns is None) != (times[later].ns is None) or t[0] - end > _PAUSE_S:
            return None
        if again and not rows.reset_index(drop=True).equals(part.head(again).reset_index(drop=True)):
            return None
        parts.append(replace(tables[later], frame=part.iloc[again:]))
    return parts


def _times(table: SourceTable) -> Times:
    columns = time_columns(table)
    if columns is None:
        raise BadInputError(f"{table.name}: no column of times found; expected one")
    return times_in(table, columns)
