"""The track geometry in a source: as a mapping says, or as names and units of its channels do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import tomli_w

from trackfg.errors import BadInputError
from trackfg.files.owned_folder import kind_of
from trackfg.interchange.importing.channels.measured_geometry import measured_result
from trackfg.interchange.importing.channels.proposed_reading import proposed_reading
from trackfg.interchange.importing.columns.column_meaning import triples
from trackfg.interchange.importing.geometry_reading import GeometryOptions, GeometryReading
from trackfg.interchange.importing.mapping import FORMAT, Mapping, fits, table_named
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.source_format import SourceFormat
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.results.result import RESULT_FOLDER, Result


def source_tables(
    path: Path, from_format: str | None, mapping: Mapping | None
) -> tuple[SourceFormat, list[SourceTable]]:
    """Return the format of a source, and its tables, read as the mapping says where there is one.

    Raises :class:`BadInputError` for a source that cannot be read.
    """
    form = source_format(path, from_format or (None if mapping is None else mapping.source))
    return form, list(form.tables(path, (lambda _: None) if mapping is None else mapping.dialect))


def geometry_in(
    tables: Sequence[SourceTable], mapping: Mapping | None, name: str
) -> tuple[SourceTable, GeometryReading, str] | None:
    """Return the table of track geometry among those of a source, how it is read, and the run's name, by default
    ``name``.

    None where the source is none: by the mapping, or because it has a gyro or no channel of track geometry. Raises
    :class:`BadInputError` for a mapping whose table is missing.
    """
    if mapping is not None and mapping.geometry is None:
        return None
    if mapping is not None:
        options = mapping.of_source(tables).geometry
        assert options is not None
        stated = _completed(options, tables, mapping.name)
        return table_named(tables, stated.file, "geometry"), stated, str(mapping.top.get("id", name))
    if any(triples(table, "gyro") for table in tables):
        return None
    reading = proposed_reading(tables)
    if reading is None:
        return None
    return table_named(tables, reading.file, "geometry"), reading, name


def _completed(stated: GeometryOptions, tables: Sequence[SourceTable], name: str) -> GeometryReading:
    """Return how a table is read: what a mapping of that name states, else what names and units of its columns show."""
    options = stated.model_dump(exclude_unset=True)
    if stated.place is None or stated.channels is None:
        table = next((table for table in tables if fits(table.name, stated.file)), None)
        proposed = proposed_reading(tables if table is None or "file" not in options else [table])
        if proposed is None:
            missing = " and ".join(key for key in ("place", "channels") if options.get(key) is None)
            raise BadInputError(
                f"{name}: section [geometry] states no {missing}, which the names of the columns do not show; "
                "expected the source's names of them"
            )
        shown = proposed.model_dump(exclude_unset=True)
        if stated.place is not None:
            shown.pop("chainage_unit", None)
        options = {**shown, **{key: value for key, value in options.items() if value is not None}}
    return GeometryReading.model_validate(options)


def geometry_mapping_text(reading: GeometryReading) -> str:
    """Return the mapping by which a table is read in this way."""
    section = reading.model_dump(mode="json", exclude_none=True)
    return tomli_w.dumps({"format": FORMAT, "geometry": section})


def read_geometry(path: Path) -> Result:
    """Read a result, or another system's channel table as one. Raises :class:`BadInputError` where it is neither."""
    if RESULT_FOLDER.holds(path) or kind_of(path) not in (None, "result"):
        return Result.read(path)  # which says what another folder of trackfg is, and what to do
    measured = geometry_in(source_tables(path, None, None)[1], None, path.stem)
    if measured is None:
        raise BadInputError(
            f"{path}: neither a result nor a table of track geometry: no column of a place and a channel such as "
            "level, alignment, cross-level. Hint: name them in a mapping and import it"
        )
    return measured_result(*measured)
