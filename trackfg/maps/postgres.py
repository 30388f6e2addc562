"""A map in PostgreSQL needs, besides its tables, a schema, a lock for writers, and geometry columns."""

from __future__ import annotations

from trackfg.maps.layers import WGS_84, Layer
from trackfg.maps.schema import Schema
from trackfg.maps.sql import sa
from trackfg.numerics.geometry_blob import line_wkb, point_wkb

_NO_SYSTEM = 0
"""PostGIS's number of no reference system."""
_BYTEA = "bytea"
"""Type of a geometry column without PostGIS."""


def lock(connection: sa.Connection, schema: Schema) -> None:
    """Wait until no other writes this map, until the end of the transaction. Readers are not held up."""
    key = sa.func.hashtextextended(f"trackfg map {schema.metadata.schema}", 0)
    connection.execute(sa.select(sa.func.pg_advisory_xact_lock(key)))


def create(connection: sa.Connection, schema: Schema) -> None:
    """Make the tables of a map, in a database schema that an owner of the database may have made for it."""
    name = str(schema.metadata.schema)
    if name not in sa.inspect(connection).get_schema_names():
        connection.execute(sa.schema.CreateSchema(name))
    schema.metadata.create_all(connection, checkfirst=False)


class _Geometry(sa.types.UserDefinedType[bytes]):
    """A column of PostGIS, whose type and functions are in the database schema ``home``; it is given WKB."""

    cache_ok = True

    def __init__(self, home: str, name: str, srid: int) -> None:
        self.home, self.name, self.srid = home, name, srid

    def get_col_spec(self, **_: object) -> str:
        return f'"{self.home}".geometry({self.name}, {self.srid})'

    def bind_expression(self, bindvalue: sa.BindParameter[bytes]) -> sa.ColumnElement[bytes]:
        wkb = sa.type_coerce(bindvalue, sa.LargeBinary())
        function: sa.ColumnElement[bytes] = getattr(sa.func, self.home).st_geomfromwkb(wkb, self.srid)
        return function


def publish(connection: sa.Connection, schema: Schema, version: int, drawn: tuple[Layer, ...]) -> None:
    """Replace the content of the layers. The tables stay, with the rights granted on them."""
    name = str(schema.metadata.schema)
    home = connection.execute(
        sa.text(
            "SELECT nspname FROM pg_extension JOIN pg_namespace n ON n.oid = extnamespace WHERE extname = 'postgis'"
        )
    ).scalar()
    for layer in drawn:
        column_type = _column_type(connection, name, layer.name)
        type_name = "LineStringZM" if layer.is_measured else "PointZ"
        srid = WGS_84 if layer.georeferenced else _NO_SYSTEM
        of_postgis = None if home is None or column_type == _BYTEA else _Geometry(home, type_name, srid)
        table = layer.table(name, of_postgis or sa.LargeBinary())
        if column_type is None:
            table.create(connection, checkfirst=False)
        else:
            connection.execute(table.delete())
            if of_postgis is not None and f",{srid})" not in _with_srid(column_type):
                shown = connection.dialect.identifier_preparer.format_table(table)
                change = f"ALTER TABLE {shown} ALTER COLUMN geom TYPE {of_postgis.get_col_spec()} USING NULL"
                connection.exec_driver_sql(change)
        blob = line_wkb if layer.is_measured else point_wkb
        rows = layer.rows(version, [None if place is None else blob(place) for place in layer.coordinates])
        if rows:
            connection.execute(table.insert(), rows)


def _column_type(connection: sa.Connection, schema: str, table: str) -> str | None:
    """Return a column's type as PostgreSQL writes it, None where there is no such table.

    Examples are ``bytea`` and ``geometry(PointZ,4326)``.
    """
    type_name = connection.execute(
        sa.text(
            "SELECT format_type(atttypid, atttypmod) FROM pg_attribute JOIN pg_class c ON c.oid = attrelid "
            "JOIN pg_namespace n ON n.oid = relnamespace "
            "WHERE nspname = :schema AND relname = :table AND attname = 'geom' AND NOT attisdropped"
        ),
        {"schema": schema, "table": table},
    ).scalar()
    return None if type_name is None else str(type_name)


def _with_srid(column_type: str) -> str:
    """Return a type with its reference system: PostGIS leaves the system 0 out, as in ``geometry(PointZ)``."""
    return column_type if "," in column_type else column_type.replace(")", f",{_NO_SYSTEM})")
