"""`trackfg smooth --line` with files of each kind, on a run along a straight line that is known in closed form."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from trackfg.cli.main import app
from trackfg.cli.smoothing.line_file import read_line
from trackfg.datasets.line.line_file import read_line_file
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import BadInputError
from trackfg.numerics.geodesy import enu_to_geodetic
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
