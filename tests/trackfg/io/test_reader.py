"""Reading turns everything into SI, body axes and one clock; writing and reading again changes no bit."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trackfg.errors import BadInputError
from trackfg.io.check import check_recording
from trackfg.io.reader import load, read_recording, write_recording
from trackfg.io.table_file import open_table
from trackfg.io.truth import read_truth, read_truth_geometry
from trackfg.io.writer import canonical_form
from trackfg.numerics import rotations
from trackfg.recording.description import Fixes, Gnss, Imu, Laser, RecordingDescription, Tach
from trackfg.recording.model import FIX_COLUMNS, GNSS_COLUMNS, IMU_COLUMNS, LASER_COLUMNS, TACH_COLUMNS, Recording

Draft = Any
RIGHT_HANDED = [
    axes
    for pairs in itertools.permutations(("FB", "LR", "UD"))
    for letters in itertools.product(*pairs)
    if np.linalg.det(rotations.axes_matrix(axes := "".join(letters))) > 0
]
TABLES = ("imu", "tach", "fixes", "gnss")


def assert_same(a: Recording, b: Recording) -> None:
    """Every table equal in every bit."""
    for name in TABLES:
        one, two = getattr(a, name), getattr(b, name)
        assert (one is None) == (two is None)
        if one is not None:
            pd.testing.assert_frame_equal(one, two, check_exact=True)
    assert a.lasers.keys() == b.lasers.keys()
    for name, table in a.lasers.items():
        pd.testing.assert_frame_equal(table, b.lasers[name], check_exact=True)
    assert (a.gnss_origin is None) == (b.gnss_origin is None)
    if a.gnss_origin is not None:
        np.testing.assert_array_equal(a.gnss_origin, b.gnss_origin)


def test_the_example_becomes_canonical_tables(draft: Draft, tmp_path: Path) -> None:
    folder = draft.write(tmp_path / "rec")
    recording = read_recording(folder)
    assert tuple(recording.imu.columns) == IMU_COLUMNS
    np.testing.assert_array_equal(recording.imu.to_numpy(), draft["imu"].to_numpy())
    assert recording.tach is not None
    assert tuple(recording.tach.columns) == TACH_COLUMNS
    np.testing.assert_allclose(recording.tach["distance_m"], draft["tach"]["count"] * np.pi * 0.86 / 90, rtol=1e-14)
    assert recording.fixes is not None
    np.testing.assert_array_equal(recording.fixes.to_numpy(), draft["fixes"].to_numpy())
    assert recording.gnss is not None
    assert tuple(recording.gnss.columns) == GNSS_COLUMNS
    np.testing.assert_allclose(recording.gnss.iloc[0, 1:4], 0.0, atol=1e-8)
    np.testing.assert_array_equal(recording.gnss_origin, [35.2, 139.0, 50.0])
    laser = recording.lasers["A-left-vertical"]
    assert tuple(laser.columns) == LASER_COLUMNS
    np.testing.assert_allclose(laser["displacement_m"], draft["laser"]["a_lv"] * 1e-3, rtol=1e-15)
    assert recording.folder == folder


def test_what_reading_noticed_goes_with_the_recording(draft: Draft, tmp_path: Path) -> None:
    assert read_recording(draft.write(tmp_path / "sound")).findings == ()
    draft.tables["imu.csv"] = draft["imu"].drop(index=range(2000, 2100))
    folder = draft.write(tmp_path / "gap")
    (found,) = read_recording(folder).findings
    assert (found.level, found.code, found.file) == ("warning", "gap", "imu.csv")
    assert load(folder).findings == (found,)


def test_the_description_file_may_be_named_instead_of_the_folder(draft: Draft, tmp_path: Path) -> None:
    folder = draft.write(tmp_path / "rec")
    (folder / "recording.toml").rename(folder / "second.toml")
    assert_same(read_recording(folder / "second.toml"), read_recording(str(folder / "second.toml")))
    with pytest.raises(BadInputError, match=r"recording\.toml"):
        read_recording(folder)


@pytest.mark.parametrize("axes", RIGHT_HANDED)
def test_any_orientation_of_the_sensor_gives_the_same_recording(axes: str, draft: Draft, tmp_path: Path) -> None:
    upright = draft["imu"].copy()
    body = {"F": (0, 1), "B": (0, -1), "L": (1, 1), "R": (1, -1), "U": (2, 1), "D": (2, -1)}
    for columns in (["wx", "wy", "wz"], ["fx", "fy", "fz"]):
        for column, letter in zip(columns, axes, strict=True):
            index, sign = body[letter]
            draft["imu"][column] = sign * upright[columns[index]]
    draft.toml["imu"]["axes"] = axes
    recording = read_recording(draft.write(tmp_path / "rec"))
    np.testing.assert_array_equal(recording.imu.to_numpy(), upright.to_numpy())


@given(
    roll=st.floats(-9, 9), pitch=st.floats(-9, 9), yaw=st.floats(-180, 180), axes=st.sampled_from(RIGHT_HANDED)
)  # fmt: skip
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_residual_rotation_is_from_sensor_to_vehicle(
    roll: float, pitch: float, yaw: float, axes: str, example_tables: dict[str, pd.DataFrame], tmp_path: Path
) -> None:
    draft = example_tables["imu"].iloc[:500]
    gyro, accel = draft[["wx", "wy", "wz"]].to_numpy(), draft[["fx", "fy", "fz"]].to_numpy()
    R = rotations.matrix_from_rpy(*np.radians([[roll], [pitch], [yaw]]))[0] @ rotations.axes_matrix(axes)
    table = pd.DataFrame(np.column_stack([draft["t"], gyro @ R, accel @ R]), columns=draft.columns)
    table.to_parquet(tmp_path / "imu.parquet")
    (tmp_path / "recording.toml").write_text(
        'format = "trackfg-recording/1"\nid = "x"\n[imu]\nfile = "imu.parquet"\ngyro = ["wx", "wy", "wz"]\n'
        f'accel = ["fx", "fy", "fz"]\naxes = "{axes}"\nmount_rpy_deg = [{roll!r}, {pitch!r}, {yaw!r}]\n'
    )
    recording = read_recording(tmp_path)
    np.testing.assert_allclose(recording.gyro, gyro, atol=1e-14)
    np.testing.assert_allclose(recording.accel, accel, atol=1e-13)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_time_units_and_offsets(unit: str, factor: float, draft: Draft, tmp_path: Path) -> None:
    draft["tach"]["t"] = np.rint(draft["tach"]["t"] * factor).astype("int64")
    draft.toml["tach"] |= {"time_unit": unit, "time_offset_s": -1.25}
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.tach is not None
    np.testing.assert_allclose(recording.tach["t_s"], np.arange(1500) / 10 - 1.25, atol=1e-12)


@pytest.mark.parametrize(("stamp", "shift"), [("start", 0.01), ("centre", 0.0), ("end", -0.01)])
def test_stamps_move_to_the_centre_of_the_interval(stamp: str, shift: float, draft: Draft, tmp_path: Path) -> None:
    draft.toml["imu"]["stamp"] = stamp
    recording = read_recording(draft.write(tmp_path / "rec"))
    np.testing.assert_allclose(recording.imu["t_s"], draft["imu"]["t"] + shift, atol=1e-12)


def test_imu_units(draft: Draft, tmp_path: Path) -> None:
    expected = draft["imu"].to_numpy(copy=True)
    draft["imu"][["wx", "wy", "wz"]] *= 180 / np.pi
    draft["imu"][["fx", "fy", "fz"]] /= 9.80665
    draft.toml["imu"] |= {"gyro_unit": "deg/s", "accel_unit": "g"}
    recording = read_recording(draft.write(tmp_path / "rec"))
    np.testing.assert_allclose(recording.imu.to_numpy(), expected, rtol=1e-14, atol=1e-16)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3)])
def test_a_tach_of_distance(unit: str, factor: float, draft: Draft, tmp_path: Path) -> None:
    distance = draft["tach"]["count"] * 0.03
    draft["tach"]["count"] = distance * factor
    draft.toml["tach"] = {"file": "tach.csv", "column": "count", "kind": "distance", "unit": unit}
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.tach is not None
    np.testing.assert_allclose(recording.tach["distance_m"], distance, rtol=1e-14)


@pytest.mark.parametrize(("unit", "factor"), [("m/s", 1.0), ("km/h", 3.6)])
def test_a_tach_of_speed_is_integrated_by_trapezoids(unit: str, factor: float, draft: Draft, tmp_path: Path) -> None:
    t = draft["tach"]["t"].to_numpy()
    speed = 0.1 * t  # linear: the trapezoid is exact
    draft.tables["tach.csv"] = pd.DataFrame({"t": t, "v": speed * factor})
    draft.toml["tach"] = {"file": "tach.csv", "column": "v", "kind": "speed", "unit": unit}
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.tach is not None
    np.testing.assert_allclose(recording.tach["distance_m"], 0.05 * t**2, atol=1e-9)


def test_a_signed_tach_may_run_backwards(draft: Draft, tmp_path: Path) -> None:
    draft["tach"]["count"] *= -1
    draft.toml["tach"]["signed"] = True
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.tach is not None
    assert recording.tach["distance_m"].iloc[-1] < -500


def test_an_origin_may_be_chosen_and_local_positions_stay(draft: Draft, tmp_path: Path) -> None:
    draft.toml["gnss"]["origin"] = [35.2, 139.0, 40.0]
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss.iloc[0, 1:4], [0, 0, 10.0], atol=1e-8)
    for column, value in (("lat_deg", 500.0), ("lon_deg", -200.0), ("height_m", 3.0)):
        draft["gnss"][column] = value
    draft.toml["gnss"] |= {"frame": "local"}
    del draft.toml["gnss"]["origin"]
    recording = read_recording(draft.write(tmp_path / "rec"))
    assert recording.gnss_origin is None
    assert recording.gnss is not None
    np.testing.assert_array_equal(recording.gnss.iloc[0, 1:4], [500.0, -200.0, 3.0])


def test_two_lasers_may_share_a_table(draft: Draft, tmp_path: Path) -> None:
    draft["laser"]["b"] = draft["laser"]["a_lv"] + 1.0
    draft.toml["laser"].append({**draft.toml["laser"][0], "name": "B", "column": "b", "rail": "right"})
    lasers = read_recording(draft.write(tmp_path / "rec")).lasers
    np.testing.assert_allclose(lasers["B"]["displacement_m"] - lasers["A-left-vertical"]["displacement_m"], 1e-3)


def test_two_lasers_at_one_place_on_one_rail_are_refused(draft: Draft, tmp_path: Path) -> None:
    draft.toml["laser"].append({**draft.toml["laser"][0], "name": "B"})
    with pytest.raises(BadInputError, match=r"another one at x = 5 m measures the left rail along z too"):
        read_recording(draft.write(tmp_path / "rec"))


def test_lasers_of_the_same_times_are_written_to_one_file(draft: Draft, tmp_path: Path) -> None:
    draft["laser"]["b"] = draft["laser"]["a_lv"] + 1.0
    first = draft.toml["laser"][0]
    draft.toml["laser"] += [
        {**first, "name": "B", "column": "b", "rail": "right"},
        {**first, "name": "late", "time_offset_s": 0.01, "position_m": [-5.0, 0.5, 0.0]},
    ]
    recording = read_recording(draft.write(tmp_path / "rec"))
    folder = write_recording(recording, tmp_path / "copy")
    assert sorted(path.name for path in folder.glob("laser*")) == ["laser_1.parquet", "laser_2.parquet"]
    again = read_recording(folder)
    assert_same(recording, again)
    places = [(laser.file, laser.column) for laser in again.description.laser]
    assert places == [
        ("laser_1.parquet", "displacement_1_m"),
        ("laser_1.parquet", "displacement_2_m"),
        ("laser_2.parquet", "displacement_m"),
    ]


@pytest.mark.parametrize(
    "written",
    ["t,wx\n 0.5 ,1\n1.5,2\n", "\ufefft,wx\n0.5,1e0\n1.5,2\n", 't,"wx"\r\n0.5,1\r\n\r\n1.5,"2"\r\n'],
    ids=["spaces", "byte order mark", "CRLF, quotes, a blank line"],
)
def test_dialects_of_csv(written: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(written.encode())
    table, findings = open_table(tmp_path, "a.csv", ["t", "wx"])
    assert findings == []
    assert table is not None
    np.testing.assert_array_equal(table.numbers("t")[0], [0.5, 1.5])
    np.testing.assert_array_equal(table.numbers("wx")[0], [1.0, 2.0])


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_written_and_read_again_nothing_has_changed(table_format: Any, draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(draft.write(tmp_path / "rec"))
    written = write_recording(recording, tmp_path / "deep" / "copy", table_format=table_format)
    again = read_recording(written)
    assert_same(recording, again)
    assert again.description == canonical_form(recording, table_format)[0]
    third = write_recording(again, tmp_path / "third", table_format=table_format)
    for file in written.iterdir():
        assert file.read_bytes() == (third / file.name).read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"rec", "deep", "third"}


finite = st.floats(-1e6, 1e6)
characters = st.characters(exclude_characters="\0", exclude_categories=["Cs"])
times = st.lists(st.floats(1e-3, 0.2), min_size=10, max_size=30).map(lambda steps: np.cumsum(steps))


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording whose values are plausible, down to the last bits."""

    def table(columns: tuple[str, ...], t: np.ndarray, elements: st.SearchStrategy[float]) -> pd.DataFrame:
        values = draw(arrays(np.float64, (t.size, len(columns) - 1), elements=elements))
        return pd.DataFrame(np.column_stack([t, values]), columns=list(columns))

    t = draw(times)
    imu = table(IMU_COLUMNS, t, st.floats(-0.1, 0.1))
    imu["fz_mps2"] += 9.8
    pulses = draw(st.booleans())
    tach = table(TACH_COLUMNS, t, st.floats(0, 1))
    tach["distance_m"] = tach["distance_m"].cumsum()
    wheel = {"kind": "distance", "unit": "m"}
    if pulses:
        wheel = {"kind": "pulses", "unit": "1", "pulses_per_rev": 64, "wheel_diameter_m": draw(st.floats(0.3, 1.2))}
        tach["distance_m"] = np.floor(100 * tach["distance_m"]) * (np.pi * wheel["wheel_diameter_m"] / 64)
    gnss = table(GNSS_COLUMNS, t, finite)
    gnss[list(GNSS_COLUMNS[4:])] = gnss[list(GNSS_COLUMNS[4:])].abs() + 1e-3
    fixes = table(FIX_COLUMNS, t, finite)
    fixes["chainage_sd_m"] = fixes["chainage_sd_m"].abs() + 1e-3
    names = draw(st.lists(st.text(max_size=8), unique=True, max_size=2))
    lasers = {name: table(LASER_COLUMNS, t, st.floats(-1, 1)) for name in names}
    description = RecordingDescription(
        id=draw(st.text(characters, max_size=20)),
        start=draw(st.none() | st.datetimes()),
        imu=Imu(
            file="-",
            id=draw(st.none() | st.text(characters, min_size=1, max_size=20)),
            gyro=("a", "b", "c"),
            accel=("d", "e", "f"),
            lever_arm_m=(draw(st.floats(-100, 100)), 0.0, 0.0),
        ),
        tach=Tach(file="-", column="-", **wheel),
        fixes=Fixes(file="-"),
        gnss=Gnss(file="-", position=("a", "b", "c"), sd=("d", "e", "f")),
        laser=tuple(
            Laser(name=name, file="-", column="-", position_m=(float(i), 0, 0), axis="y", rail="left", sd_m=1e-4)
            for i, name in enumerate(names)
        ),
    )
    origin = draw(st.none() | st.tuples(st.floats(-90, 90), st.floats(-180, 180), finite).map(np.array))
    return Recording(description, imu, tach, fixes, gnss, lasers, origin)


