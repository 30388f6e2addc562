"""`trackfg smooth --line` with files of each kind, on a run along a straight line that is known in closed form."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from trackfg.cli.main import app
from trackfg.cli.smoothing.line_file import read_line
from trackfg.datasets.line.line_file import read_line_file
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import BadInputError
from trackfg.io.description_reader import validated
from trackfg.io.reader import read_recording, write_recording
from trackfg.numerics.geodesy import enu_to_geodetic
from trackfg.recording.track_joints import Relation
from trackfg.results.result import Result

ORIGIN = (35.2, 139.0, 0.0)
"""Of the simulated positions; runs begin at it and go east."""
LINE = """
format = "trackfg-line/1"
id = "straight"
heading_deg = 90.0
speed_limit = [{ chainage_m = 0.0, kmh = 72 }]
element = [{ type = "straight", length_m = 3000.0 }]
"""
LANDXML = """<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">
<Units><Metric linearUnit="meter" areaUnit="squareMeter" volumeUnit="cubicMeter" temperatureUnit="celsius"
 pressureUnit="milliBars"/></Units>{system}
<Alignments><Alignment name="south" length="{length}" staStart="0"><CoordGeom><Line length="{length}">
<Start>{start}</Start><End>{end}</End></Line></CoordGeom></Alignment></Alignments></LandXML>"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("known-line")
    (folder / "straight.toml").write_text(LINE)
    plan = scenario("mainline-gnss").on(read_line_file(folder / "straight.toml"))
    simulate(plan, seed=2, duration_s=60.0).write(folder / "run")
    return folder / "run"


def geodetic(north_m: float) -> np.ndarray:
    """Return longitude and latitude of both ends of a track 4 km long."""
    ends = enu_to_geodetic(np.array([[-200.0, north_m, 0.0], [3800.0, north_m, 0.0]]), ORIGIN)
    return ends[:, [1, 0]]


