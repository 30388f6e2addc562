"""Names that two merged tables have in common, ``x_x`` and ``x_y`` of pandas, lose what looks like an axis."""

from __future__ import annotations

from dataclasses import replace

from trackfg.interchange.importing.columns.column_names import axis_and_rest
from trackfg.interchange.importing.source_table import SourceTable

_SUFFIXES = {"_x": " 1", "_y": " 2"}
"""What pandas appends to a name of the first and of the second table, and what becomes of it."""


def without_merge_suffixes(table: SourceTable) -> SourceTable:
    """Return a table with 1 and 2 in place of the suffixes, and a note on it; a table without them as it is.

    They are none where a name has no axis before them: ``gyro_x`` and ``gyro_y`` are axes.
    """
    stems = {name[:-2] for name in table.columns if name.endswith("_x")}
    stems &= {name[:-2] for name in table.columns if name.endswith("_y")}
    stems = {stem for stem in stems if axis_and_rest(stem)[0] is not None and f"{stem}_z" not in table.columns}
    names = {f"{stem}{suffix}": f"{stem}{number}" for stem in stems for suffix, number in _SUFFIXES.items()}
    if not names or set(names.values()) & set(table.columns):
        return table
    first = next(name for name in table.columns if name in names)
    note = f"{table.name}: names of two merged tables end in 1 and 2 here: {first} is {names[first]!r}"
    units = {names.get(name, name): unit for name, unit in table.units.items()}
    return replace(table, frame=table.frame.rename(columns=names), units=units, notes=(*table.notes, note))
