"""The file is a GeoPackage: what the standard (OGC 12-128r14, version 1.2) requires, and what GDAL makes of it.

Requirement numbers are those of the standard.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.maps import FeatureMap, read_map, write_map

MakeMap = Callable[..., FeatureMap]
ORIGIN = (35.2, 137.1, 40.0)
ALLOWED_TYPES = {"BOOLEAN", "TINYINT", "SMALLINT", "MEDIUMINT", "INT", "INTEGER", "FLOAT", "DOUBLE", "REAL", "TEXT"}
ALLOWED_TYPES |= {"BLOB", "DATE", "DATETIME", "POINT", "LINESTRING"}


@pytest.fixture(scope="module", params=[None, ORIGIN], ids=["local", "georeferenced"])
def path(request: pytest.FixtureRequest, make_map: MakeMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two versions, the second of them with other landmarks, georeferenced or not."""
    path = tmp_path_factory.mktemp("maps") / "line.gpkg"
    write_map(make_map(), path, parent=None)
    write_map(make_map(curves=4, seed=1, cells=10_001, origin=request.param), path, parent=1)
    return path


@pytest.fixture
def database(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path)) as connection:
        connection.row_factory = sqlite3.Row
        yield connection


def rows(database: sqlite3.Connection, query: str) -> list[dict[str, Any]]:
    return [dict(row) for row in database.execute(query)]


def columns(database: sqlite3.Connection, table: str) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in rows(database, f'PRAGMA table_info("{table}")')}


def test_head(path: Path, database: sqlite3.Connection) -> None:
    """Requirements 1-3 and 6, 7: an SQLite 3 file of the standard's id and version, sound, suffix .gpkg."""
    head = path.read_bytes()[:100]
    assert head[:16] == b"SQLite format 3\0"
    assert head[68:72] == b"GPKG"
    assert struct.unpack(">I", head[60:64]) == (10200,)
    assert path.suffix == ".gpkg"
    assert [tuple(row) for row in database.execute("PRAGMA integrity_check")] == [("ok",)]
    assert database.execute("PRAGMA foreign_key_check").fetchall() == []


def test_reference_systems(database: sqlite3.Connection) -> None:
    """Requirements 10-12: the table's columns and the three systems that every GeoPackage has."""
    assert list(columns(database, "gpkg_spatial_ref_sys")) == [
        "srs_name",
        "srs_id",
        "organization",
        "organization_coordsys_id",
        "definition",
        "description",
    ]
    found = {row["srs_id"]: row for row in rows(database, "SELECT * FROM gpkg_spatial_ref_sys")}
    assert set(found) == {-1, 0, 4326}
    assert (found[4326]["organization"].upper(), found[4326]["organization_coordsys_id"]) == ("EPSG", 4326)
    assert found[4326]["definition"].startswith("GEOGCS[")
    for undefined in (-1, 0):
        row = found[undefined]
        assert (row["organization"], row["organization_coordsys_id"]) == ("NONE", undefined)
        assert row["definition"] == "undefined"


def test_contents(database: sqlite3.Connection) -> None:
    """Requirements 13-15: every table of ours is listed, everything listed is there, times are ISO 8601."""
    assert list(columns(database, "gpkg_contents")) == [
        "table_name",
        "data_type",
        "identifier",
        "description",
        "last_change",
        "min_x",
        "min_y",
        "max_x",
        "max_y",
        "srs_id",
    ]
    listed = {row["table_name"]: row for row in rows(database, "SELECT * FROM gpkg_contents")}
    tables = {row["name"] for row in rows(database, "SELECT name FROM sqlite_master WHERE type = 'table'")}
    own = {name for name in tables if not name.startswith(("gpkg_", "sqlite_"))}
    assert set(listed) == own
    kinds = {name: row["data_type"] for name, row in listed.items()}
    assert {name for name, kind in kinds.items() if kind == "features"} == {"landmarks", "reference_line"}
    assert set(kinds.values()) == {"features", "attributes"}
    iso = "[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]T[0-9][0-9]:[0-9][0-9]:[0-9][0-9].[0-9][0-9][0-9]Z"
    assert rows(database, f"SELECT * FROM gpkg_contents WHERE last_change NOT GLOB '{iso}'") == []