def geojson(path: Path) -> Path:
    features = [
        {
            "type": "Feature",
            "properties": {"id": track},
            "geometry": {"type": "LineString", "coordinates": geodetic(north_m).tolist()},
        }
        for track, north_m in (("south", 0.0), ("north", 4.5))
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def smoothed(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["smooth", *map(str, arguments)])
    return done.exit_code, done.output if done.exception is None else f"{done.output}{done.exception}"


def test_geojson_and_what_is_written(recording: Path, tmp_path: Path) -> None:
    status, output = smoothed(recording, "-o", tmp_path / "out", "--line", geojson(tmp_path / "net.geojson"))
    assert status == 0, output
    result = Result.read(tmp_path / "out")
    assert result.summary.line is not None
    (stretch,) = result.summary.line.stretches
    assert (stretch.status, stretch.track) == ("on", "south")
    assert stretch.probability > 0.95
    assert stretch.across_m is not None
    assert abs(stretch.across_m) < 1.0
    event = result.events[result.events["kind"] == "on track"].iloc[0]
    assert event["detail"].startswith("south")


def test_landxml_in_its_own_reference_system_and_in_the_local_one(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:6677", always_xy=True)
    ends = [to_plane.transform(*end) for end in geodetic(0.0)]
    start, end = (f"{north} {east}" for east, north in ends)
    length = float(np.hypot(*np.subtract(ends[1], ends[0])))
    path = tmp_path / "line.xml"
    system = '<CoordinateSystem epsgCode="6677"/>'
    path.write_text(LANDXML.format(system=system, start=start, end=end, length=length))
    line = read_line(path, None, None)
    assert line.ids == ("south",)
    np.testing.assert_allclose(line.vertices[0][[0, -1]][:, ::-1], geodetic(0.0), atol=1e-8)
    assert not line.is_local
    path.write_text(LANDXML.format(system="", start="0 -200", end="0 3800", length=4000))
    with pytest.raises(BadInputError, match="--line-crs"):
        read_line(path, None, None)
    local = read_line(path, "local", "south")
    assert local.is_local
    np.testing.assert_allclose(local.vertices[0][[0, -1]], [[-200.0, 0.0], [3800.0, 0.0]], atol=1e-9)


def test_what_cannot_be_used_is_one_message(recording: Path, tmp_path: Path) -> None:
    network = geojson(tmp_path / "net.geojson")
    out = ("-o", tmp_path / "out")
    for arguments, message in (
        (("--path", "south"), "--path is of a known line"),
        (("--line", network, "--path", "west"), "no track 'west'"),
        (("--line", network, "--alignment", "x"), "--alignment chooses one of a LandXML file"),
        (("--line", tmp_path / "none.geojson"), "cannot be read"),
    ):
        status, output = smoothed(recording, *out, *arguments)
        assert status != 0
        assert message in output
        assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def with_line(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same recording with the two tracks as a part of it."""
    folder = tmp_path_factory.mktemp("with-line") / "run"
    shutil.copytree(recording, folder)
    geojson(folder / "net.geojson")
    with (folder / "recording.toml").open("a") as toml:
        toml.write('\n[known_line]\nfile = "net.geojson"\npath = ["north", "south"]\n')
    return folder


def test_a_recording_s_own_line_is_used_as_one_that_is_given(recording: Path, with_line: Path, tmp_path: Path) -> None:
    assert smoothed(with_line, "-o", tmp_path / "own")[0] == 0
    assert smoothed(recording, "-o", tmp_path / "given", "--line", with_line / "net.geojson")[0] == 0
    own, given = Result.read(tmp_path / "own"), Result.read(tmp_path / "given")
    assert own.summary.line is not None
    assert given.summary.line is not None
    assert own.summary.line.stretches == given.summary.line.stretches
    pd.testing.assert_frame_equal(own.trajectory, given.trajectory)
    assert own.summary.line.content_sha256 is None
    assert given.summary.line.content_sha256 == hashlib.sha256((with_line / "net.geojson").read_bytes()).hexdigest()


def test_a_recording_with_a_line_is_written_and_read_back(with_line: Path, tmp_path: Path) -> None:
    line = read_recording(with_line).known_line
    assert line is not None
    relation = Relation("south", 0.25, "north", 0.75, forth=True, back=False)
    for relations in (None, (), (relation,)):
        given = replace(read_recording(with_line), known_line=replace(line, relations=relations))
        again = read_recording(write_recording(given, tmp_path / "copy")).known_line
        assert again is not None
        assert (again.ids, again.relations, again.is_local) == (line.ids, relations, False)
        for vertices, before in zip(again.vertices, line.vertices, strict=True):
            np.testing.assert_array_equal(vertices, before)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ('file = "none.geojson"', "no such file"),
        ('file = "../net.geojson"', "leads out of the recording"),
        ('file = "net.geojson"\npath = ["west"]', "no track 'west'"),
        ('file = "line.xml"', "trackfg smooth --line reads LandXML"),
        ('file = "net.geojson"\ntracks = ["west"]', "unknown key"),
        ('file = "net.geojson"\ncrs = "EPSG:1"', "unknown reference system"),
    ],
)
def test_check_says_what_is_wrong_with_a_recording_s_line(
    with_line: Path, tmp_path: Path, section: str, message: str
) -> None:
    shutil.copytree(with_line, tmp_path / "run")
    (tmp_path / "run" / "line.xml").write_text("<LandXML/>")
    toml = tmp_path / "run" / "recording.toml"
    toml.write_text(toml.read_text().partition("[known_line]")[0] + f"[known_line]\n{section}\n")
    done = CliRunner().invoke(app, ["check", str(tmp_path / "run"), "--json"])
    assert done.exit_code == 2
    assert message in done.output
    with pytest.raises(BadInputError, match=message):
        read_recording(tmp_path / "run")


def test_a_line_needs_positions() -> None:
    imu = {"file": "imu.csv", "gyro": ["a", "b", "c"], "accel": ["d", "e", "f"]}
    data = {"format": "trackfg-recording/1", "id": "x", "imu": imu, "known_line": {"file": "net.geojson"}}
    (finding,) = validated(data, "recording.toml").findings
    assert "without [gnss]" in str(finding)
