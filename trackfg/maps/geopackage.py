"""An SQLite file is a GeoPackage 1.2 (OGC 12-128r14) by its header, its own tables, and the layers listed there."""

from __future__ import annotations

from trackfg.maps.layers import WGS_84, Layer
from trackfg.maps.schema import Schema
from trackfg.maps.sql import sa
from trackfg.numerics.geometry_blob import geopackage_line, geopackage_point

APPLICATION_ID = int.from_bytes(b"GPKG", "big")
"""SQLite's application id of a GeoPackage (OGC 12-128r14, 1.1.1)."""
USER_VERSION = 10200
"""Version 1.2.0 of GeoPackage."""
UNDEFINED_CARTESIAN = -1
"""GeoPackage's number of the undefined Cartesian reference system."""

_NOW = "strftime('%Y-%m-%dT%H:%M:%fZ', 'now')"

_TABLES = (
    """CREATE TABLE gpkg_spatial_ref_sys (
        srs_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL PRIMARY KEY,
        organization TEXT NOT NULL,
        organization_coordsys_id INTEGER NOT NULL,
        definition TEXT NOT NULL,
        description TEXT
    )""",
    f"""CREATE TABLE gpkg_contents (
        table_name TEXT NOT NULL PRIMARY KEY,
        data_type TEXT NOT NULL,
        identifier TEXT UNIQUE,
        description TEXT DEFAULT '',
        last_change DATETIME NOT NULL DEFAULT ({_NOW}),
        min_x DOUBLE,
        min_y DOUBLE,
        max_x DOUBLE,
        max_y DOUBLE,
        srs_id INTEGER,
        CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id)
    )""",
    """CREATE TABLE gpkg_geometry_columns (
        table_name TEXT NOT NULL,
        column_name TEXT NOT NULL,
        geometry_type_name TEXT NOT NULL,
        srs_id INTEGER NOT NULL,
        z TINYINT NOT NULL,
        m TINYINT NOT NULL,
        CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
        CONSTRAINT uk_gc_table_name UNIQUE (table_name),
        CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
        CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id)
    )""",
)

_WGS_84_WKT = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_REFERENCE_SYSTEMS = (
    ("Undefined Cartesian SRS", UNDEFINED_CARTESIAN, "NONE", -1, "undefined", "local frame of a map without a place"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", None),
    (
        "WGS 84 geodetic",
        WGS_84,
        "EPSG",
        4326,
        _WGS_84_WKT,
        "longitude and latitude, deg; height above the ellipsoid, m",
    ),
)


def create(connection: sa.Connection, schema: Schema) -> None:
    """Make an empty file a GeoPackage with the tables of a map."""
    connection.exec_driver_sql(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.exec_driver_sql(f"PRAGMA user_version = {USER_VERSION}")
    for statement in _TABLES:
        connection.exec_driver_sql(statement)
    connection.exec_driver_sql(
        "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)",
        list(_REFERENCE_SYSTEMS),
    )
    schema.metadata.create_all(connection, checkfirst=False)
    connection.exec_driver_sql(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES (?, 'attributes', ?)",
        [(name, name) for name in schema.metadata.tables],
    )


class _Geometry(sa.types.UserDefinedType[bytes]):
    """The type of a geometry column is the geometry's name, which GeoPackage demands; its content is bytes."""

    cache_ok = True

    def __init__(self, name: str) -> None:
        self.name = name

    def get_col_spec(self, **_: object) -> str:
        return self.name


def publish(connection: sa.Connection, version: int, drawn: tuple[Layer, ...]) -> None:
    """Replace the layers.

    Their tables are made anew, and with them goes a spatial index that a GIS added: its triggers call functions of the
    GIS.
    """
    connection.exec_driver_sql(f"UPDATE gpkg_contents SET last_change = {_NOW}")
    for layer in drawn:
        _remove(connection, layer.name)
        srs_id = WGS_84 if layer.georeferenced else UNDEFINED_CARTESIAN
        connection.exec_driver_sql(
            "INSERT INTO gpkg_contents "
            "(table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id) "
            "VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?)",
            (layer.name, layer.name, layer.description, *(layer.extent or (None,) * 4), srs_id),
        )
        connection.exec_driver_sql(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 1, ?)",
            (layer.name, layer.geometry, srs_id, int(layer.is_measured)),
        )
        table = layer.table(None, _Geometry(layer.geometry))
        table.create(connection, checkfirst=False)
        blob = geopackage_line if layer.is_measured else geopackage_point
        rows = layer.rows(version, [None if place is None else blob(place, srs_id) for place in layer.coordinates])
        if rows:
            connection.execute(table.insert(), rows)


def check_triggers(connection: sa.Connection, schema: Schema) -> None:
    """Raise ``ValueError`` for a trigger on a table that a write changes: it would run what a stranger put into it.

    Triggers on the layers are a GIS's spatial index and go with them.
    """
    written = {*schema.metadata.tables, "gpkg_contents", "gpkg_geometry_columns", "gpkg_extensions"}
    triggers = connection.exec_driver_sql("SELECT name, tbl_name FROM sqlite_master WHERE type = 'trigger'").all()
    for name, table in triggers:
        if str(table).lower() in written:
            raise ValueError(f"trigger {name!r} on table {str(table)!r}: expected none")


def _remove(connection: sa.Connection, name: str) -> None:
    connection.exec_driver_sql(f'DROP TABLE IF EXISTS "{name}"')
    connection.exec_driver_sql(f'DROP TABLE IF EXISTS "rtree_{name}_geom"')
    registers = connection.exec_driver_sql("SELECT name FROM sqlite_master WHERE name = 'gpkg_extensions'").first()
    if registers is not None:
        connection.exec_driver_sql("DELETE FROM gpkg_extensions WHERE table_name = ?", (name,))
    connection.exec_driver_sql("DELETE FROM gpkg_geometry_columns WHERE table_name = ?", (name,))
    connection.exec_driver_sql("DELETE FROM gpkg_contents WHERE table_name = ?", (name,))