def test_geometry_columns(database: sqlite3.Connection) -> None:
    """Requirements 21-28: one row per layer, in the system of its contents."""
    assert list(columns(database, "gpkg_geometry_columns")) == [
        "table_name",
        "column_name",
        "geometry_type_name",
        "srs_id",
        "z",
        "m",
    ]
    found = {row["table_name"]: row for row in rows(database, "SELECT * FROM gpkg_geometry_columns")}
    contents = {row["table_name"]: row["srs_id"] for row in rows(database, "SELECT * FROM gpkg_contents")}
    assert set(found) == {"landmarks", "reference_line"}
    for layer, kind, measured in (("landmarks", "POINT", 0), ("reference_line", "LINESTRING", 1)):
        row = found[layer]
        assert (row["column_name"], row["geometry_type_name"], row["z"], row["m"]) == ("geom", kind, 1, measured)
        assert row["srs_id"] == contents[layer]
        assert columns(database, layer)["geom"]["type"] == kind


def test_tables(database: sqlite3.Connection) -> None:
    """Requirements 5, 29-31 and 119: an INTEGER key that numbers the rows, types of the standard, lower-case names."""
    for row in rows(database, "SELECT table_name FROM gpkg_contents"):
        name = row["table_name"]
        found = columns(database, name)
        keys = [column for column, about in found.items() if about["pk"]]
        assert len(keys) == 1
        assert found[keys[0]]["type"] == "INTEGER"
        (made,) = rows(database, f"SELECT sql FROM sqlite_master WHERE name = '{name}'")
        assert "PRIMARY KEY AUTOINCREMENT" in made["sql"]
        assert {about["type"] for about in found.values()} <= ALLOWED_TYPES
        assert all(column == column.lower() for column in (name, *found))


def test_geometries(path: Path, database: sqlite3.Connection) -> None:
    """Requirements 19, 20, 32, 33: header, envelope and well-known binary, in the system that the table says."""
    georeferenced = read_map(path).origin is not None
    for layer, code in (("landmarks", 1001), ("reference_line", 3002)):
        (about,) = rows(database, f"SELECT * FROM gpkg_contents WHERE table_name = '{layer}'")
        assert about["srs_id"] == (4326 if georeferenced else -1)
        everywhere = []
        for row in rows(database, f"SELECT geom FROM {layer} WHERE geom IS NOT NULL"):
            blob = row["geom"]
            magic, version, flags, srs_id = struct.unpack_from("<2sBBi", blob)
            assert (magic, version, flags & 1, flags & 0b110000, srs_id) == (b"GP", 0, 1, 0, about["srs_id"])
            envelope = np.frombuffer(blob, "<f8", {0: 0, 1: 4}[(flags >> 1) & 0b111], 8)
            body = blob[8 + envelope.nbytes :]
            order, kind = struct.unpack_from("<BI", body)
            assert (order, kind) == (1, code)
            xy = np.frombuffer(body, "<f8", 3, 5)[None, :2]
            if layer == "reference_line":
                xy = np.frombuffer(body, "<f8", offset=9).reshape(-1, 4)[:, :2]
                assert struct.unpack_from("<I", body, 5) == (len(xy),)
                assert envelope.tolist() == [xy[:, 0].min(), xy[:, 0].max(), xy[:, 1].min(), xy[:, 1].max()]
            everywhere.append(xy)
        extent = np.concatenate(everywhere)
        assert [about["min_x"], about["min_y"]] == extent.min(axis=0).tolist()
        assert [about["max_x"], about["max_y"]] == extent.max(axis=0).tolist()