@given(recordings(), st.sampled_from(["parquet", "csv"]))
@settings(max_examples=25, deadline=None)
def test_any_recording_survives_the_round_trip(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording, table_format: Any
) -> None:
    folder = tmp_path_factory.mktemp("any") / "rec"
    write_recording(recording, folder, table_format=table_format)
    again = read_recording(folder)
    assert_same(recording, again)
    assert again.description == canonical_form(recording, table_format)[0]


def test_pulses_stay_pulses_and_speeds_are_remembered(draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(draft.write(tmp_path / "pulses"))
    write_recording(recording, tmp_path / "copy")
    tach = read_recording(tmp_path / "copy").description.tach
    assert tach is not None
    assert (tach.kind, tach.pulses_per_rev, tach.integrates_speed) == ("pulses", 90, False)
    draft.tables["tach.csv"] = pd.DataFrame({"t": draft["tach"]["t"], "v": 1.0})
    draft.toml["tach"] = {"file": "tach.csv", "column": "v", "kind": "speed", "unit": "m/s"}
    write_recording(read_recording(draft.write(tmp_path / "speed")), tmp_path / "copy")
    tach = read_recording(tmp_path / "copy").description.tach
    assert tach is not None
    assert (tach.kind, tach.integrates_speed) == ("distance", True)


@pytest.fixture
def recording(draft: Draft, tmp_path: Path) -> Recording:
    return read_recording(draft.write(tmp_path / "source"))


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_truth_is_apart_and_comes_back(table_format: Any, recording: Recording, tmp_path: Path) -> None:
    truth = pd.DataFrame({"t_s": [0.0, 0.1, 0.2], "roll_rad": [0.1, np.nan, 1 / 3]})
    geometry = pd.DataFrame({"chainage_m": [0.0, 0.25], "twist_mm": [1 / 7, 2.0]})
    folder = write_recording(
        recording, tmp_path / "r", table_format=table_format, truth=truth, truth_geometry=geometry
    )  # fmt: skip
    pd.testing.assert_frame_equal(read_truth(folder), truth, check_exact=True)
    read = read_truth_geometry(folder)
    assert read is not None
    pd.testing.assert_frame_equal(read, geometry, check_exact=True)
    assert not any("truth" in name for name in vars(read_recording(folder)))


def test_truth_that_is_missing_or_wrong_is_refused(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"no \[truth\]"):
        read_truth(write_recording(recording, tmp_path / "none"))
    falling = pd.DataFrame({"t_s": [0.0, 0.2, 0.1], "roll_rad": 0.0})
    folder = write_recording(recording, tmp_path / "bad", truth=falling)
    assert read_truth_geometry(folder) is None
    with pytest.raises(BadInputError, match=r"truth\.parquet, column 't_s', data row 3"):
        read_truth(folder)
    with pytest.raises(BadInputError, match="without truth"):
        write_recording(recording, tmp_path / "geometry", truth_geometry=falling)


def test_an_existing_recording_is_replaced_and_nothing_else_is(recording: Recording, tmp_path: Path) -> None:
    folder = write_recording(recording, tmp_path / "r", table_format="csv")
    write_recording(recording, folder)
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["recording.toml", "imu.parquet", "tach.parquet", "fixes.parquet", "gnss.parquet", "laser_1.parquet"]
    )
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(BadInputError, match=r"notes\.txt"):
        write_recording(recording, folder)
    assert (folder / "notes.txt").read_text() == "mine"
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    with pytest.raises(BadInputError, match="not a recording"):
        write_recording(recording, other)
    with pytest.raises(BadInputError, match="is a file"):
        write_recording(recording, other / "thesis.tex")
    assert [path.name for path in other.iterdir()] == ["thesis.tex"]


