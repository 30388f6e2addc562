"""Files of known lines, balises, runs and templates that are none: one message, and no wait."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from trackfg.errors import BadInputError
from trackfg.fleet.catalogue import read_catalogue
from trackfg.interchange.exporting.channels import read_template
from trackfg.interchange.importing.registry import source_format
from trackfg.io.balises import read_places
from trackfg.io.features import read_features
from trackfg.io.reader import load


def _geojson(path: Path, coordinates: Any, **more: Any) -> Path:
    feature = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": coordinates}, "properties": {}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature], **more}))
    return path


@pytest.mark.parametrize(
    ("coordinates", "more", "message"),
    [
        ([[10**400, 1], [2, 3]], {}, "a vertex is no position"),
        ([["1e999x", 1], [2, 3]], {}, "a vertex is no position"),
        ([[1, 2], [3, 4]], {"crs": []}, "crs has no name"),
    ],
)
def test_geojson_that_is_none(coordinates: Any, more: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=message):
        read_features(_geojson(tmp_path / "line.geojson", coordinates, **more))


@pytest.mark.parametrize(
    ("column", "shape", "message"),
    [("other", b"", "has no column"), ("geom", 3.5, "begin with GP"), ("geom", "GP", "GP")],
)
def test_a_geopackage_that_is_none(column: str, shape: object, message: str, tmp_path: Path) -> None:
    path = tmp_path / "line.gpkg"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE gpkg_spatial_ref_sys (srs_id, organization_coordsys_id)")
        database.execute("CREATE TABLE gpkg_geometry_columns (table_name, column_name, srs_id)")
        database.execute("CREATE TABLE track (id, geom)")
        database.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (4326, 4326)")
        database.execute("INSERT INTO gpkg_geometry_columns VALUES ('track', ?, 4326)", (column,))
        database.execute("INSERT INTO track VALUES (1, ?)", (shape,))
        database.commit()
    with pytest.raises(BadInputError, match=message):
        read_features(path)


@pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("runs.csv", lambda path: read_catalogue([str(path)])),
        ("runs.parquet", lambda path: read_catalogue([str(path)])),
        ("places.csv", read_places),
        ("line.geojson", read_features),
        ("line.gpkg", read_features),
        ("channels.toml", read_template),
        *((f"log.{suffix}", source_format) for suffix in ("csv", "zip", "mf4", "tdms", "h5", "ubx", "vbo", "xlsx")),
    ],
)
def test_pipes_and_loops_are_not_waited_for(name: str, read: Callable[[Path], Any], tmp_path: Path) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(BadInputError):
        read(path)
    path.unlink()
    path.symlink_to(path.name)
    with pytest.raises(BadInputError):
        read(path)


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
def test_a_pipe_in_a_bag_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    os.mkfifo(tmp_path / "bag.db3")
    with pytest.raises(BadInputError, match="expected the files of a ROS bag"):
        source_format(tmp_path).tables(tmp_path, lambda _: None)


def test_a_template_that_is_no_list(tmp_path: Path) -> None:
    path = tmp_path / "channels.toml"
    path.write_text("channel = 1.5\n")
    with pytest.raises(BadInputError, match=r"no \[\[channel\]\]"):
        read_template(path)


def test_what_cannot_be_read_is_not_digested(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "recording.toml").open("wb") as file:
        file.truncate(50 * 2**30)
    monkeypatch.setattr("trackfg.io.reader.files_sha256", lambda *_: pytest.fail("reads all of it"))
    assert "larger than 1 MiB" in load(tmp_path).findings[0].message
