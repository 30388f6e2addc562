"""Every export is read back by a library of its own, and holds the result's values, places and sigmas."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from lxml import etree

from trackfg.datasets.line.landxml import read_landxml
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import BadInputError, OutputError
from trackfg.interchange.exporting.channels import read_template
from trackfg.interchange.exporting.export import export_result
from trackfg.interchange.exporting.formats.rcm_dx import _forward
from trackfg.interchange.exporting.located_tables import GEODETIC_COLUMNS, PLACE_COLUMNS, located_geometry, table_of
from trackfg.interchange.exporting.registry import result_format, result_formats
from trackfg.interchange.exporting.result_format import ExportOptions
from trackfg.mapping import build_map
from trackfg.maps import write_map
from trackfg.numerics.chainage.km_notation import written_places
from trackfg.numerics.geodesy import geodetic_to_enu
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.columns import GEOMETRY_COLUMNS
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

START = datetime(2026, 5, 1, 3, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def result() -> Result:
    """A run with curves on a rigid vehicle, with GNSS and a date."""
    gnss = scenario("mainline-gnss").gnss
    plan = replace(scenario("axle-box"), gnss=gnss, chainage_origin_m=12_000.0)
    recording = simulate(plan, seed=1, duration_s=150.0).recording
    description = recording.description.model_copy(update={"start": START})
    return smooth(replace(recording, description=description, gnss_origin=np.array([46.9, 7.4, 500.0])))


@pytest.fixture
def without_place(result: Result) -> Result:
    facts = result.summary.run.model_copy(update={"origin": None, "start": None})
    return replace(result, summary=result.summary.model_copy(update={"run": facts}))


@pytest.fixture(scope="module")
def on_a_line(result: Result) -> Result:
    """The same on a line whose kilometrage descends, and jumps by 300 m inside the run."""
    places = [{"chainage_m": 12_000.0, "km": "85+000"}, {"chainage_m": JUMP_M, "km": "84+600"}]
    line = LineKilometrage.model_validate(
        {"line": "4201", "track": "2", "direction": "descending", "equation": places, "end_chainage_m": 13_000.0}
    )
    facts = result.summary.run.model_copy(update={"kilometrage": line})
    return replace(result, summary=result.summary.model_copy(update={"run": facts}))


JUMP_M = 12_100.0


def official(chainage):
    """The kilometrage of :func:`on_a_line`, m."""
    return np.where(chainage < JUMP_M, 85_000.0 - (chainage - 12_000.0), 84_600.0 - (chainage - JUMP_M))


def _exported(result: Result, name: str, folder: Path, **options: object) -> Path:
    form = result_format(name)
    return export_result(result, form, folder / f"out{form.suffix}", ExportOptions(**options))


@pytest.fixture(scope="module")
def spreadsheet(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _exported(result, "xlsx", tmp_path_factory.mktemp("xlsx"))


def test_places_are_those_of_the_trajectory(result):
    located = located_geometry(result)

    assert tuple(located.columns) == ("chainage_m", *PLACE_COLUMNS, *GEODETIC_COLUMNS, *GEOMETRY_COLUMNS[1:])
    row = located.iloc[len(located) // 2]
    near = result.trajectory.iloc[(result.trajectory["t_s"] - row["t_s"]).abs().argmin()]
    assert abs(near["chainage_m"] - row["chainage_m"]) <= 0.06 * abs(near["speed_mps"]) + 0.01
    back = geodetic_to_enu(located[list(GEODETIC_COLUMNS)].to_numpy(), np.array(result.summary.run.origin))
    np.testing.assert_allclose(back, located[list(PLACE_COLUMNS[1:])], atol=1e-6, equal_nan=True)


@pytest.mark.parametrize("table", ["geometry", "trajectory", "events"])
def test_csv_holds_every_digit(result, tmp_path, table):
    read = pd.read_csv(_exported(result, "csv", tmp_path, table=table))

    original = getattr(result, table)
    for column in original.columns:
        if original[column].dtype.kind == "f":
            np.testing.assert_array_equal(read[column].to_numpy(dtype=float), original[column].to_numpy())


def test_a_spreadsheet_has_a_sheet_for_each_table(result, spreadsheet):
    sheets = pd.read_excel(spreadsheet, sheet_name=None)

    assert list(sheets) == ["geometry", "trajectory", "events"]
    assert len(sheets["geometry"]) == len(result.geometry)
    np.testing.assert_allclose(sheets["geometry"]["cross_level_mm_sd"], result.geometry["cross_level_mm_sd"])


def test_times_have_dates_where_the_start_is_known(result, without_place, spreadsheet, tmp_path):
    trajectory = pd.read_csv(_exported(result, "csv", tmp_path, table="trajectory"), parse_dates=["time_utc"])
    events = pd.read_excel(spreadsheet, sheet_name="events")
    features = json.loads(_exported(result, "geojson", tmp_path).read_text())["features"]

    since = (trajectory["time_utc"] - pd.Timestamp(START).tz_localize(None)).dt.total_seconds()
    np.testing.assert_allclose(since, trajectory["t_s"], atol=1e-6)
    assert list(events.columns[:5]) == ["kind", "start_s", "start_utc", "end_s", "end_utc"]
    assert events["start_utc"].iloc[0] == pd.Timestamp(START).tz_localize(None) + pd.Timedelta(
        events["start_s"].iloc[0], "s"
    )
    assert features[0]["properties"]["start_utc"] == "2026-05-01T03:12:00Z"
    assert features[1]["properties"]["start_utc"].startswith("2026-05-01T03:")
    assert "time_utc" not in table_of(without_place, "trajectory")


def test_a_spreadsheet_keeps_its_names_in_sight_and_says_what_no_column_does(result, spreadsheet):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.load_workbook(spreadsheet)

    assert {sheet.freeze_panes for sheet in book} == {"B2"}
    assert book.properties.title == result.summary.recording_id
    about = "t_s counts from 2026-05-01 03:12:00+00:00; east_m, north_m, up_m count from 46.900000000, 7.400000000"
    assert book.properties.description.startswith(about)
    assert book.properties.description.endswith("x_sd is the standard deviation of x, in its unit.")


def test_layers_have_dates_as_geographic_systems_know_them(result, tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    path = _exported(result, "gpkg", tmp_path)

    for layer, column in (("geometry", "time_utc"), ("path", "start_utc"), ("events", "start_utc")):
        info = pyogrio.read_info(path, layer=layer)
        types = dict(zip(info["fields"], info["dtypes"], strict=True))
        assert types[column].startswith("datetime64")
    with closing(sqlite3.connect(path)) as layers:
        ((date,),) = layers.execute("SELECT start_utc FROM path").fetchall()
    assert date.endswith("Z")
    assert pd.Timestamp(date) == START


def test_the_layer_of_events_has_numbers_also_where_none_is_known(result, tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    quiet = replace(result, events=result.events.assign(distance_removed_m=np.nan))
    info = pyogrio.read_info(_exported(quiet, "gpkg", tmp_path), layer="events")

    types = dict(zip(info["fields"], info["dtypes"], strict=True))
    assert types["distance_removed_m"] == "float64"


def test_at_rest_a_vehicle_faces_as_when_it_last_moved():
    speed = np.array([-1e-4, 2e-4, 0.5, 1.0, -1e-4, 0.0, -0.5, 1e-4])

    assert _forward(speed, np.full(8, 1e-3)).tolist() == [True] * 6 + [False] * 2
    assert _forward(-speed, np.full(8, 1e-3)).tolist() == [False] * 6 + [True] * 2
    assert _forward(1e-3 * speed, np.full(8, 1e-3)).all()


def test_landxml_says_when_and_in_what_frame_it_is(result, without_place, tmp_path):
    root = etree.parse(_exported(result, "landxml", tmp_path)).getroot()
    system = root.find("{*}CoordinateSystem")

    assert (root.get("date"), root.get("time")) == ("2026-05-01", "03:12:00")
    assert "latitude 46.900000000, longitude 7.400000000 (WGS 84)" in system.get("desc")
    root = etree.parse(_exported(without_place, "landxml", tmp_path)).getroot()
    assert root.find("{*}CoordinateSystem") is None


def test_channels_have_their_place_units_and_sigmas(result, tmp_path):
    read = pd.read_csv(_exported(result, "channels", tmp_path))

    assert list(read.columns) == [channel.name for channel in read_template(None)]
    assert len(read) == len(result.geometry)
    km, metres = read["Location [km+m]"].str.split("+", expand=True).astype(float).to_numpy().T
    np.testing.assert_allclose(1000 * km + metres, result.geometry["chainage_m"], atol=0.005)
    np.testing.assert_allclose(read["Speed [km/h]"], 3.6 * result.geometry["speed_mps"], atol=0.006)
    np.testing.assert_allclose(read["Twist sigma [mm]"], result.geometry["twist_mm_sd"], atol=6e-4)
    np.testing.assert_allclose(read["Curvature [10000/m]"], 1e4 * result.geometry["curvature_1pm"], atol=6e-5)
    assert read["Gauge [mm]"].isna().all()


def test_a_template_names_its_own_channels(result, tmp_path):
    template = tmp_path / "t.toml"
    keys = 'name = "G"\ncolumn = "cross_level_mm"\nfactor = 0.1\noffset = 10.0\ndecimals = 6\n'
    template.write_text(f'[[channel]]\nname = "N"\ncolumn = "running"\n\n[[channel]]\n{keys}')

    read = pd.read_csv(_exported(result, "channels", tmp_path, channels=read_template(template)))

    assert read["N"].tolist() == list(range(1, len(result.geometry) + 1))
    np.testing.assert_allclose(read["G"], 0.1 * (result.geometry["cross_level_mm"] - 10.0), atol=6e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = [", "not valid TOML"),
        ("", "no \\[\\[channel\\]\\]"),
        ('[[channel]]\nname = "a"', "column: is missing"),
    ],
)
def test_a_template_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "t.toml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message):
        read_template(path)


@pytest.mark.parametrize(
    ("chainage", "text"),
    [(12_345.25, "12+0345.25"), (0.0, "0+0000.00"), (-50.0, "-0+0050.00"), (999.996, "1+0000.00")],
)
def test_kilometrage_is_written_as_offices_do(chainage, text):
    assert written_places(np.array([chainage]), digits=4) == [text]


def test_geojson_has_the_path_and_the_events(result, tmp_path):
    collection = json.loads(_exported(result, "geojson", tmp_path, step_m=5.0).read_text())

    line, *events = collection["features"]
    places = np.array(line["geometry"]["coordinates"])
    travelled = np.abs(np.diff(result.trajectory["chainage_m"])).sum()
    assert len(places) == pytest.approx(travelled / 5.0, rel=0.2)
    _inside(places, result)
    assert len(events) == len(result.events)
    assert events[0]["properties"]["kind"] == result.events["kind"][0]


def test_gpx_has_times_heights_and_places(result, tmp_path):
    root = etree.parse(str(_exported(result, "gpx", tmp_path))).getroot()

    points = root.findall(".//{*}trkpt")
    places = np.array([[float(p.get("lon")), float(p.get("lat")), float(p.find("{*}ele").text)] for p in points])
    _inside(places, result)
    first = pd.Timestamp(points[0].find("{*}time").text)
    assert first == pd.Timestamp(START) + pd.to_timedelta(result.trajectory["t_s"].iloc[0], unit="s")


def test_geopackage_is_read_by_gdal(result, tmp_path):
    import pyogrio

    path = _exported(result, "gpkg", tmp_path)

    assert {name for name, _ in pyogrio.list_layers(path)} == {"geometry", "path", "events"}
    meta, _, shapes, values = pyogrio.raw.read(path, layer="geometry")
    assert meta["crs"] == "EPSG:4326"
    assert meta["geometry_type"] == "Point Z"
    columns = dict(zip(meta["fields"], values, strict=True))
    placed = located_geometry(result).dropna(subset=["latitude_deg"])
    np.testing.assert_array_equal(columns["twist_mm_sd"], placed["twist_mm_sd"])
    _inside(np.array([np.frombuffer(shape, dtype="<f8", count=3, offset=5) for shape in shapes]), result)


def test_geoparquet_says_what_its_geometry_is(result, tmp_path):
    table = pq.read_table(_exported(result, "geoparquet", tmp_path))

    geo = json.loads(table.schema.metadata[b"geo"])
    assert geo["columns"]["geometry"]["encoding"] == "WKB"
    shapes = table["geometry"].to_pylist()
    _inside(np.array([np.frombuffer(shape, dtype="<f8", count=3, offset=5) for shape in shapes]), result)
    placed = located_geometry(result).dropna(subset=["latitude_deg"])
    np.testing.assert_array_equal(table["level_mm_sd"].to_numpy(), placed["level_mm_sd"])


def _inside(places: np.ndarray, result: Result) -> None:
    """Longitude, latitude and height lie where the trajectory went."""
    origin = np.array(result.summary.run.origin)
    enu = geodetic_to_enu(places[:, [1, 0, 2]], origin)
    for axis, name in enumerate(("east_m", "north_m", "up_m")):
        assert enu[:, axis].min() == pytest.approx(result.trajectory[name].min(), abs=2.0)
        assert enu[:, axis].max() == pytest.approx(result.trajectory[name].max(), abs=2.0)


def test_landxml_needs_places_of_the_geometry(result, tmp_path):
    far = result.trajectory[:2].assign(chainage_m=[-9e3, -8.9e3])
    with pytest.raises(BadInputError, match="have no two places in common; expected them for landxml"):
        _exported(replace(result, trajectory=far), "landxml", tmp_path)
    assert not list(tmp_path.iterdir())


def test_landxml_comes_back_by_our_own_reader_without_a_remark_on_the_plan(result, tmp_path):
    path = _exported(result, "landxml", tmp_path)

    read = read_landxml(path, speed_limit_mps=20.0)

    assert read.remarks == ("there is no profile (ProfAlign): the line is level, at height 0",)
    geometry = result.geometry
    assert read.station_start_m == pytest.approx(geometry["chainage_m"].iloc[0], abs=0.3)
    inside = (geometry["chainage_m"] > geometry["chainage_m"].iloc[0] + 20) & geometry["curvature_1pm"].notna()
    at = geometry["chainage_m"][inside].to_numpy() - read.station_start_m
    at = at[at < read.line.length_m - 20.0]
    curvature = geometry["curvature_1pm"][inside].to_numpy()[: len(at)]
    assert np.sqrt(np.mean((read.line.curvature(at) - curvature) ** 2)) < 0.1 * np.sqrt(np.mean(curvature**2)) + 1e-5
    assert read.gauge_m == pytest.approx(result.summary.geometry.gauge_m)


RCM_DX = {
    "RCMDX": ("Element", "Major", "Minor", "Feature"),
    "RCMDX/FILE": ("Element", "StructureVersion"),
    "RCMDX/TRACKFG": ("Element", "VehicleNumber"),
    "RCMDX/TRACKFG/20260501_031200.000": ("Element", "StartTime"),
    "RCMDX/TRACKFG/20260501_031200.000/CONFIGURATION": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/SECTIONS": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/POSITION": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/POSITION/POSITION.SOURCE": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/TGMS": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/TGMS/GEOMETRY": ("Element",),
    "RCMDX/TRACKFG/20260501_031200.000/TGMS/GEOMETRY/TWIST": (
        "TriggerMode", "CommonTriggerDistance", "CommonTriggerFrequency", "ChannelBasis", "MeasurementType", "Neighbor",
        "PositionOffset", "Element",
    ),
    "RCMDX/TRACKFG/20260501_031200.000/EVENTS": ("Element",),
}  # fmt: skip
"""Groups and attributes that the specification of RCM-DX (2026-03-24) marks as not optional."""

RCM_DX_ARRAYS = {
    "SECTIONS": {
        "direction": "O", "startTimestamp": "u8", "endTimestamp": "u8", "firstTrackOffset": "f8",
        "lastTrackOffset": "f8", "trackInfoOffset": "f8", "trackId": "i4", "trackStartTimestamp": "u8",
        "trackEndTimestamp": "u8", "trackKilometrage": "O", "trackStartCoveredDistance": "f8",
        "trackEndCoveredDistance": "f8",
    },
    "POSITION/POSITION.SOURCE/POSITION.SOURCE.DATA": {
        "covereddistance": "f8", "direction": "O", "kilometrage": "O", "track_id": "i4", "line_id": "i4",
        "trackoffset": "f8", "lineoffset": "f8", "positionaccuracy": "f4", "positionquality": "i4",
    },
    "EVENTS": {
        "systemref": "O", "eventtype": "O", "data": "O", "duration": "i8", "timestamp": "u8",
    },
}  # fmt: skip
"""Arrays that it marks as not optional, with their types."""


def test_rcm_dx_conforms_to_the_specification_s_tables(result, tmp_path):
    import h5py

    with h5py.File(_exported(result, "rcm-dx", tmp_path)) as file:
        for name, attributes in RCM_DX.items():
            assert set(attributes) <= set(file[name].attrs), name
        session = file["RCMDX/TRACKFG/20260501_031200.000"]
        for name, arrays in RCM_DX_ARRAYS.items():
            for array, kind in arrays.items():
                assert session[name][array].dtype == np.dtype(kind), (name, array)
            assert len({len(session[name][array]) for array in arrays}) == 1
        for source in ("POSITION/POSITION.SOURCE", "TGMS/GEOMETRY"):
            stamps = session[source]["timestamp"][()]
            assert stamps.dtype == np.uint64
            assert (np.diff(stamps.astype(np.int64)) >= 0).all()
            for channel in session[source].values():
                if isinstance(channel, h5py.Group) and "data" in channel:
                    assert len(channel["data"]) == len(stamps)
                    assert "Unit" in channel["data"].attrs
        written = session["TGMS/GEOMETRY/CROSS_LEVEL_SD/data"][()]
        assert session["TGMS/GEOMETRY/CROSS_LEVEL/data"].attrs["Unit"] == "mm"
    placed = located_geometry(result).dropna(subset=["t_s"]).sort_values("t_s")
    np.testing.assert_array_equal(written, placed["cross_level_mm_sd"])


def test_rcm_dx_is_read_by_our_own_importer(result, tmp_path):
    from trackfg.interchange.importing.registry import source_format

    path = _exported(result, "rcm-dx", tmp_path)
    form = source_format(path)

    tables = {table.name: table for table in form.tables(path, lambda _: None)}

    assert form.key == "rcm-dx"
    assert len(tables["TGMS/GEOMETRY"].frame) == len(located_geometry(result).dropna(subset=["t_s"]))
    assert tables["TGMS/GEOMETRY"].units["twist"] == "mm"


def test_tum_has_the_attitude(result, tmp_path):
    from scipy.spatial.transform import Rotation

    rows = np.loadtxt(_exported(result, "tum", tmp_path))

    np.testing.assert_allclose(rows[:, 1:4], result.trajectory[["east_m", "north_m", "up_m"]], atol=1e-8)
    angles = Rotation.from_quat(rows[:, 4:]).as_euler("xyz")
    np.testing.assert_allclose(angles, result.trajectory[["roll_rad", "pitch_rad", "yaw_rad"]], atol=1e-7)


def test_mcap_has_pose_place_and_sigmas(result, tmp_path):
    from mcap.reader import make_reader

    with _exported(result, "mcap", tmp_path).open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())

    by_topic = {topic: [m for _, c, m in messages if c.topic == topic] for topic in ("/pose", "/state", "/location")}
    assert {len(found) for found in by_topic.values()} == {len(result.trajectory)}
    state = json.loads(by_topic["/state"][5].data)
    assert state["chainage_m_sd"] == result.trajectory["chainage_m_sd"][5]
    assert by_topic["/pose"][0].log_time == pd.Timestamp(START).value + round(1e9 * result.trajectory["t_s"][0])


@pytest.mark.parametrize("name", ["geojson", "gpx", "gpkg", "geoparquet", "rcm-dx"])
def test_what_a_result_lacks_is_named_and_nothing_is_left(without_place, tmp_path, name):
    (tmp_path / f"out{result_format(name).suffix}").write_text("earlier")

    with pytest.raises(BadInputError, match=r"its recording has no (GNSS|date)"):
        _exported(without_place, name, tmp_path)

    assert [path.read_text() for path in tmp_path.iterdir()] == ["earlier"]


@pytest.mark.parametrize("name", ["csv", "xlsx", "channels", "landxml", "tum", "mcap"])
def test_other_formats_need_no_place(without_place, tmp_path, name):
    assert _exported(without_place, name, tmp_path).stat().st_size > 500


@pytest.mark.parametrize("name", ["csv", "channels", "landxml"])
def test_a_table_of_the_geometry_needs_one(result, tmp_path, name):
    """An empty file would look like one of a run without faults."""
    without = replace(result, geometry=result.geometry.iloc[:0])
    with pytest.raises(BadInputError, match=rf"no track geometry; expected it for {name}.* Hint: "):
        _exported(without, name, tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert len(pd.read_csv(_exported(without, "csv", tmp_path, table="trajectory"))) == len(result.trajectory)


def test_a_file_that_cannot_be_written_is_named(result, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        _exported(result, "tum", tmp_path / "file")


def test_formats_are_found_by_name():
    assert set(result_formats()) >= {"csv", "gpkg", "rcm-dx", "mcap"}
    with pytest.raises(BadInputError, match="did you mean 'geojson'"):
        result_format("geojsn")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("tum", {"km": True}, r"--km: tum does not take it; expected it with one of csv, xlsx, channels, geojson"),
        ("gpkg", {"table": "events"}, r"--table: gpkg does not take it; expected it with one of csv"),
        ("csv", {"step_m": 5.0}, r"--step: csv does not take it; expected it with one of geojson, gpx, gpkg"),
        ("landxml", {"bands": True}, r"--bands: landxml does not take it; expected it with one of csv, xlsx, channels"),
        ("csv", {"channels": read_template(None)}, r"--template: csv does not take it; .* one of channels"),
        ("csv", {"table": "events", "bands": True}, r"--bands: events has none; expected --table geometry"),
    ],
)
def test_options_that_say_nothing_of_a_format_are_refused(
    name: str, options: dict[str, object], message: str, result: Result, tmp_path: Path
) -> None:
    with pytest.raises(BadInputError, match=message):
        _exported(result, name, tmp_path, **options)
    assert not list(tmp_path.iterdir())


def test_no_export_takes_the_name_of_another_one():
    tables = ("geometry", "trajectory", "events", "balises")
    names = [form.file_name("out1", ExportOptions()) for form in result_formats().values()]
    names += [result_format("csv").file_name("out1", ExportOptions(table=table)) for table in tables[1:]]

    assert len(set(names)) == len(names)
    assert {"out1.csv", "out1.channels.csv", "out1.trajectory.csv"} <= set(names)


def test_the_command_writes_beside_the_result(result, trackfg, tmp_path):
    result.write(tmp_path / "out1")

    done = trackfg("export", tmp_path / "out1", "--to", "tum")

    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(tmp_path / "out1.tum")
    assert (tmp_path / "out1.tum").exists()


@pytest.mark.parametrize("table", ["geometry", "trajectory", "events"])
def test_official_places_stand_beside_chainages_on_request(on_a_line, tmp_path, table):
    shown = pd.read_csv(_exported(on_a_line, "csv", tmp_path, table=table, km=True))
    plain = pd.read_csv(_exported(on_a_line, "csv", tmp_path, table=table))

    assert list(shown).index("km") == list(shown).index("chainage_m") + 1
    pd.testing.assert_frame_equal(shown.drop(columns="km"), plain)
    places = shown["km"].str.split("+", expand=True).astype(float)
    np.testing.assert_allclose(1000.0 * places[0] + places[1], official(shown["chainage_m"]), atol=0.00501)


def test_official_places_go_into_every_format_that_has_them(on_a_line, tmp_path):
    import h5py
    import pyogrio

    channels = pd.read_csv(_exported(on_a_line, "channels", tmp_path, km=True))
    assert channels["Location [km+m]"].iloc[0].startswith("84+9")
    points = pq.read_table(_exported(on_a_line, "geoparquet", tmp_path, km=True)).to_pandas()
    assert points["km"].str.startswith("84+5").any()
    layer = pyogrio.read_arrow(_exported(on_a_line, "gpkg", tmp_path, km=True), layer="path")[1].to_pandas()
    assert layer[["line", "track"]].to_numpy().tolist() == [["4201", "2"]]
    with h5py.File(_exported(on_a_line, "rcm-dx", tmp_path, km=True)) as file:
        (session,) = (group for name, group in file["RCMDX/TRACKFG"].items() if name != "CONFIGURATION")
        data = session["POSITION/POSITION.SOURCE/POSITION.SOURCE.DATA"]
        chainage = on_a_line.trajectory["chainage_m"].to_numpy()
        np.testing.assert_allclose(1000.0 * data["lineoffset"][()], official(chainage), atol=1e-6)
        assert (data["line_id"][0], data["track_id"][0]) == (4201, 2)
        assert data["kilometrage"][-1] == b"DECREASING"


def test_station_equations_of_the_alignment_are_read_back(on_a_line, tmp_path):
    written = _exported(on_a_line, "landxml", tmp_path, km=True)
    read = read_landxml(written, speed_limit_mps=20.0).kilometrage.kilometrage()

    x = on_a_line.geometry["chainage_m"].to_numpy()
    np.testing.assert_allclose(read.official_m(x), official(x), atol=1e-3)


def test_a_result_that_knows_no_kilometrage_says_so(result, tmp_path):
    with pytest.raises(BadInputError, match=r"says nothing of the line's kilometrage: expected \[kilometrage\]. Hint"):
        _exported(result, "csv", tmp_path, km=True)


def test_commands_show_official_places_with_one_option(on_a_line, trackfg, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    on_a_line.write(tmp_path / "out1")
    write_map(build_map([on_a_line], name="line"), tmp_path / "line.gpkg", parent=None)
    limits = tmp_path / "limits.toml"
    limits.write_text(
        '[[limits]]\nparameter = "twist"\nkind = "peak"\nbase_m = 5.0\nlevel = "A"\nstandard = "S"\nvalue_mm = 1.0\n'
    )

    def run(*arguments):
        done = trackfg(*arguments)
        done.check_returncode()
        return done.stdout

    run("limits", "out1", "--limits", "limits.toml", "--km", "-o", "exceedances.csv")
    exceedances = pd.read_csv(tmp_path / "exceedances.csv")
    assert len(exceedances)
    places = exceedances["km"].str.split("+", expand=True).astype(float)
    np.testing.assert_allclose(1000.0 * places[0] + places[1], official(exceedances["chainage_m"]), atol=0.00501)
    run("report", "out1", "--km", "-o", "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Jumps of the kilometrage" in page
    for text in ("84+900.00", "84+600.00", "300.00 m are missing", "4201"):
        assert text in page
    landmarks = json.loads(run("map", "show", "line.gpkg", "--km", "--json"))["landmarks"]
    assert landmarks
    for row in landmarks:
        km, metres = row["km"].split("+")
        assert abs(1000.0 * float(km) + float(metres) - official(row["chainage_m"])) < 0.00501
    assert "km" in run("map", "show", "line.gpkg", "--km")
    changes = json.loads(run("map", "changes", "out1", "line.gpkg", "--km", "--json"))
    assert all("km" in row for row in changes["changes"])


def test_official_places_are_shown_where_they_are_known(on_a_line, result, trackfg, tmp_path):
    on_a_line.write(tmp_path / "out1")
    result.write(tmp_path / "out2")
    limits = tmp_path / "limits.toml"
    limits.write_text(
        '[[limits]]\nparameter = "twist"\nkind = "peak"\nbase_m = 5.0\nlevel = "A"\nstandard = "S"\nvalue_mm = 1.0\n'
    )

    def listed(name, *options):
        done = trackfg("limits", tmp_path / name, "--limits", limits, "--json", *options)
        return done.returncode, json.loads(done.stdout)["exceedances"] if done.stdout else []

    for name, options, status, known in (
        ("out1", (), 0, True), ("out1", ("--no-km",), 0, False), ("out2", (), 0, False), ("out2", ("--km",), 2, False),
    ):  # fmt: skip
        found, rows = listed(name, *options)
        assert found == status
        assert ("km" in rows[0] if rows else False) == known, (name, options)