def test_what_was_read_is_not_written_over(recording: Recording, tmp_path: Path) -> None:
    before = {path.name: path.read_bytes() for path in (tmp_path / "source").iterdir()}
    with pytest.raises(BadInputError, match="raw input is never changed"):
        write_recording(recording, tmp_path / "source")
    assert {path.name: path.read_bytes() for path in (tmp_path / "source").iterdir()} == before


def test_a_failure_while_writing_leaves_the_old_recording_and_no_rest(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_recording(recording, tmp_path / "r")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def fail(*_: object) -> str:
        raise OSError("disk full")

    monkeypatch.setattr("tomli_w.dumps", fail)
    with pytest.raises(OSError, match="disk full"):
        write_recording(recording, folder, table_format="csv")
    with pytest.raises(OSError, match="disk full"):
        write_recording(recording, tmp_path / "new")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r", "source"]


def test_tables_that_do_not_fit_the_description_are_refused(recording: Recording, tmp_path: Path) -> None:
    parts = dict(vars(recording))
    with pytest.raises(BadInputError, match=r"imu\.parquet: the table to write lacks fz_mps2"):
        write_recording(Recording(**parts | {"imu": recording.imu.drop(columns="fz_mps2")}), tmp_path / "a")
    with pytest.raises(BadInputError, match="lasers"):
        write_recording(Recording(**parts | {"lasers": {}}), tmp_path / "a")
    timeless = {name: table.drop(columns="t_s") for name, table in recording.lasers.items()}
    with pytest.raises(BadInputError, match="laser 'A-left-vertical': the table to write lacks t_s"):
        write_recording(Recording(**parts | {"lasers": timeless}), tmp_path / "a")
    bare = recording.description.model_copy(update={"tach": None})
    with pytest.raises(BadInputError, match=r"no \[tach\]"):
        write_recording(Recording(**parts | {"description": bare}), tmp_path / "a")
    assert not (tmp_path / "a").exists()


def mutilated(text: str, edits: list[tuple[float, int, str]]) -> str:
    for where, length, insertion in edits:
        start = int(where * len(text))
        text = text[:start] + insertion + text[start + length :]
    return text


edits = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.integers(0, 30),
        st.text(max_size=6)
        | st.sampled_from(["\n", '"', ",", "nan", "1e400", "-", "[", "]]", "= ", "\x00", "..", "''"]),
    ),
    min_size=1,
    max_size=4,
)


