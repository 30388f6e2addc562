"""What the user lays behind the map: GeoJSON and GeoPackage, in the run's east and north."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.numerics.geodesy import enu_to_geodetic
from trackfg.report.motion_charts import PathMark, path_map
from trackfg.report.sections.background import Background, read_background
from trackfg.results.result import Result

ORIGIN = (35.2, 139.0, 0.0)
SQUARE = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 200.0), (0.0, 0.0)])


def geographic(vertices: np.ndarray) -> list[list[float]]:
    enu = np.column_stack([vertices, np.zeros(len(vertices))])
    return [[lon, lat] for lat, lon, _ in enu_to_geodetic(enu, ORIGIN).tolist()]


def geojson(path: Path, *features: dict[str, object], **more: object) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features), **more}))
    return path


def test_geojson_comes_to_the_east_and_north_of_the_run(tmp_path: Path) -> None:
    ring = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [geographic(SQUARE)]}, "properties": None}
    stop = {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": geographic(SQUARE[1:2])[0]},
        "properties": {"Name": "Here"},
    }
    found = read_background(geojson(tmp_path / "a.geojson", ring, stop), ORIGIN)
    (line,) = found.lines
    np.testing.assert_allclose(line, SQUARE, atol=1e-3)
    ((name, east, north),) = found.points
    assert (name, east, north) == ("Here", pytest.approx(100.0, abs=1e-3), pytest.approx(0.0, abs=1e-3))


def geopackage(path: Path, srs: int, *blobs: bytes | None) -> Path:
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE gpkg_spatial_ref_sys (srs_id INTEGER, organization_coordsys_id INTEGER);"
            "CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, srs_id INTEGER);"
            "CREATE TABLE tracks (fid INTEGER, geom BLOB, name TEXT);"
            f"INSERT INTO gpkg_spatial_ref_sys VALUES ({srs}, {srs});"
            f"INSERT INTO gpkg_geometry_columns VALUES ('tracks', 'geom', {srs});"
        )
        database.executemany("INSERT INTO tracks VALUES (1, ?, 'T')", [(blob,) for blob in blobs])
    return path


def test_a_geopackage_in_a_plane_is_taken_as_it_is(tmp_path: Path) -> None:
    """A multi line of big-endian parts with height, and an extent before it."""
    part = b"\0" + struct.pack(">II", 1002, 2) + struct.pack(">6d", 1, 2, 9, 3, 4, 9)
    blob = b"GP\0\x03" + struct.pack("<i4d", -1, 1, 3, 2, 4) + b"\1" + struct.pack("<II", 1005, 2) + part + part
    found = read_background(geopackage(tmp_path / "a.gpkg", -1, blob), None)
    assert [line.tolist() for line in found.lines] == [[[1.0, 2.0], [3.0, 4.0]]] * 2


def test_rows_of_a_geopackage_without_geometry_are_passed_over(tmp_path: Path) -> None:
    line = b"GP\0\x01" + struct.pack("<i", -1) + b"\1" + struct.pack("<II4d", 2, 2, 1, 2, 3, 4)
    found = read_background(geopackage(tmp_path / "a.gpkg", -1, None, line), None)
    assert [line.tolist() for line in found.lines] == [[[1.0, 2.0], [3.0, 4.0]]]


def test_a_geopackage_in_another_system_is_projected(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    ((lon, lat),) = geographic(SQUARE[1:2])
    x, y = pyproj.Transformer.from_crs(4326, 32654, always_xy=True).transform(lon, lat)
    blob = b"GP\0\x01" + struct.pack("<i", 32654) + b"\1" + struct.pack("<I2d", 1, x, y)
    ((name, east, north),) = read_background(geopackage(tmp_path / "a.gpkg", 32654, blob), ORIGIN).points
    assert (name, east, north) == ("T", pytest.approx(100.0, abs=0.01), pytest.approx(0.0, abs=0.01))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not readable as GeoJSON"),
        ("{}", "expected a FeatureCollection"),
        ('{"features": [], "crs": {"type": "name"}}', "crs has no name"),
        (
            '{"features": [{"geometry": {"type": "Point", "coordinates": ["a", 1]}}]}',
            "feature 1: a vertex is no pos",
        ),
    ],
)
def test_bad_geojson_is_named(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "a.geojson"
    path.write_text(content)
    with pytest.raises(BadInputError, match=said):
        read_background(path, ORIGIN)


def test_bad_geopackages_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.gpkg").write_bytes(b"no database at all, but long enough to be looked at" * 30)
    with pytest.raises(BadInputError, match="not readable as a GeoPackage"):
        read_background(tmp_path / "a.gpkg", ORIGIN)
    cut = b"GP\0\x01" + struct.pack("<i", 4326) + b"\1" + struct.pack("<II", 2, 1000)
    with pytest.raises(BadInputError, match="row 1: the geometry is cut off"):
        read_background(geopackage(tmp_path / "b.gpkg", 4326, cut), ORIGIN)
    point = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [139.0, 35.2]}, "properties": None}
    with pytest.raises(BadInputError, match="knows no place on the Earth"):
        read_background(geojson(tmp_path / "a.json", point), None)
    with pytest.raises(BadInputError, match="ends in"):
        read_background(tmp_path / "a.dxf", ORIGIN)


def test_named_points_beside_the_path_are_stations(result: Result) -> None:
    at = result.trajectory.iloc[500]
    points = (("Near", at["east_m"] + 5.0, at["north_m"]), ("Far", 1e5, 0.0))
    assert Background((), points).stations(result) == [("Near", pytest.approx(at["chainage_m"], abs=10.0))]


def test_the_map_names_what_has_an_id(make_result: Callable[..., Result]) -> None:
    result = make_result(rows=500)
    at = result.trajectory.iloc[300]
    far = np.array([(1e6, 1e6), (1e6, 2e6)])
    figure = path_map(result, None, [PathMark("balises", "B<7>", float(at["chainage_m"]))], [far], [])
    (balise,) = (trace for trace in figure.traces if trace["name"] == "balises")
    assert balise["text"] == ["B&lt;7&gt;"]
    assert (balise["x"][0], balise["y"][0]) == pytest.approx((at["east_m"], at["north_m"]), abs=0.01)
    assert "background" not in {trace["name"] for trace in figure.traces}


def test_geojson_with_the_reference_system_of_a_country_is_projected(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    ((lon, lat),) = geographic(SQUARE[1:2])
    place = pyproj.Transformer.from_crs(4326, 32654, always_xy=True).transform(lon, lat)
    stop = {"type": "Feature", "geometry": {"type": "Point", "coordinates": place}, "properties": {"ref": "T"}}
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32654"}}
    ((name, east, north),) = read_background(geojson(tmp_path / "a.geojson", stop, crs=crs), ORIGIN).points
    assert (name, east, north) == ("T", pytest.approx(100.0, abs=0.01), pytest.approx(0.0, abs=0.01))