def test_the_layers_show_the_newest_version(path: Path, database: sqlite3.Connection) -> None:
    newest = read_map(path)
    shown = rows(database, "SELECT landmark_id, version, geom IS NULL AS nowhere FROM landmarks ORDER BY fid")
    assert [row["landmark_id"] for row in shown] == newest.landmarks["landmark_id"].tolist()
    assert {row["version"] for row in shown} == {2}
    assert [bool(row["nowhere"]) for row in shown] == newest.landmarks["east_m"].isna().tolist()
    pieces = rows(database, "SELECT from_m, to_m FROM reference_line ORDER BY fid")
    assert [(row["from_m"], row["to_m"]) for row in pieces] == [(0.0, 1000.0), (1000.0, 2000.0), (2000.0, 2500.0)]


@pytest.mark.filterwarnings("ignore:Measured .M. geometry types:UserWarning")  # pyogrio's own limit, not GDAL's
def test_gdal_reads_it(path: Path) -> None:
    """Layers, types, systems and coordinates as GDAL, hence QGIS, sees them; its warnings would be errors here."""
    pyogrio = pytest.importorskip("pyogrio")
    newest = read_map(path)
    listed = dict(pyogrio.list_layers(path))
    assert listed["landmarks"] == "Point Z"
    assert listed["reference_line"].startswith("LineString Z")
    assert {name for name, kind in listed.items() if kind is None} == {
        "map_format",
        "map_grid",
        "map_landmarks",
        "map_line",
        "map_matrices",
        "map_runs",
        "map_versions",
    }
    about = pyogrio.read_info(path, layer="landmarks")
    assert about["features"] == len(newest.landmarks)
    if newest.origin is not None:
        assert about["crs"] == "EPSG:4326"
        np.testing.assert_allclose(about["total_bounds"][:2], [137.1, 35.2], atol=0.1)
    else:
        assert "Undefined Cartesian SRS" in about["crs"]
    meta, _, geometry, data = pyogrio.raw.read(path, layer="landmarks", columns=["landmark_id", "chainage_m"])
    assert meta["geometry_type"] == "Point Z"
    assert data[list(meta["fields"]).index("landmark_id")].tolist() == newest.landmarks["landmark_id"].tolist()
    assert [place is None for place in geometry] == newest.landmarks["east_m"].isna().tolist()
    assert pyogrio.read_info(path, layer="map_grid")["features"] == 1601 + 10_001


def test_a_spatial_index_of_a_gis_does_not_stop_the_next_write(make_map: MakeMap, tmp_path: Path) -> None:
    """Its triggers call functions that only the GIS has; it goes with the old layer, and the map is written."""
    path = tmp_path / "line.gpkg"
    write_map(make_map(), path, parent=None)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.executescript("""
            CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,
                definition TEXT NOT NULL, scope TEXT NOT NULL);
            INSERT INTO gpkg_extensions VALUES ('landmarks', 'geom', 'gpkg_rtree_index', 'http://x', 'write-only');
            CREATE VIRTUAL TABLE rtree_landmarks_geom USING rtree(id, minx, maxx, miny, maxy);
            CREATE TRIGGER rtree_landmarks_geom_insert AFTER INSERT ON landmarks
                WHEN (NEW.geom NOT NULL AND NOT ST_IsEmpty(NEW.geom))
                BEGIN INSERT INTO rtree_landmarks_geom VALUES (NEW.fid, ST_MinX(NEW.geom), 0, 0, 0); END;
        """)
    write_map(make_map(seed=1), path, parent=1)
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("SELECT count(*) FROM landmarks").fetchone() == (13,)
        assert connection.execute("SELECT count(*) FROM gpkg_extensions").fetchone() == (0,)
        assert connection.execute("SELECT name FROM sqlite_master WHERE name LIKE 'rtree%'").fetchall() == []