@pytest.fixture(scope="module")
def small_recording(
    make_run: Callable[..., dict[str, pd.DataFrame]], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str, str]:
    """A folder with a small recording, and the texts of its description and its IMU table."""
    folder = tmp_path_factory.mktemp("small")
    make_run(duration_s=2.0)["imu"].round(4).to_csv(folder / "imu.csv", index=False)
    toml = (
        'format = "trackfg-recording/1"\nid = "x"\nstart = 2026-05-01T03:12:00Z\n[track]\ngauge_m = 1.067\n[imu]\n'
        'file = "imu.csv"\ngyro = ["wx", "wy", "wz"]\naccel = ["fx", "fy", "fz"]\naxes = "FLU"\n'
        '[imu.noise]\ngyro_white = 1e-4\n[[laser]]\nname = "a"\nfile = "imu.csv"\ncolumn = "wx"\naxis = "z"\n'
        'rail = "left"\nsd_m = 1e-4\nposition_m = [0, 0, 0]\n[fixes]\nfile = "imu.csv"\nchainage = "fz"\nsd = "fz"\n'
        '[tach]\nfile = "imu.csv"\ncolumn = "t"\nkind = "distance"\nunit = "m"\n[gnss]\nfile = "imu.csv"\n'
        'position = ["wx", "wy", "wz"]\nsd = ["fz", "fz", "fz"]\nframe = "local"\n'
    )
    (folder / "recording.toml").write_text(toml)
    read_recording(folder)
    return folder, toml, (folder / "imu.csv").read_text()


