"""Tables of any shape become tables with a column for each channel, whatever format they come from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from trackfg.interchange.importing.columns.calendar_columns import with_whole_dates
from trackfg.interchange.importing.columns.metres_of_sigmas import with_sigmas_in_metres
from trackfg.interchange.importing.columns.time_columns import time_columns
from trackfg.interchange.importing.columns.unit_columns import with_units_of_a_column
from trackfg.interchange.importing.delimited.header import in_brackets
from trackfg.interchange.importing.delimited.written_numbers import with_numbers
from trackfg.interchange.importing.shapes.channel_tables import by_sensor, with_joined_channels
from trackfg.interchange.importing.shapes.continued_files import with_joined_files
from trackfg.interchange.importing.shapes.earth_fixed_positions import with_geodetic
from trackfg.interchange.importing.shapes.long_table import wide_tables
from trackfg.interchange.importing.shapes.merged_names import without_merge_suffixes
from trackfg.interchange.importing.shapes.missing_values import without_stand_ins
from trackfg.interchange.importing.shapes.rotation_increments import with_angles
from trackfg.interchange.importing.shapes.side_by_side import parted
from trackfg.interchange.importing.shapes.united_cells import without_units_in_cells
from trackfg.interchange.importing.shapes.vector_cells import with_vectors
from trackfg.interchange.importing.shapes.written_angles import with_degrees
from trackfg.interchange.importing.shapes.written_points import with_points
from trackfg.interchange.importing.source_table import SourceTable, holds_numbers

_RESHAPED: tuple[Callable[[SourceTable], SourceTable], ...] = (
    without_merge_suffixes,
    with_vectors,
    with_angles,
    with_points,
    with_degrees,
    with_geodetic,
    without_units_in_cells,
    with_sigmas_in_metres,
    with_whole_dates,
)
"""What makes columns of other notations the usual ones, in this order."""


def in_usual_shape(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return tables with a column for each channel, in the notations that columns are read in."""
    made = [part for table in tables for block in parted(table) for part in _by_channel(block)]
    return with_joined_files(with_joined_channels(made))


def in_usual_shape_of_types(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables with numbers of a format whose columns have types, in their usual shape.

    Their names stay as they are, since such formats state units apart.
    """
    usual = in_usual_shape([with_numbers(table) for table in tables])
    return [table for table in usual if holds_numbers(table.frame)]


def of_typed_columns(table: SourceTable) -> SourceTable:
    """Return a table of a file whose columns have types, with what is written in their names and cells taken up.

    These are the units that names have in brackets, and numbers that are text.
    """
    return with_numbers(_with_units(table))


def _with_units(table: SourceTable) -> SourceTable:
    named = {name: in_brackets(name) for name in table.columns}
    units = {plain: unit for plain, unit in named.values() if unit}
    units |= {named[name][0] if name in named else name: unit for name, unit in table.units.items() if unit}
    plain = [name for name, _ in named.values()]
    if len(set(plain)) < len(plain):
        return table
    return replace(table, frame=table.frame.set_axis(plain, axis=1), units=units)


def _by_channel(table: SourceTable) -> list[SourceTable]:
    for reshaped in _RESHAPED:
        table = reshaped(table)
    time = time_columns(table)
    wide = wide_tables(table, time[0] if time is not None and len(time) == 1 else None)
    parts = by_sensor(table) if wide[0] is table else wide
    return [without_stand_ins(with_units_of_a_column(part)) for part in parts]
