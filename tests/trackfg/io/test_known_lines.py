"""Files of known tracks: written by other libraries, read back equal; broken ones are refused with place and reason."""

from __future__ import annotations

import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.io.content import line_sha256
from trackfg.io.known_lines import read_known_line
from trackfg.numerics.geometry_blob import geometry_of_wkb

TRACKS = {"A": [[139.0, 35.2], [139.01, 35.2]], "B": [[139.01, 35.2], [139.02, 35.2], [139.03, 35.201]]}


def feature(track: str, line: object, kind: str = "LineString") -> dict[str, Any]:
    return {"type": "Feature", "properties": {"id": track}, "geometry": {"type": kind, "coordinates": line}}


def relation(**about: object) -> dict[str, Any]:
    own = {"netelementA": "A", "positionOnA": 1, "netelementB": "B", "positionOnB": 0, "navigability": "AB"}
    return {"type": "Feature", "properties": own | about, "geometry": None}


def written(path: Path, *features: object, **more: object) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)} | more))
    return path


def test_geojson_with_netrelations(tmp_path: Path) -> None:
    tracks = [feature(track, line) for track, line in TRACKS.items()]
    dangling, closed = relation(netelementB="elsewhere"), relation(navigability="none")
    line = read_known_line(written(tmp_path / "net.geojson", *tracks, relation(), dangling, closed))
    assert line.ids == ("A", "B")
    np.testing.assert_array_equal(line.vertices[1][:, ::-1], TRACKS["B"])
    assert line.relations is not None
    assert [(r.a, r.on_a, r.b, r.on_b, r.forth, r.back) for r in line.relations] == [("A", 1.0, "B", 0.0, True, False)]
    assert not line.is_local
    assert line.only(["B"]).ids == ("B",)
    assert line.only(["B"]).relations == ()
    with pytest.raises(BadInputError, match="no track 'C'"):
        line.only(["C"])


def test_ids_and_parts(tmp_path: Path) -> None:
    parts = feature("both", list(TRACKS.values()), "MultiLineString")
    unnamed = {"type": "Feature", "properties": None, "geometry": {"type": "LineString", "coordinates": TRACKS["A"]}}
    named = {"type": "Feature", "id": 7, "properties": {"NAME": "x"}, "geometry": unnamed["geometry"]}
    line = read_known_line(written(tmp_path / "net.json", parts, unnamed, named))
    assert line.ids == ("both", "both", "2", "7")
    assert line.relations is None


@pytest.mark.parametrize("content", [feature("1", TRACKS["B"]), feature("", TRACKS["B"])["geometry"]])
def test_a_feature_and_a_geometry_are_geojson_by_themselves(content: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "line.geojson").write_text(json.dumps(content))
    line = read_known_line(tmp_path / "line.geojson")
    assert line.ids == ("1",)
    np.testing.assert_array_equal(line.vertices[0][:, ::-1], TRACKS["B"])