def read_or_refuse(path: Path) -> None:
    """Read a sound recording, or refuse in one line; nothing else."""
    report = check_recording(path)
    assert all(str(finding).isprintable() for finding in report.findings)
    if not report.usable:
        with pytest.raises(BadInputError):
            read_recording(path)
        return
    recording = read_recording(path)
    assert np.isfinite(recording.imu.to_numpy()).all()
    assert (np.diff(recording.imu["t_s"]) > 0).all()


@given(edits=edits)
@settings(max_examples=150, deadline=None)
def test_a_mutilated_description_is_read_or_refused(small_recording: tuple[Path, str, str], edits: Any) -> None:
    folder, toml, _ = small_recording
    (folder / "other.toml").write_text(mutilated(toml, edits), encoding="utf-8", errors="surrogatepass")
    read_or_refuse(folder / "other.toml")


@given(edits=edits)
@settings(max_examples=100, deadline=None)
def test_a_mutilated_table_is_read_or_refused(small_recording: tuple[Path, str, str], edits: Any) -> None:
    folder, toml, table = small_recording
    (folder / "cut.csv").write_text(mutilated(table, edits), encoding="utf-8", errors="surrogatepass", newline="")
    (folder / "cut.toml").write_text(toml.replace("imu.csv", "cut.csv"))
    read_or_refuse(folder / "cut.toml")


