"""Maps in a GeoPackage or a PostgreSQL database: every write adds a version, and no version ever changes.

A write is one transaction: killed at any moment, it leaves what was there. A writer names the version that its map was
made from; if there is a newer one, :class:`MapConflictError` is raised and nothing is lost: the newest is read and the
run added to that. The check is made under a lock that only writers hold, so of two at once, one is refused.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.errors import BadInputError, TrackfgError, printable
from trackfg.maps import geopackage, postgres
from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
from trackfg.maps.layers import LAYERS, Layer, layers
from trackfg.maps.location import Location, locate
from trackfg.maps.rows import Matrix, get_matrices, insert_frame, put_matrices, read_frame
from trackfg.maps.schema import CONVENTION_COLUMNS, FORMAT, ORIGIN_COLUMNS, POOLED, ROWS_PER_VERSION
from trackfg.maps.sql import sa
from trackfg.numerics.arrays import Array

_RIGHT_HAND_SIDE = "d"
_DAMAGE = (ValueError, TypeError, OverflowError, RecursionError)
"""Exceptions of reading what no map holds: other types, infinite integers, JSON nested too deep."""


class MapConflictError(TrackfgError):
    """The map was written meanwhile.

    ``newest`` is the newest version there, ``parent`` the one that the map is made from; None where there is none.
    """

    def __init__(self, shown: str, parent: int | None, newest: int | None) -> None:
        self.parent, self.newest = parent, newest
        made = "made from no earlier version" if parent is None else f"made from version {parent}"
        stored = "there is no version" if newest is None else f"the newest there is version {newest}"
        super().__init__(
            f"{shown}: the map is {made}, but {stored}; nothing is written: read the newest and add to that"
        )


def read_map(location: str | os.PathLike[str], version: int | None = None) -> FeatureMap:
    """Read a version of a map.

    Parameters
    ----------
    location
        Path of a ``.gpkg``, or a ``postgresql://`` URL.
    version
        Its number; the newest if None.

    Returns
    -------
    FeatureMap
        Landmarks and grid of the line, m, with their covariances.

    Raises
    ------
    BadInputError
        Where there is no map or no such version, where it was written by a newer trackfg, or is damaged.

    Examples
    --------
    >>> from trackfg.maps import read_map
    >>> read_map("line.gpkg")
    <FeatureMap line: version 1, 0.296 km, 1 runs, 0 landmarks>
    """
    place = locate(location)
    with place.connect("read") as connection:
        _require_map(connection, place)
        newest = _newest(connection, place)
        wanted = newest if version is None else version
        versions = place.schema.versions
        pooled = versions.c[POOLED] if _stores_pooled(connection, place) else sa.null().label(POOLED)
        columns = (pooled if column.name == POOLED else column for column in versions.columns)
        row = connection.execute(sa.select(*columns).where(versions.c.version == wanted)).first()
        if row is None:
            stored = "no version" if newest is None else f"versions 1 to {newest}"
            raise BadInputError(f"{place.shown}: holds {stored}" + ("" if version is None else f", not {version}"))
        try:
            return _read(connection, place, row)
        except _DAMAGE as error:
            hint = "Hint: read an older version, or build the map again; its tables are not to be edited"
            raise BadInputError(
                f"{place.shown}: version {wanted} is damaged: {printable(str(error))}. {hint}"
            ) from error


def newest_version(location: str | os.PathLike[str]) -> int | None:
    """Return the number of the newest version; None where there is no map yet, but one can be made.

    Raises :class:`BadInputError` where something else than a map is.
    """
    place = locate(location)
    if place.path is not None and not place.path.exists():
        return None
    with place.connect("read") as connection:
        if _is_new(connection, place):
            return None
        _require_map(connection, place)
        return _newest(connection, place)


def read_versions(location: str | os.PathLike[str]) -> pd.DataFrame:
    """Read which versions a map has.

    Parameters
    ----------
    location
        Path of a ``.gpkg``, or a ``postgresql://`` URL.

    Returns
    -------
    pandas.DataFrame
        One row each: ``version, parent, written_at, name, runs`` (their number) and ``trackfg`` (the package's
        version).

    Raises
    ------
    BadInputError
        As :func:`read_map` does.

    Examples
    --------
    >>> from trackfg.maps import read_versions
    >>> read_versions("line.gpkg")["version"].tolist()
    [1]
    """
    place = locate(location)
    schema = place.schema
    with place.connect("read") as connection:
        _require_map(connection, place)
        runs = sa.select(sa.func.count()).where(schema.runs.c.version == schema.versions.c.version).scalar_subquery()
        heads = [schema.versions.c[name] for name in ("version", "parent", "written_at", "name")]
        rows = connection.execute(
            sa.select(*heads, runs, schema.versions.c.software).order_by(schema.versions.c.version)
        ).all()
    table = pd.DataFrame(rows, columns=["version", "parent", "written_at", "name", "runs", "software"])
    try:
        table["parent"] = table["parent"].astype("Int64")
        table["trackfg"] = [_object("software", text).get("trackfg", "") for text in table.pop("software")]
    except _DAMAGE as error:
        raise BadInputError(f"{place.shown}: its table of versions is damaged: {printable(str(error))}") from error
    return table.astype(dict.fromkeys(("written_at", "name", "trackfg"), "str"))


def write_map(feature_map: FeatureMap, location: str | os.PathLike[str], *, parent: int | None) -> FeatureMap:
    """Add a version to a map, or make the map with its first one.

    Parameters
    ----------
    feature_map
        The map as it is to be.
    location
        Path of a ``.gpkg``, or a ``postgresql://`` URL.
    parent
        The version that it was made from; None for the first one, where there is no map yet.

    Returns
    -------
    FeatureMap
        What was written, with its version.

    Raises
    ------
    MapConflictError
        Unless ``parent`` is the newest version there.
    BadInputError
        Where something else than a map is.
    ValueError
        For settings that JSON cannot hold.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import build_map
    >>> from trackfg.maps import write_map
    >>> line = build_map([trackfg.Result.read("out1")], name="line")
    >>> write_map(line, "copy.gpkg", parent=None)
    <FeatureMap line: version 1, 0.296 km, 1 runs, 0 landmarks>
    """
    place = locate(location)
    configuration, software = _json(feature_map.configuration), _json(dict(feature_map.software))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    with place.connect("create" if parent is None else "write") as connection:
        if place.path is None:
            postgres.lock(connection, place.schema)
        if _is_new(connection, place):
            creator = geopackage if place.path is not None else postgres
            creator.create(connection, place.schema)
            connection.execute(place.schema.format.insert(), {"fid": 1, "format": FORMAT})
        else:
            _require_map(connection, place)
        _check_triggers(connection, place)
        newest = _newest(connection, place)
        if newest != parent:
            raise MapConflictError(place.shown, parent, newest)
        _refuse_later_rows(connection, place, newest or 0)
        written = replace(feature_map, version=(newest or 0) + 1, parent=parent, written_at=now)
        _write(connection, place, written, configuration, software)
    return written


def _refuse_later_rows(connection: sa.Connection, place: Location, newest: int) -> None:
    """Raise :class:`BadInputError` where a table has rows of a version after the newest one: their keys are taken."""
    schema = place.schema
    for table in (schema.landmarks, schema.line, schema.grid, schema.runs):
        later = sa.select(sa.literal(1)).where(table.c.fid >= (newest + 1) * ROWS_PER_VERSION).limit(1)
        if connection.execute(later).first() is not None:
            raise BadInputError(
                f"{place.shown}: table {table.name} has rows of a version after {newest}, which table "
                f"{schema.versions.name} does not have: expected a row there for each version. Hint: build the map at "
                "another place"
            )


def draw(location: str | os.PathLike[str], feature_map: FeatureMap, drawn: tuple[Layer, ...]) -> None:
    """Put layers about a version into its map, in place of those of the same names; all else stays.

    Raises :class:`BadInputError` where there is no map, and for a table of another's with the name of a layer.
    """
    place = locate(location)
    with place.connect("write") as connection:
        _require_map(connection, place)
        _check_triggers(connection, place)
        stored = _table_names(connection, place)
        for layer in drawn:
            columns = {"fid", "geom", "version", *layer.attributes}
            schema = place.schema.metadata.schema
            if layer.name in stored and columns != {
                column["name"] for column in sa.inspect(connection).get_columns(layer.name, schema=schema)
            }:
                raise BadInputError(f"{place.shown}: holds another table {layer.name}; it is left alone: rename it")
        _publish(connection, place, feature_map.version or 0, drawn)


def _check_triggers(connection: sa.Connection, place: Location) -> None:
    if place.path is None:
        return
    try:
        geopackage.check_triggers(connection, place.schema)
    except ValueError as error:
        raise BadInputError(f"{place.shown}: {error}") from error


def _publish(connection: sa.Connection, place: Location, version: int, drawn: tuple[Layer, ...]) -> None:
    if place.path is not None:
        geopackage.publish(connection, version, drawn)
    else:
        postgres.publish(connection, place.schema, version, drawn)


def _json(content: Mapping[str, JsonValue]) -> str:
    return json.dumps(dict(content), allow_nan=False, ensure_ascii=False)


def _object(what: str, text: str) -> dict[str, Any]:
    """Return the object that a text of JSON has. Raises ``ValueError`` or ``TypeError`` for anything else."""
    content = json.loads(text)
    if not isinstance(content, dict):
        raise TypeError(f"{what}: expected a JSON object")
    return content


def _table_names(connection: sa.Connection, place: Location) -> set[str]:
    return set(sa.inspect(connection).get_table_names(schema=place.schema.metadata.schema))


def _is_new(connection: sa.Connection, place: Location) -> bool:
    """Return whether a map can be made here: in an empty file, or in a schema without tables of these names.

    Raises :class:`BadInputError` where a table of another's would be taken for a layer, whose content is replaced.
    """
    tables = _table_names(connection, place)
    if place.path is not None:
        return not tables
    if tables.intersection(table.name for table in place.schema.metadata.sorted_tables):
        return False
    if taken := sorted(tables.intersection(LAYERS)):
        raise BadInputError(f"{place.shown}: holds a table {taken[0]} but no map; expected a schema of the map's own")
    return True


def _require_map(connection: sa.Connection, place: Location) -> None:
    """Raise :class:`BadInputError` unless all tables are there, in a format that this version reads."""
    stored = _table_names(connection, place)
    tables = place.schema.metadata.sorted_tables
    if place.schema.format.name in stored:
        stored_format = connection.execute(sa.select(place.schema.format.c.format)).scalar()
        if stored_format != FORMAT:
            raise BadInputError(f"{place.shown}: has format {stored_format!r}; this version of trackfg reads {FORMAT}")
    if missing := sorted({table.name for table in tables} - stored):
        expected = "expected a feature map"
        if len(missing) == len(tables):
            raise BadInputError(f"{place.shown}: holds no feature map; {expected}")
        raise BadInputError(f"{place.shown}: table {missing[0]} is missing; {expected}")


def _newest(connection: sa.Connection, place: Location) -> int | None:
    newest: int | None = connection.execute(sa.select(sa.func.max(place.schema.versions.c.version))).scalar()
    return newest


def _write(connection: sa.Connection, place: Location, written: FeatureMap, configuration: str, software: str) -> None:
    schema = place.schema
    version = written.version
    assert version is not None
    names = tuple(written.landmarks["landmark_id"])
    head = {
        "version": version,
        "parent": written.parent,
        "written_at": written.written_at,
        "name": written.name,
        **{name: getattr(written.conventions, name) for name in CONVENTION_COLUMNS},
        **dict(zip(ORIGIN_COLUMNS, written.origin or (None,) * 3, strict=True)),
        "configuration": configuration,
        "software": software,
        "covariance_sha256": put_matrices(connection, schema, [(names, written.covariance)])[0],
    }
    if written.pooled is not None and _stores_pooled(connection, place):
        head[POOLED] = put_matrices(connection, schema, [_matrix(written.pooled)])[0]
    connection.execute(schema.versions.insert(), head)
    for table, frame in (
        (schema.landmarks, written.landmarks),
        (schema.line, written.line),
        (schema.grid, written.grid),
        (schema.runs, _runs_with_addresses(connection, place, written)),
    ):
        insert_frame(connection, table, version, frame)
    _publish(connection, place, version, layers(written))


def _runs_with_addresses(connection: sa.Connection, place: Location, written: FeatureMap) -> pd.DataFrame:
    matrices = [_matrix(rows) for rows in written.information.values()]
    addresses = dict(zip(written.information, put_matrices(connection, place.schema, matrices), strict=True))
    by_run = [addresses.get(run) for run in written.runs["run_id"]]
    return written.runs.assign(information_sha256=pd.Series(by_run, dtype="object"))


def _read(connection: sa.Connection, place: Location, row: sa.Row[tuple[object, ...]]) -> FeatureMap:
    schema = place.schema
    head = row._mapping
    version = int(row.version)
    names, covariance = get_matrices(connection, schema, [row.covariance_sha256])[row.covariance_sha256]
    landmarks = read_frame(connection, schema.landmarks, version)
    if names != tuple(landmarks["landmark_id"]):
        raise ValueError("the covariance is of other landmarks")
    runs = read_frame(connection, schema.runs, version)
    addresses = {
        run: address
        for run, address in zip(runs["run_id"], runs.pop("information_sha256"), strict=True)
        if isinstance(address, str)
    }
    matrices = get_matrices(connection, schema, list(addresses.values()))
    information = {run: _information(*matrices[address]) for run, address in addresses.items()}
    address = head[POOLED]
    pooled = None if address is None else _information(*get_matrices(connection, schema, [address])[address])
    origin = tuple(head[name] for name in ORIGIN_COLUMNS)
    return FeatureMap(
        name=row.name,
        conventions=MapConventions(**{name: head[name] for name in CONVENTION_COLUMNS}),
        landmarks=landmarks,
        covariance=covariance,
        grid=read_frame(connection, schema.grid, version),
        line=read_frame(connection, schema.line, version),
        runs=runs,
        information=information,
        configuration=_object("configuration", row.configuration),
        software=_object("software", row.software),
        origin=None if None in origin else (float(origin[0]), float(origin[1]), float(origin[2])),
        pooled=pooled,
        version=version,
        parent=row.parent,
        written_at=row.written_at,
    )


def _stores_pooled(connection: sa.Connection, place: Location) -> bool:
    versions = place.schema.versions
    columns = sa.inspect(connection).get_columns(versions.name, schema=versions.schema)
    return any(column["name"] == POOLED for column in columns)


def _matrix(rows: RunInformation) -> Matrix:
    return (*rows.variables, _RIGHT_HAND_SIDE), np.column_stack([rows.R, rows.d])


def _information(names: tuple[str, ...], values: Array) -> RunInformation:
    return RunInformation(names[:-1], values[:, :-1], values[:, -1])