def test_other_reference_systems(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:6677", always_xy=True)
    plane = [list(to_plane.transform(*vertex)) for vertex in TRACKS["B"]]
    named = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::6677"}}
    by_file = read_known_line(written(tmp_path / "net.geojson", feature("B", plane), crs=named))
    by_option = read_known_line(written(tmp_path / "net.geojson", feature("B", plane)), "EPSG:6677")
    for line in (by_file, by_option):
        np.testing.assert_allclose(line.vertices[0][:, ::-1], TRACKS["B"], atol=1e-9)
    local = read_known_line(tmp_path / "net.geojson", "local")
    assert local.is_local
    np.testing.assert_array_equal(local.vertices[0], plane)
    with pytest.raises(BadInputError, match="unknown reference system 'EPSG:1'"):
        read_known_line(tmp_path / "net.geojson", "EPSG:1")


def test_geopackage(tmp_path: Path) -> None:
    """A layer of tracks and one of relations without geometry, in a national grid, written by GDAL."""
    raw, pyproj = pytest.importorskip("pyogrio.raw"), pytest.importorskip("pyproj")
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:6677", always_xy=True)
    blobs = [
        struct.pack("<BII", 1, 2, len(line)) + np.array([to_plane.transform(*v) for v in line]).tobytes()
        for line in TRACKS.values()
    ]
    path = tmp_path / "net.gpkg"
    ids = [np.array(list(TRACKS), dtype=object)]
    geometry = np.array(blobs, dtype=object)
    raw.write(path, geometry, ids, ["id"], layer="tracks", geometry_type="LineString", crs="EPSG:6677")
    about = relation()["properties"]
    columns = [np.array([value], dtype=object if isinstance(value, str) else float) for value in about.values()]
    raw.write(path, None, columns, list(about), layer="relations", geometry_type=None, append=True, driver="GPKG")
    line = read_known_line(path)
    assert line.ids == ("A", "B")
    for vertices, track in zip(line.vertices, TRACKS.values(), strict=True):
        np.testing.assert_allclose(vertices[:, ::-1], track, atol=1e-9)
    assert line.relations is not None
    assert len(line.relations) == 1
    raised = [struct.pack("<BII", 1, 1002, 2) + np.array([[*v, 30.0] for v in TRACKS["A"]]).tobytes()]
    column = [np.array(["Z"], dtype=object)]
    with_height = {"layer": "path", "geometry_type": "LineString Z", "crs": "EPSG:4326"}
    raw.write(tmp_path / "height.gpkg", np.array(raised, dtype=object), column, ["name"], **with_height)
    line = read_known_line(tmp_path / "height.gpkg")
    assert line.ids == ("Z",)
    np.testing.assert_allclose(line.vertices[0][:, ::-1], TRACKS["A"], atol=1e-12)
    (tmp_path / "bad.gpkg").write_bytes(path.read_bytes()[:1000])
    with pytest.raises(BadInputError, match=r"bad\.gpkg: not readable as a GeoPackage"):
        read_known_line(tmp_path / "bad.gpkg")


@pytest.mark.parametrize("order", ["<", ">"])
def test_well_known_binary(order: str) -> None:
    """Lines with height, with measure, with both, and several, in both byte orders."""
    flag = 1 if order == "<" else 0
    values = np.arange(12.0)
    for code, dims in ((2, 2), (1002, 3), (2002, 3), (3002, 4), (0x80000002, 3), (0xC0000002, 4)):
        line = values[: 3 * dims].reshape(3, dims)
        blob = struct.pack(f"{order}BII", flag, code, 3) + line.astype(f"{order}f8").tobytes()
        kind, (vertices,) = geometry_of_wkb(blob)
        assert kind == "LineString"
        np.testing.assert_array_equal(vertices, line)
        kind, several = geometry_of_wkb(struct.pack(f"{order}BII", flag, code + 3, 2) + blob + blob)
        assert kind == "MultiLineString"
        assert [len(part) for part in several] == [3, 3]
        with pytest.raises(ValueError, match="cut off"):
            geometry_of_wkb(blob[:-1])
    assert geometry_of_wkb(struct.pack(f"{order}BI2d", flag, 1, 0.0, 0.0))[0] == "Point"


BROKEN: dict[str, tuple[tuple[object, ...], dict[str, object], str]] = {
    "no features": ((), {"features": None}, "no list of features"),
    "no lines": ((relation(),), {}, "has no line"),
    "a point only": ((feature("A", [1.0, 2.0], "Point"),), {}, "has no line"),
    "a feature that is a number": ((7,), {}, "feature 1: is no object"),
    "one vertex": ((feature("A", [[139.0, 35.2]]),), {}, r"feature 1 \('A'\): has 1 vertices at one place"),
    "one place": ((feature("A", [[1.0, 2.0], [1.0, 2.0]]),), {}, "at one place"),
    "a vertex of text": ((feature("A", [["x", 2.0], [1.0, 2.0]]),), {}, "a vertex is no position"),
    "a vertex of one number": ((feature("A", [[1.0], [1.0, 2.0]]),), {}, "a vertex is no position"),
    "no coordinates": ((feature("A", None),), {}, "a vertex is no position"),
    "coordinates that are a number": ((feature("A", 7, "MultiLineString"),), {}, "coordinates are no list"),
    "metres": ((feature("A", [[155000.0, 174000.0], [155100.0, 174000.0]]),), {}, "no place in EPSG:4326.*--line-crs"),
    "latitude": ((feature("A", [[10.0, 95.0], [10.0, 94.0]]),), {}, "vertex 1: .*no place"),
    "a crs without a name": ((feature("A", TRACKS["A"]),), {"crs": {"type": "name"}}, "crs has no name"),
    "no netelement": ((relation(netelementA=None),), {}, "netelementA or netelementB is missing"),
    "a share of 2": ((relation(positionOnA=2),), {}, "positionOnA is 2: expected a share"),
    "a share that is true": ((relation(positionOnB=True),), {}, "positionOnB is True"),
    "navigability": (
        (relation(navigability="left"),),
        {},
        "navigability is 'left': expected one of both, AB, BA, none",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_geojson_is_refused(case: str, tmp_path: Path) -> None:
    features, more, message = BROKEN[case]
    path = written(tmp_path / "net.geojson", *features, **more)
    with pytest.raises(BadInputError, match=f"net.geojson: .*{message}") as error:
        read_known_line(path)
    assert "expected" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[1]", b"NaN", b'{"features": [' * 2000])
def test_what_is_no_geojson_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "net.geojson"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"net\.geojson: .*expected"):
        read_known_line(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="cannot be read"):
        read_known_line(tmp_path / "missing.geojson")
    with pytest.raises(BadInputError, match="cannot be read"):
        read_known_line(tmp_path / "missing.gpkg")
    with pytest.raises(BadInputError, match=r"expected one of \.geojson"):
        read_known_line(tmp_path / "line.dxf")
    values = [[float("nan"), 1.0], [1.0, 2.0]]
    with pytest.raises(BadInputError, match="not finite"):
        read_known_line(written(tmp_path / "net.geojson", feature("A", values)))


KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">'
    "<Document><Placemark><name>A</name><LineString><coordinates>139.0,35.2,12 139.01,35.2,13</coordinates>"
    "</LineString></Placemark><Placemark><name>home</name><Point><coordinates>1,2</coordinates></Point></Placemark>"
    "<Placemark><name>x</name><ExtendedData><Data name='track_id'><value>B</value></Data></ExtendedData><MultiGeometry>"
    "<LineString><coordinates>139.01,35.2\n139.02,35.2\n139.03,35.201</coordinates></LineString></MultiGeometry>"
    "</Placemark></Document></kml>"
)
GPX = (
    '<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1"><trk><name>A</name><trkseg>'
    '<trkpt lat="35.2" lon="139.0"/><trkpt lat="35.2" lon="139.01"/></trkseg></trk>'
    '<rte><name>B</name><rtept lat="35.2" lon="139.01"/><rtept lat="35.2" '
    'lon="139.02"/><rtept lat="35.201" lon="139.03"/></rte></gpx>'
)


@pytest.mark.parametrize("suffix", [".kml", ".kmz", ".gpx", ".shp"])
def test_lines_of_other_systems(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"line{suffix}"
    if suffix == ".kmz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("doc.kml", KML)
    elif suffix == ".shp":
        pyogrio = pytest.importorskip("pyogrio")
        blobs = [struct.pack("<BII", 1, 2, len(line)) + np.array(line, "<f8").tobytes() for line in TRACKS.values()]
        pyogrio.raw.write(
            path, np.array(blobs, dtype=object), [np.array([*TRACKS], dtype=object)], ["track_id"],
            geometry_type="LineString", crs="EPSG:4326", driver="ESRI Shapefile",
        )  # fmt: skip
    else:
        path.write_text(KML if suffix == ".kml" else GPX)

    line = read_known_line(path)

    assert line.ids == ("A", "B")
    for vertices, track in zip(line.vertices, TRACKS.values(), strict=True):
        np.testing.assert_array_equal(vertices[:, ::-1], track)


def test_a_damaged_kmz_of_lzma_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "line.kmz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("doc.kml", KML * 20)
    content = path.read_bytes()
    path.write_bytes(content[:60] + bytes(byte ^ 0x5A for byte in content[60:120]) + content[120:])

    with pytest.raises(BadInputError, match="cannot be unpacked"):
        read_known_line(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("line.kml", KML.replace("139.01,35.2,13", "139.01"), "placemark 1: a vertex is no position"),
        ("line.kml", "<kml", "not well-formed XML"),
        ("line.kml", "<!DOCTYPE kml [<!ENTITY a 'b'>]><kml/>", "has a document type"),
        ("line.kml", "<railML/>", "its root is railML: expected kml or gpx"),
        ("line.kmz", "no zip", "cannot be unpacked"),
        (
            "line.gpx",
            "<gpx><trk><trkseg><trkpt lat='x' lon='1'/></trkseg></trk></gpx>",
            "track 1: a vertex is no position",
        ),
        ("line.shp", "none", "not readable as a shapefile"),
    ],
)
def test_lines_of_other_systems_that_are_broken(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(BadInputError, match=message):
        read_known_line(tmp_path / name)


def test_a_shapefile_without_its_reference_system_needs_one(tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    path, line = tmp_path / "line.shp", [[500_000.0, 6_700_000.0], [500_100.0, 6_700_000.0]]
    blob = struct.pack("<BII", 1, 2, 2) + np.array(line, "<f8").tobytes()
    pyogrio.raw.write(
        path,
        np.array([blob], dtype=object),
        [],
        [],
        geometry_type="LineString",
        crs="EPSG:3067",
        driver="ESRI Shapefile",
    )
    stated = read_known_line(path)
    (tmp_path / "line.prj").unlink()
    with pytest.raises(BadInputError, match=r"has no .prj.*--line-crs"):
        read_known_line(path)
    np.testing.assert_allclose(read_known_line(path, "EPSG:3067").vertices[0], stated.vertices[0], atol=1e-9)


def test_a_file_of_absurd_size_is_not_digested(tmp_path: Path) -> None:
    with (tmp_path / "line.gpkg").open("wb") as file:
        file.truncate(50 * 2**30)
    with pytest.raises(BadInputError, match=r"line\.gpkg: is larger than 4 GiB; expected the tracks of a line"):
        line_sha256(tmp_path / "line.gpkg")