@given(data=st.binary(max_size=200))
@settings(max_examples=50, deadline=None)
def test_bytes_that_mean_nothing_are_refused(small_recording: tuple[Path, str, str], data: bytes) -> None:
    folder, toml, _ = small_recording
    for suffix in ("csv", "parquet"):
        (folder / f"noise.{suffix}").write_bytes(data)
        (folder / "noise.toml").write_text(toml.replace("imu.csv", f"noise.{suffix}"))
        with pytest.raises(BadInputError, match=f"noise.{suffix}"):
            read_recording(folder / "noise.toml")


@pytest.mark.parametrize(
    "name", ["", ".", "a\x00b.csv", "x" * 300 + ".csv", "sub/imu.csv", "imu.csv/", "/", "~/imu.csv"]
)
def test_odd_file_names_are_refused(name: str, draft: Draft, tmp_path: Path) -> None:
    draft.toml["imu"]["file"] = name
    with pytest.raises(BadInputError):
        read_recording(draft.write(tmp_path / "rec"))


def test_a_table_in_a_folder_below_is_fine(draft: Draft, tmp_path: Path) -> None:
    folder = draft.write(tmp_path / "rec")
    (folder / "raw").mkdir()
    (folder / "imu.csv").rename(folder / "raw" / "imu.csv")
    toml = (folder / "recording.toml").read_text().replace("imu.csv", "raw/imu.csv")
    (folder / "recording.toml").write_text(toml)
    assert tomllib.loads(toml)["imu"]["file"] == "raw/imu.csv"
    assert len(read_recording(folder).imu) == len(draft["imu"])


