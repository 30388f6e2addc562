"""Rows are brought into the order of their times, without those that are there twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.interchange.importing.mapping import BALISES, MappedSensor
from trackfg.interchange.importing.sensors.sample_stamps import repeated_rows, sorted_rows, spread_stamps, tick_s
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import Times
from trackfg.interchange.importing.times.reading import read_times
from trackfg.numerics.arrays import Array

_FINE_TICK_S = 0.1
"""A clock that ticks more seldom may be so far off that the smoother has to find it."""


def in_order(table: SourceTable, sensor: MappedSensor) -> tuple[SourceTable, Times]:
    """Return the table and the times of its rows: in sequence, and where samples are regular without repetitions.

    Rows that are written twice count once; other stamps that repeat are spread again, unless their rows are those of
    several sensors. Of positions at one time the last counts: a phone corrects its first ones.
    """
    times = read_times(table, sensor.time_columns, sensor.notation)
    since = times.since(times.first_ns)
    order = sorted_rows(since)
    if order is not None:
        table, times = taken(table, times, order)
        since = times.since(times.first_ns)
    if (np.diff(since) == 0.0).any() and _are_of_several(table, since):
        return table, times
    if sensor.kind == "gnss":
        last = np.append(np.diff(since) != 0.0, True)
        if 2 * np.count_nonzero(last) > last.size and not last.all():
            return taken(table, times, np.flatnonzero(last))
    if sensor.kind in ("fixes", BALISES) or (sensor.kind == "gnss" and last.all()):
        return table, times
    twice = repeated_rows(since, table.frame)
    if twice is not None:
        table, times = taken(table, times, np.flatnonzero(~twice))
        since = times.since(times.first_ns)
    spread = spread_stamps(since)
    if spread is since:
        return table, times
    tick = tick_s(since)
    notes = times.notes
    if tick is not None and tick > _FINE_TICK_S:
        notes += (
            f"{table.name}: the clock ticks every {tick:.4g} s only: rows are spread, and may all be half of it off",
        )
    return table, replace(Times.after(times.first_ns, spread, times.zone, notes), of_hour=times.of_hour)


def _are_of_several(table: SourceTable, t: Array) -> bool:
    """Return whether rows with one time (n,), s, fill other columns: each sensor writes a row of its own."""
    return not table.frame.notna().assign(**{"": t}).duplicated().any()


def taken(table: SourceTable, times: Times, rows: np.ndarray) -> tuple[SourceTable, Times]:
    """Return these rows of a table, and their times."""
    return replace(table, frame=table.frame.iloc[rows].reset_index(drop=True)), times_of_rows(times, rows)


def times_of_rows(times: Times, keep: np.ndarray) -> Times:
    """Return the times of the rows to keep: a mask, or their numbers."""
    ns, seconds = (None if values is None else values[keep] for values in (times.ns, times.seconds))
    return replace(times, ns=ns, seconds=seconds)
