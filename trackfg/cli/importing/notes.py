"""Notes of an import: what reading has assumed, and what is not used."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from trackfg.cli.terminal import note

if TYPE_CHECKING:
    from trackfg.interchange.importing.conversion import Conversion
    from trackfg.interchange.importing.geometry_reading import GeometryReading
    from trackfg.interchange.importing.proposals.questions import Proposal
    from trackfg.interchange.importing.source_table import SourceTable

_MOST_NAMED = 12
"""Columns of a table, or tables, that are not used and named: decoded CAN traces have hundreds."""


def print_notes(notes: Iterable[str]) -> None:
    """Print notes on standard error."""
    for text in notes:
        note(f"trackfg: note: {text}")


def notes_of(tables: Sequence[SourceTable], conversion: Conversion) -> list[str]:
    """Return what reading has assumed."""
    return [*(text for table in tables for text in table.notes), *conversion.notes]


def notes_of_geometry(table: SourceTable, reading: GeometryReading) -> list[str]:
    """Return what reading a channel table has assumed, and the columns that are not used."""
    from trackfg.interchange.importing.channels.proposed_reading import unused_channels

    unused = unused_channels(table, reading)
    return [*table.notes, *([_not_used(table.name, unused)] if unused else [])]


def notes_of_unused(proposal: Proposal, tables: Sequence[SourceTable]) -> list[str]:
    """Return what is not used of the tables; those with the columns of the one that is are named together."""
    from trackfg.interchange.importing.proposal import unused_columns

    columns_of = {table.name: table.columns for table in tables}
    used = proposal.sections["imu"]["file"]
    unused = unused_columns(proposal.sections, tables)
    alike = [name for name in unused if isinstance(used, str) and name != used and columns_of[name] == columns_of[used]]
    notes = [_not_used(name, columns) for name, columns in unused.items() if name not in alike]
    if alike:
        hint = "Hint: other runs are imported each by itself: trackfg import FILE... -o FOLDER --mapping M.toml"
        notes.append(f"not used: {shortened(alike)}, which have the columns of {used}. {hint}")
    return notes


def _not_used(table: str, columns: list[str]) -> str:
    return f"not used of {table}: {shortened(columns)}"


def shortened(names: list[str]) -> str:
    """Return names in a row, of many the first and how many more there are."""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"{', '.join(names[:_MOST_NAMED])}{more}"