SPEED = """
[[speed]]
file = "radar.csv"
column = "kmh"
unit = "km/h"
lowest_mps = 1.0
lever_arm_m = [3.0, 0.0, -0.5]
"""


def with_speed(draft: Draft, folder: Path, rows: str) -> Path:
    """The draft's recording with a radar whose rows these are."""
    written = Path(draft.write(folder))
    (written / "radar.csv").write_text("t,kmh\n" + rows, encoding="utf-8")
    toml = written / "recording.toml"
    toml.write_text(toml.read_text(encoding="utf-8") + SPEED, encoding="utf-8")
    return written


def test_a_speed_over_ground_has_no_rows_where_it_says_nothing(draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(with_speed(draft, tmp_path / "rec", "0,36\n0.1,\n0.2,3.5\n0.3,72\n"))
    np.testing.assert_allclose(recording.others["speed/1"].to_numpy(), [[0.0, 10.0], [0.3, 20.0]])
    write_recording(recording, tmp_path / "again")
    again = read_recording(tmp_path / "again")
    pd.testing.assert_frame_equal(again.others["speed/1"], recording.others["speed/1"], check_exact=True)
    assert again.description.speed[0].lever_arm_m == (3.0, 0.0, -0.5)


@pytest.mark.parametrize(
    ("rows", "code"),
    [("0,36\n0.1,-4\n", "speed-backwards"), ("0,3600\n0.1,3600\n", "speed-unit"), ("0,inf\n", "infinite")],
)
def test_an_impossible_speed_over_ground_is_refused(draft: Draft, tmp_path: Path, rows: str, code: str) -> None:
    report = check_recording(with_speed(draft, tmp_path / "rec", rows))
    assert code in [finding.code for finding in report.findings if finding.level == "error"]


RECEIVER = """
[gnss_speed]
file = "speeds.csv"
column = "kmh"
unit = "km/h"
"""


def with_receiver(draft: Draft, folder: Path, rows: str, keys: str = 'sd = "sd"\n') -> Path:
    """The draft's recording with a receiver's speeds whose rows these are."""
    written = Path(draft.write(folder))
    (written / "speeds.csv").write_text("t,kmh,sd\n" + rows, encoding="utf-8")
    toml = written / "recording.toml"
    toml.write_text(toml.read_text(encoding="utf-8") + RECEIVER + keys, encoding="utf-8")
    return written


def test_speeds_of_a_receiver_have_their_sigmas_and_no_rows_where_it_has_none(draft: Draft, tmp_path: Path) -> None:
    rows = "0,36,1.8\n0.1,,\n0.2,36,\n0.3,72,3.6\n"
    recording = read_recording(with_receiver(draft, tmp_path / "rec", rows))
    np.testing.assert_allclose(recording.others["gnss_speed"].to_numpy(), [[0.0, 10.0, 0.5], [0.3, 20.0, 1.0]])
    write_recording(recording, tmp_path / "again")
    again = read_recording(tmp_path / "again")
    pd.testing.assert_frame_equal(again.others["gnss_speed"], recording.others["gnss_speed"], check_exact=True)


@pytest.mark.parametrize(("keys", "sd"), [("", 0.1), ("sd_mps = 0.3\n", 0.3)])
def test_speeds_of_a_receiver_without_sigmas_have_one_for_all(
    draft: Draft, tmp_path: Path, keys: str, sd: float
) -> None:
    recording = read_recording(with_receiver(draft, tmp_path / "rec", "0,36,\n0.2,36,\n", keys))
    np.testing.assert_allclose(recording.others["gnss_speed"]["speed_sd_mps"], sd)


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        ("0,36,1\n0.1,-1,1\n", "negative-speed"),
        ("0,3600,1\n0.1,3600,1\n", "gnss-speed-unit"),
        ("0,inf,1\n", "infinite"),
        ("0,36,0\n", "bad-sigma"),
    ],
)
def test_an_impossible_speed_of_a_receiver_is_refused(draft: Draft, tmp_path: Path, rows: str, code: str) -> None:
    report = check_recording(with_receiver(draft, tmp_path / "rec", rows))
    assert code in [finding.code for finding in report.findings if finding.level == "error"]


