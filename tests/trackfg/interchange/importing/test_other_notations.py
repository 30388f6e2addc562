"""Positions, vectors and increments in the notations of receivers, databases and devices become the usual columns."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.orc
import pyproj
import pytest
from interchange.foreign_forms import Drive
from scipy.spatial.transform import Rotation

from trackfg.errors import BadInputError
from trackfg.interchange.importing.channels.channel_names import channel_of
from trackfg.interchange.importing.columns.written_units import factor_of, unit_in
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.delimited.data_rows import is_remark
from trackfg.interchange.importing.proposals.stated_wheel import stated_diameter, stated_pulses
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.shapes.earth_fixed_positions import with_geodetic
from trackfg.interchange.importing.shapes.merged_names import without_merge_suffixes
from trackfg.interchange.importing.shapes.rotation_increments import with_angles
from trackfg.interchange.importing.shapes.written_angles import with_degrees
from trackfg.interchange.importing.shapes.written_points import with_points
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics import geodesy
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
DEG = np.pi / 180.0
AXES = "xyz"


def _imu(drive: Drive) -> pd.DataFrame:
    names = [f"{what}{axis} [{unit}]" for what, unit in (("g", "rad/s"), ("a", "m/s2")) for axis in AXES]
    return pd.DataFrame({"t [s]": drive.t, **dict(zip(names, np.hstack([drive.gyro, drive.accel]).T, strict=True))})


def _recording(made: Imported, drive: Drive, *, rate: float = 1e-6, force: float = 1e-6) -> Recording:
    """Return the recording, whose rates and forces are those of the drive."""
    recording = made.loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=rate)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=force)
    return recording


def _places(drive: Drive) -> np.ndarray:
    return np.column_stack([drive.latitude, drive.longitude, drive.height])


def _beside_imu(drive: Drive, folder: Path, positions: dict[str, object], delimiter: str = ",") -> Path:
    folder = folder / "source"
    folder.mkdir()
    _imu(drive).to_csv(folder / "imu.csv", index=False)
    pd.DataFrame({"t [s]": drive.gnss_t, **positions}).to_csv(folder / "gnss.csv", index=False, sep=delimiter)
    return folder


def _is_at_its_places(recording: Recording, drive: Drive, *, within_m: float = 0.02, with_height: bool = True) -> None:
    assert recording.gnss is not None
    assert recording.gnss_origin is not None
    origin = np.array(recording.gnss_origin, dtype=np.float64)
    expected = geodesy.geodetic_to_enu(_places(drive), np.array([*origin[:2], drive.height[0]]))
    columns = ["east_m", "north_m", "up_m"][: 3 if with_height else 2]
    measured = recording.gnss[columns].to_numpy()
    np.testing.assert_allclose(measured - measured[0], (expected - expected[0])[:, : len(columns)], atol=within_m)


@pytest.mark.parametrize(
    "names", [["ecef_x [m]", "ecef_y [m]", "ecef_z [m]"], ["X-ECEF", "Y-ECEF", "Z-ECEF"], ["X", "Y", "Z"]]
)
def test_positions_from_the_centre_of_the_earth(
    drive: Drive, tmp_path: Path, imported: Import, names: list[str]
) -> None:
    ecef = geodesy.geodetic_to_ecef(_places(drive))
    source = _beside_imu(drive, tmp_path, dict(zip(names, ecef.T, strict=True)))
    _is_at_its_places(_recording(imported(source), drive), drive)


def test_positions_of_ublox_in_centimetres(drive: Drive, tmp_path: Path, imported: Import) -> None:
    ecef = np.round(100.0 * geodesy.geodetic_to_ecef(_places(drive))).astype(np.int64)
    ecef[:3] = 0  # before the first fix
    source = _beside_imu(drive, tmp_path, {f"ecef{axis}": ecef[:, i] for i, axis in enumerate("XYZ")})
    recording = _recording(imported(source), drive)
    assert recording.gnss is not None
    assert len(recording.gnss) == len(drive.gnss_t) - 3


def test_a_vector_that_is_not_on_the_earth_is_no_position() -> None:
    values = np.full(10, 6.4e6)
    table = SourceTable("log.csv", pd.DataFrame({f"field_{axis}": values for axis in AXES}))
    assert with_geodetic(table) is table


def test_points_of_well_known_text(drive: Drive, tmp_path: Path, imported: Import) -> None:
    text = [f"SRID=4326;POINT Z ({x:.9f} {y:.9f} {z:.3f})" for y, x, z in _places(drive)]
    _is_at_its_places(_recording(imported(_beside_imu(drive, tmp_path, {"geom": text})), drive), drive)


def test_points_of_a_projection_have_its_code(drive: Drive, tmp_path: Path, imported: Import) -> None:
    plan = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(drive.longitude, drive.latitude)
    text = [f"SRID=32632;POINT({x:.4f} {y:.4f})" for x, y in zip(*plan, strict=True)]
    source = _beside_imu(drive, tmp_path, {"geom": text, "alt": drive.height})
    _is_at_its_places(_recording(imported(source), drive), drive)


@pytest.mark.parametrize(("name", "is_latitude_first"), [("latlon", True), ("LngLat", False), ("location", True)])
def test_pairs_in_one_cell(drive: Drive, tmp_path: Path, imported: Import, name: str, is_latitude_first: bool) -> None:
    pairs = _places(drive)[:, [0, 1] if is_latitude_first else [1, 0]]
    text = [f"{first:.9f}, {second:.9f}" for first, second in pairs]
    source = _beside_imu(drive, tmp_path, {name: text, "alt": drive.height})
    _is_at_its_places(_recording(imported(source), drive), drive)


def test_an_order_that_no_name_says_has_a_note() -> None:
    table = SourceTable("gnss.csv", pd.DataFrame({"location": pd.Series(["46.9, 7.4"] * 3, dtype="string")}))
    assert any("first number is taken for the latitude" in note for note in with_points(table).notes)


@pytest.mark.parametrize("cell", ["SRID=4326;POINT(46.9 107.4)", "LINESTRING(7.4 46.9, 7.5 46.9)", "POINT"])
def test_text_that_is_no_point_stays(cell: str) -> None:
    table = SourceTable("gnss.csv", pd.DataFrame({"geom": pd.Series([cell] * 3, dtype="string")}))
    assert with_points(table) is table


def test_points_of_geojson(drive: Drive, tmp_path: Path, imported: Import) -> None:
    ns = drive.ns[0] + np.round(drive.gnss_t * 1e9).astype(np.int64)
    times = pd.to_datetime(ns).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    features = [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [x, y, z]}, "properties": {"time": time}}
        for (y, x, z), time in zip(_places(drive).tolist(), times, strict=True)
    ]
    folder = tmp_path / "source"
    folder.mkdir()
    (folder / "track.json").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    table = _imu(drive).rename(columns={"t [s]": "time"})
    table["time"] = pd.to_datetime(drive.ns).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    table.to_csv(folder / "imu.csv", index=False)
    _is_at_its_places(_recording(imported(folder), drive), drive)


def _records(drive: Drive) -> pd.DataFrame:
    return _imu(drive).rename(columns=lambda name: name.partition(" ")[0]).assign(wheel_speed=drive.speed)


def _write_json(form: str, drive: Drive, path: Path) -> None:
    records = _records(drive)
    if form == "by time":
        keys = (drive.ns // 1_000_000).astype(str)
        rows = records.drop(columns="t").to_dict("records")
        path.write_text(json.dumps(dict(zip(keys, rows, strict=True))))
    elif form == "by sensor and time":
        by_time = {
            sensor: {f"{t:.4f}": dict(zip(AXES, row, strict=True)) for t, row in zip(drive.t, rows, strict=True)}
            for sensor, rows in (("gyroscope", drive.gyro), ("accelerometer", drive.accel))
        }
        path.write_text(json.dumps(by_time))
    elif form == "by column and row":
        records.to_json(path, double_precision=12)
    else:
        dated = records.drop(columns="t").set_index(pd.to_datetime(drive.ns))
        dated.to_json(path, date_format="iso", date_unit="us", double_precision=12)


@pytest.mark.parametrize("form", ["by time", "by sensor and time", "by column and row", "by column and time"])
def test_json_whose_keys_are_rows(drive: Drive, tmp_path: Path, imported: Import, form: str) -> None:
    _write_json(form, drive, tmp_path / "log.json")
    made = imported(tmp_path / "log.json", imu_gyro_unit="rad/s", tach_unit="m/s")
    recording = _recording(made, drive)
    np.testing.assert_allclose(np.diff(recording.imu["t_s"]), np.diff(drive.t), atol=2e-3)


def _turns(drive: Drive) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(drive.gyro / 100.0).as_quat(scalar_first=True))


@pytest.mark.parametrize(
    "names", [["OriInc_q0", "OriInc_q1", "OriInc_q2", "OriInc_q3"], ["dq_W", "dq_X", "dq_Y", "dq_Z"]]
)
@pytest.mark.parametrize("velocity", [["VelInc_X", "VelInc_Y", "VelInc_Z"], ["dv[1]", "dv[2]", "dv[3]"]])
def test_increments_of_xsens(
    drive: Drive, tmp_path: Path, imported: Import, names: list[str], velocity: list[str]
) -> None:
    table = pd.DataFrame({"SampleTimeFine": np.round(drive.t * 1e4).astype(int)})
    table[names] = _turns(drive)
    table[velocity] = drive.accel / 100.0
    table.to_csv(tmp_path / "MT_01.txt", index=False, sep="\t")
    _recording(imported(tmp_path / "MT_01.txt"), drive)


def test_an_orientation_is_no_increment() -> None:
    angles = np.linspace(0.0, 3.0, 50)
    table = SourceTable(
        "log.csv", pd.DataFrame({"dq_w": np.cos(angles), "dq_x": np.sin(angles), "dq_y": 0.0, "dq_z": 0.0})
    )
    assert with_angles(table) is table


@pytest.mark.parametrize("names", ["{}Rate", "Delta{}"])
def test_increments_by_gravity(drive: Drive, tmp_path: Path, imported: Import, names: str) -> None:
    """Forces of g times the interval are increments of velocity, and the rates beside them are of angles then."""
    force = "{}Acc" if names == "{}Rate" else "DeltaVel{}"
    turns = ["Roll", "Pitch", "Yaw"] if names == "{}Rate" else ["Theta_0", "Theta_1", "Theta_2"]
    along = ["Long", "Lat", "Vert"] if names == "{}Rate" else ["_0", "_1", "_2"]
    table = pd.DataFrame({"Time [s]": drive.t})
    table[[names.format(turn) for turn in turns]] = drive.gyro / 100.0
    table[[force.format(axis) for axis in along]] = drive.accel / 100.0
    table.to_csv(tmp_path / "log.csv", index=False)
    _recording(imported(tmp_path / "log.csv", imu_axes="FLU"), drive)


def test_a_gyro_whose_name_alone_is_of_increments_is_asked(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _imu(drive).rename(columns={f"g{axis} [rad/s]": f"delta_angle_{axis}" for axis in AXES})
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(BadInputError, match=r"imu\.gyro_unit: the source does not say it"):
        imported(tmp_path / "log.csv")


def test_corrimudata_of_novatel_points_to_the_right(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = pd.DataFrame({"Time [s]": drive.t})
    table[["PitchRate", "RollRate", "YawRate"]] = drive.gyro[:, [1, 0, 2]] * [-0.01, 0.01, 0.01]
    table[["LateralAcc", "LongitudinalAcc", "VerticalAcc"]] = drive.accel[:, [1, 0, 2]] * [-0.01, 0.01, 0.01]
    table.to_csv(tmp_path / "CORRIMUDATA.csv", index=False)
    _recording(imported(tmp_path / "CORRIMUDATA.csv"), drive)


@pytest.mark.parametrize("form", ["[{:.7f}, {:.7f}, {:.7f}]", "[ {:.7f}  {:.7f} {:.7f}]", "({:.7f}, {:.7f}, {:.7f})"])
def test_vectors_in_cells(drive: Drive, tmp_path: Path, imported: Import, form: str) -> None:
    columns = {
        name: [form.replace("  ", " ").format(*row) for row in values]
        for name, values in (("gyro", drive.gyro), ("accel", drive.accel))
    }
    pd.DataFrame({"time": drive.t, **columns}).to_csv(tmp_path / "log.csv", index=False)
    _recording(imported(tmp_path / "log.csv", imu_gyro_unit="rad/s"), drive)


def test_suffixes_of_a_merge_are_no_axes(drive: Drive, tmp_path: Path, imported: Import) -> None:
    gyro, accel = (
        pd.DataFrame({"time": drive.t, **dict(zip(AXES, part.T, strict=True))}) for part in (drive.gyro, drive.accel)
    )
    gyro.merge(accel, on="time").to_csv(tmp_path / "log.csv", index=False)
    _recording(imported(tmp_path / "log.csv", imu_gyro_unit="rad/s"), drive)


@pytest.mark.parametrize("names", [["gyro_x", "gyro_y", "gyro_z"], ["speed_x", "speed_y"], ["gx", "gy"]])
def test_axes_are_no_suffixes_of_a_merge(names: list[str]) -> None:
    table = SourceTable("log.csv", pd.DataFrame({name: [1.0, 2.0] for name in names}))
    assert without_merge_suffixes(table) is table


def test_names_of_two_levels_as_tuples(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = pd.DataFrame({"time": drive.t})
    table[[f"('gyro', '{axis}')" for axis in AXES]] = drive.gyro
    table[[f"('accel', '{axis}')" for axis in AXES]] = drive.accel
    table.to_csv(tmp_path / "log.csv", index=False)
    _recording(imported(tmp_path / "log.csv", imu_gyro_unit="rad/s"), drive)


@pytest.mark.parametrize("unit", ["ø/s", "¡/s", "Â°/s", "\ufffd/s", "ådeg/s"])
def test_a_damaged_sign_of_a_degree(unit: str) -> None:
    assert factor_of(unit, "angular rate") == pytest.approx(DEG)


@pytest.mark.parametrize("text", ["0,1 km/h", "v 0,1 km/h", "V-Ist [0,1 km/h]", "0.1 km/h"])
def test_a_count_with_a_decimal_comma(text: str) -> None:
    unit = unit_in(text, "speed")
    assert unit is not None
    assert factor_of(unit, "speed") == pytest.approx(0.1 / 3.6)


def test_a_channel_in_tenths_of_millimetres() -> None:
    channel = channel_of("Level left", "0.1 mm")
    assert channel is not None
    assert channel.factor == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("remarks", "pulses", "diameter"),
    [
        ("Raddurchmesser: 860 mm\nImpulse pro Umdrehung: 90", "90", "0.86"),
        ("Wheel diameter [m]: 0.860\nPulses per revolution: 90\n\nt [s],pulses", "90", "0.86"),
        ("# 90 pulses/rev, wheel diameter 0.86 m", "90", "0.86"),
        ("Rad-Durchmesser 860\nImp./U = 90", "90", "0.86"),
        ("Wheel diameter 860 mm (new 920 mm), wheel diameter 0.92 m", "", ""),
        ("Pulses: 90, run of 860 m", "", ""),
    ],
)
def test_a_wheel_that_lines_above_the_table_state(remarks: str, pulses: str, diameter: str) -> None:
    tables = [SourceTable("log.csv", pd.DataFrame(), remarks=remarks)]
    assert (stated_pulses(tables), stated_diameter(tables)) == (pulses, diameter)


@pytest.mark.parametrize("cell", ["46.9, 7.4", "46.900000000, 7.400000000"])
def test_two_numbers_are_no_degrees_and_minutes(cell: str) -> None:
    table = SourceTable("gnss.csv", pd.DataFrame({"Latitude": pd.Series([cell] * 3, dtype="string")}))
    assert with_degrees(table) is table


def test_pulses_of_an_interval_are_no_speed(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """A unit ``ms`` behind them is that of the interval, and no m/s."""
    table = _imu(drive).assign(**{"pulses per 100 ms": np.round(10.0 * drive.speed)})
    table.to_csv(tmp_path / "log.csv", index=False)
    assert _recording(imported(tmp_path / "log.csv"), drive).tach is None


@pytest.mark.parametrize(("line", "remark"), [("-----+-----", True), ("(26000 rows)", True), ("-1.5 | -2.5", False)])
def test_rules_of_a_printed_table_are_remarks(line: str, remark: bool) -> None:
    assert is_remark(line, "|") == remark


def test_a_table_as_a_database_prints_it(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _records(drive)
    rows = [" | ".join(f"{value:11.7f}" for value in row) for row in table.to_numpy()]
    rule = "+".join(["-" * 13] * len(table.columns))
    text = [" | ".join(f"{name:11}" for name in table.columns), rule, *rows, f"({len(rows)} rows)", ""]
    (tmp_path / "psql.txt").write_text("\n".join(text))
    _recording(imported(tmp_path / "psql.txt", imu_gyro_unit="rad/s", tach_unit="m/s"), drive)


def test_packed_netcdf(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.nc", "w") as file:
        file["time"] = drive.t
        for name, values, unit in (("gyro", drive.gyro, "rad/s"), ("acc", drive.accel, "m/s2")):
            low, high = values.min(axis=0), values.max(axis=0)
            for i, axis in enumerate(AXES):
                scale, offset = (high[i] - low[i]) / 60_000.0, 0.5 * (high[i] + low[i])
                packed = file.create_dataset(
                    f"{name}_{axis}", data=np.round((values[:, i] - offset) / scale).astype("i2")
                )
                packed.attrs.update({"units": unit, "scale_factor": scale, "add_offset": offset})
                packed.attrs["_FillValue"] = np.int16(-32768)
    _recording(imported(tmp_path / "run.nc"), drive, rate=1e-6, force=1e-4)


def test_an_array_whose_attributes_name_its_columns(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _records(drive)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        data = file.create_dataset("data", data=table.to_numpy())
        data.attrs["columns"] = list(table.columns)
        data.attrs["units"] = ["s", *["rad/s"] * 3, *["m/s^2"] * 3, "m/s"]
    _recording(imported(tmp_path / "run.h5"), drive)


def test_a_rate_in_an_attribute(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        group = file.create_group("imu")
        group.attrs["sampling_rate"] = 100.0
        for name, values, unit in (("gyro", drive.gyro, "rad/s"), ("accel", drive.accel, "m/s^2")):
            group.create_dataset(name, data=values).attrs["unit"] = unit
    recording = _recording(imported(tmp_path / "run.h5"), drive)
    np.testing.assert_allclose(np.diff(recording.imu["t_s"]), 0.01, atol=1e-9)


def test_orc(drive: Drive, tmp_path: Path, imported: Import) -> None:
    pa.orc.write_table(pa.Table.from_pandas(_imu(drive), preserve_index=False), tmp_path / "run.orc")
    _recording(imported(tmp_path / "run.orc"), drive)


def test_waveforms_of_tdms_without_an_offset(drive: Drive, tmp_path: Path, imported: Import) -> None:
    values = np.hstack([drive.gyro / DEG, drive.accel / STANDARD_GRAVITY]).T
    names = [f"{sensor} {axis}" for sensor in ("Gyro", "Acc") for axis in AXES]
    channels = [
        nptdms.ChannelObject("IMU", name, part, {"wf_increment": 0.01, "unit_string": "deg/s" if "G" in name else "g"})
        for name, part in zip(names, values, strict=True)
    ]
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment(channels)
    _recording(imported(tmp_path / "run.tdms"), drive)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("run.nc", b"CDF\x05" + bytes(200), "CDF-5.*nccopy"),
        ("imu.txt", b"header:\n  stamp:\n    sec: 1\n---\n", "messages of ROS.*ros2 bag record"),
    ],
)
def test_what_is_not_read_says_what_to_do(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInputError, match=says):
        source_format(tmp_path / name)