SECOND = """
[[tach]]
file = "second.csv"
column = "m"
kind = "distance"
unit = "m"
scale_sd = SCALE_SD
"""


def with_second_tach(draft: Draft, folder: Path, scale_sd: str = "0.01") -> Path:
    """The draft's recording, its tach the first of two."""
    written = Path(draft.write(folder))
    (written / "second.csv").write_text("t,m\n0,0\n1,10\n2,25\n", encoding="utf-8")
    toml = written / "recording.toml"
    text = toml.read_text(encoding="utf-8").replace("[tach]", "[[tach]]")
    toml.write_text(text + SECOND.replace("SCALE_SD", scale_sd), encoding="utf-8")
    return written


def test_several_tachs_are_a_list(draft: Draft, tmp_path: Path) -> None:
    alone = read_recording(draft.write(tmp_path / "alone"))
    recording = read_recording(with_second_tach(draft, tmp_path / "rec"))
    assert recording.tach is not None
    assert alone.tach is not None
    pd.testing.assert_frame_equal(recording.tach, alone.tach, check_exact=True)
    np.testing.assert_array_equal(recording.others["tach/2"].to_numpy(), [[0.0, 0.0], [1.0, 10.0], [2.0, 25.0]])
    write_recording(recording, tmp_path / "again")
    again = read_recording(tmp_path / "again")
    pd.testing.assert_frame_equal(again.others["tach/2"], recording.others["tach/2"], check_exact=True)
    assert again.description.further_tach[0].kind == "distance"


def test_a_second_tach_without_a_first_one_is_not_written(draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(with_second_tach(draft, tmp_path / "rec"))
    description = recording.description.model_copy(update={"tach": None})
    alone = replace(recording, description=description, tach=None)

    with pytest.raises(BadInputError, match="tach/2 table but no first tach; expected a table tach"):
        write_recording(alone, tmp_path / "again")


def test_a_fault_of_the_second_tach_is_named_as_such(draft: Draft, tmp_path: Path) -> None:
    report = check_recording(with_second_tach(draft, tmp_path / "rec", scale_sd="-1"))
    assert any("tach[2].scale_sd" in str(finding) for finding in report.findings)


def test_several_imus_are_refused_with_one_message(draft: Draft, tmp_path: Path) -> None:
    folder = Path(draft.write(tmp_path / "rec"))
    toml = folder / "recording.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace("[imu]", "[[imu]]"), encoding="utf-8")
    errors = [str(finding) for finding in load(folder).findings if finding.level == "error"]
    assert any("key imu: is a list, but a recording has one imu" in error for error in errors), errors
