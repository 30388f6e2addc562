"""Sources as other versions and settings of their programs write them: what comes back is what went in."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from functools import reduce
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import START_NS, Drive, write_rcm_dx

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.shapes.channel_tables import with_joined_channels
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.mdf import _joined
from trackfg.interchange.importing.sources.messages import cells_of, measured_ns
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
START = datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
AXES = ["x", "y", "z"]


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def _same_imu(back: Recording, drive: Drive) -> None:
    np.testing.assert_allclose(back.imu["t_s"], drive.t, atol=2e-9)
    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)


def _rolled(back: Recording, drive: Drive) -> None:
    assert back.tach is not None
    t, rolled = back.tach["t_s"].to_numpy(), back.tach["distance_m"].to_numpy()
    distance = np.interp(t, drive.t, np.cumsum(drive.speed) / 100.0)
    np.testing.assert_allclose(rolled - rolled[0], distance - distance[0], atol=0.05)


def _phyphox(drive: Drive, path: Path, times: str, t: np.ndarray, **written: Any) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, unit, values in (("Gyroscope", "rad/s", drive.gyro), ("Accelerometer", "m/s^2", drive.accel)):
            frame = pd.DataFrame(values, columns=[f"{axis} ({unit})" for axis in "XYZ"])
            frame.insert(0, "Time (s)", t)
            archive.writestr(f"{name}.csv", frame.to_csv(index=False, **written))
        archive.writestr("meta/time.csv", times)
    return path


def test_phyphox_says_when_its_parts_began(drive: Drive, tmp_path: Path, imported: Import) -> None:
    # The app's clock stands still in a pause, the vehicle does not.
    head = '"event","experiment time","system time","system time text"\n'
    begins = START_NS / 1e9
    times = f'{head}"START",0.0,{begins:.3f},""\n"PAUSE",8.0,{begins + 8:.3f},""\n"START",8.0,{begins + 38:.3f},""\n'

    back = _recording(imported(_phyphox(drive, tmp_path / "log.zip", times, drive.t)))

    assert back.description.start == START
    np.testing.assert_allclose(back.imu["t_s"], drive.t + 30.0 * (drive.t >= 8.0), atol=2e-9)
    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-12)


def test_a_column_of_phyphox_that_ends_in_y_is_no_axis(drive: Drive, tmp_path: Path, imported: Import) -> None:
    folder = tmp_path / "log"
    with zipfile.ZipFile(_phyphox(drive, tmp_path / "log.zip", "event,experiment time\nSTART,0\n", drive.t)) as archive:
        archive.extractall(folder)
    for name in ("Gyroscope.csv", "Accelerometer.csv"):
        pd.read_csv(folder / name).assign(accuracy=3).to_csv(folder / name, index=False)

    _same_imu(_recording(imported(folder)), drive)


def test_phyphox_with_decimal_commas_and_no_dates(drive: Drive, tmp_path: Path, imported: Import) -> None:
    times = '"event";"experiment time"\n"START";0,0\n'

    back = _recording(imported(_phyphox(drive, tmp_path / "log.zip", times, drive.t, sep=";", decimal=",")))

    assert back.description.start is None
    _same_imu(back, drive)


def test_an_xls_file_has_sheets_as_an_xlsx_file(drive: Drive, tmp_path: Path, imported: Import) -> None:
    xlwt = pytest.importorskip("xlwt")
    pytest.importorskip("xlrd")
    book = xlwt.Workbook()
    for name, unit, values in (("Gyroscope", "rad/s", drive.gyro), ("Accelerometer", "m/s^2", drive.accel)):
        sheet = book.add_sheet(name)
        for j, title in enumerate(["Time (s)", *(f"{name} {axis} ({unit})" for axis in AXES)]):
            sheet.write(0, j, title)
        for i, row in enumerate(np.column_stack([drive.t, values]).tolist(), start=1):
            for j, value in enumerate(row):
                sheet.write(i, j, value)
    book.save(str(tmp_path / "log.xls"))

    _same_imu(_recording(imported(tmp_path / "log.xls")), drive)

    (tmp_path / "log.xls").write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + b"x" * 3000)
    with pytest.raises(BadInputError, match=r"log\.xls: cannot be read .*; expected a spreadsheet \(\.xls\)"):
        source_format(tmp_path / "log.xls").tables(tmp_path / "log.xls", lambda _: None)


def test_merged_names_with_units_above_axes_and_dates_beside_times(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Run of line 4201"])
    sheet.append([])
    sheet.append(["Date", "Time", "Gyro [deg/s]", None, None, "Acceleration [g]", None, None, "Wheel speed [km/h]"])
    sheet.append([None, None, *"XYZXYZ", None])
    for cells in ("A1:I1", "A3:A4", "B3:B4", "C3:E3", "F3:H3", "I3:I4"):
        sheet.merge_cells(cells)
    for i, t in enumerate(drive.t.tolist()):
        values = [*np.degrees(drive.gyro[i]), *(drive.accel[i] / 9.80665), 3.6 * drive.speed[i]]
        time = (START + timedelta(milliseconds=round(1000 * t))).time()
        sheet.append([date(2026, 5, 1), time, *map(float, values)])
    book.save(tmp_path / "log.xlsx")

    back = _recording(imported(tmp_path / "log.xlsx"))

    assert back.description.start == START
    _same_imu(back, drive)
    _rolled(back, drive)


def _bag(folder: Path, topics: dict[str, tuple[Callable[[Any, int], Any], np.ndarray]]) -> Path:
    """Write a bag with a message for each time of a topic, which is received 2 ms later."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    ticks = "std_msgs/Header header\nint64 ticks\nstring note\n"
    store.register(get_types_from_msg(ticks, "acme_msgs/msg/WheelTicks"))
    store.register(
        get_types_from_msg("std_msgs/Header header\nfloat64[3] gyro\nfloat64[3] accel\n", "acme_msgs/msg/Imu")
    )
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, (message_at, ns) in topics.items():
            messages = [message_at(store.types, i) for i in range(ns.size)]
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=store)
            for message, stamp in zip(messages, ns.tolist(), strict=True):
                writer.write(connection, stamp + 2_000_000, store.serialize_cdr(message, kind))
    return folder / "bag"


def _head(types: Any, ns: int, frame: str = "base") -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=int(ns) // 10**9, nanosec=int(ns) % 10**9)
    return types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def _own_imu(drive: Drive) -> Callable[[Any, int], Any]:
    def message(types: Any, i: int) -> Any:
        return types["acme_msgs/msg/Imu"](
            header=_head(types, drive.ns[i]), gyro=drive.gyro[i].copy(), accel=drive.accel[i].copy()
        )

    return message


def _wheel(drive: Drive) -> Callable[[Any, int], Any]:
    turns = np.cumsum(drive.speed) / 100.0 / (np.pi * 0.92)

    def message(types: Any, i: int) -> Any:
        return types["acme_msgs/msg/WheelTicks"](
            header=_head(types, drive.ns[i]), ticks=int(1000 * turns[i]), note="sound"
        )

    return message


def _float(drive: Drive) -> Callable[[Any, int], Any]:
    return lambda types, i: types["std_msgs/msg/Float64"](data=float(drive.speed[i]))


def _receivers_velocity(drive: Drive, frame: str, north: float) -> Callable[[Any, int], Any]:
    def message(types: Any, i: int) -> Any:
        vector = types["geometry_msgs/msg/Vector3"]
        twist = types["geometry_msgs/msg/Twist"](linear=vector(3.0, north, 0.0), angular=vector(0.0, 0.0, 0.0))
        return types["geometry_msgs/msg/TwistStamped"](header=_head(types, drive.gnss_ns[i], frame), twist=twist)

    return message


def _fix_without(drive: Drive, covariance: float, kind: int, *, heights: bool) -> Callable[[Any, int], Any]:
    """Fixes whose covariance is of a ``kind``, every fourth of no status (-2) and of a covariance that is known."""

    def message(types: Any, i: int) -> Any:
        known = i % 4 == 3
        return types["sensor_msgs/msg/NavSatFix"](
            header=_head(types, drive.gnss_ns[i]),
            status=types["sensor_msgs/msg/NavSatStatus"](status=-2 if known else 0, service=1),
            latitude=float(drive.latitude[i]),
            longitude=float(drive.longitude[i]),
            altitude=float(drive.height[i]) if heights else float("nan"),
            position_covariance=np.full(9, 0.04 if known else covariance),
            position_covariance_type=2 if known else kind,
        )

    return message


def test_messages_of_own_types_are_read_by_the_names_of_their_fields(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    pytest.importorskip("rosbags")
    bag = _bag(tmp_path, {"/acme/imu": (_own_imu(drive), drive.ns), "/wheel_speed": (_float(drive), drive.ns)})

    back = _recording(imported(bag))

    _same_imu(back, drive)
    assert back.tach is not None
    # A message without a header counts from when it was received.
    np.testing.assert_allclose(back.tach["t_s"], drive.t + 0.002, atol=2e-9)


def test_ticks_of_a_message_are_pulses(drive: Drive, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    bag = _bag(tmp_path, {"/acme/imu": (_own_imu(drive), drive.ns), "/acme/wheel": (_wheel(drive), drive.ns)})

    tables = source_format(bag).tables(bag, lambda _: None)

    assert [(table.name, table.columns) for table in tables] == [
        ("/acme/imu", ["stamp_ns", *(f"{kind}.{axis}" for kind in ("gyro", "accel") for axis in AXES)]),
        ("/acme/wheel", ["stamp_ns", "ticks"]),
    ]
    np.testing.assert_array_equal(tables[1].frame["stamp_ns"], drive.ns)


@pytest.mark.parametrize(("frame", "north"), [("map", -7.0), ("gps", 0.0)])
def test_a_velocity_of_a_receiver_is_no_tach(
    frame: str, north: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    pytest.importorskip("rosbags")
    velocity = _receivers_velocity(drive, frame, north)
    bag = _bag(tmp_path, {"/acme/imu": (_own_imu(drive), drive.ns), "/vel": (velocity, drive.gnss_ns)})

    assert _recording(imported(bag)).tach is None


@pytest.mark.parametrize(("covariance", "kind", "heights"), [(0.0, 0, True), (np.nan, 0, False), (4.0, 0, True)])
def test_positions_without_covariance_or_height_keep_their_place(
    covariance: float, kind: int, heights: bool, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    pytest.importorskip("rosbags")
    fix = _fix_without(drive, covariance, kind, heights=heights)
    bag = _bag(tmp_path, {"/acme/imu": (_own_imu(drive), drive.ns), "/fix": (fix, drive.gnss_ns)})

    gnss = _recording(imported(bag)).gnss

    assert gnss is not None
    np.testing.assert_allclose(gnss["t_s"], drive.gnss_t, atol=2e-9)
    sd, known = gnss.to_numpy()[:, 4:], np.arange(len(gnss)) % 4 == 3
    assert (sd[~known] == [3.0, 3.0, 6.0 if heights else 1000.0]).all()
    np.testing.assert_allclose(sd[known], [[0.2, 0.2, 0.2 if heights else 1000.0]] * 5)
    assumed = [note for table in source_format(bag).tables(bag, lambda _: None) for note in table.notes]
    assert assumed == ["/fix: 15 of 20 positions have no covariance: their sigmas are assumed, 3, 3 and 6 m"]


def test_cells_and_times_of_messages() -> None:
    message = {
        "header": {"stamp": {"sec": 7, "nanosec": 5}},
        "ok": True,
        "name": "wheel",
        "rate": [1, 2, 3],
        "samples": [1.0, 2.0],
        "position_covariance": [4.0, 0, 0, 0, 9.0, 0, 0, 0, -1.0],
        "twist": SimpleNamespace(linear=SimpleNamespace(x=4)),
    }

    assert measured_ns(message, 1) == 7_000_000_005
    assert measured_ns({"timestamp": {"sec": 7, "nsec": 5}}, 1) == 7_000_000_005
    assert measured_ns({"time": 7}, 1) == 1
    sigmas = {"sd_east_m": 2.0, "sd_north_m": 3.0, "sd_up_m": 0.0}
    assert cells_of(message) == {
        "ok": 1.0, "name": "wheel", "rate.x": 1.0, "rate.y": 2.0, "rate.z": 3.0, **sigmas, "twist.linear.x": 4.0,
    }  # fmt: skip


def test_channels_with_a_group_each_are_one_table_with_the_date_of_the_file(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.header.start_time = START + timedelta(milliseconds=250)
        for name, values, unit in (("gyro", drive.gyro, "rad/s"), ("acc", drive.accel, "m/s^2")):
            for axis, column in zip("xyz", values.T.copy(), strict=True):
                file.append([asammdf.Signal(column, drive.t, unit=unit, name=f"{name}_{axis}")])
        file.save(tmp_path / "run.mf4")

    back = _recording(imported(tmp_path / "run.mf4"))

    assert back.description.start == START + timedelta(milliseconds=250)
    _same_imu(back, drive)


def test_hundreds_of_channels_with_a_group_each_are_one_table() -> None:
    t, other = np.arange(5.0), np.arange(4.0)
    names = [f"c{i}" for i in range(300)]
    alone = [SourceTable(name, pd.DataFrame({"time_s": t, name: i + t}), {name: "V"}) for i, name in enumerate(names)]
    again = SourceTable("again", pd.DataFrame({"time_s": t, "c0": -t}))
    wide = SourceTable("wide", pd.DataFrame({"time_s": t, "a": t, "b": t}))
    late = SourceTable("late", pd.DataFrame({"time_s": other, "d": other}))

    with warnings.catch_warnings():
        warnings.simplefilter("error")  # pandas warns of frames that were put together by column
        joined = _joined([wide, *alone[:200], late, again, *alone[200:]])

    assert [(table.name, len(table.columns)) for table in joined] == [
        ("wide", 3),
        ("c0", 301),
        ("late", 2),
        ("again", 2),
    ]
    assert joined[1].columns == ["time_s", *names]
    assert joined[1].units == dict.fromkeys(names, "V")
    np.testing.assert_array_equal(joined[1].frame["c299"], 299.0 + t)


def test_a_column_of_values_that_grow_is_not_the_time_of_itself() -> None:
    table = SourceTable("key.csv", pd.DataFrame({"a": [3.0, 1.0, 2.0], "value": [1.0, 2.0, 3.0]}))
    assert with_joined_channels([table]) == [table]


def test_mdf_3_is_read(drive: Drive, tmp_path: Path, imported: Import) -> None:
    asammdf = pytest.importorskip("asammdf")
    names = [f"{name}_{axis}" for name in ("gyro", "acc") for axis in AXES]
    with asammdf.MDF(version="3.30") as file:
        values = [*drive.gyro.T.copy(), *drive.accel.T.copy()]
        file.append([asammdf.Signal(v, drive.t, name=name) for v, name in zip(values, names, strict=True)])
        file.save(tmp_path / "run.mdf")

    _same_imu(_recording(imported(tmp_path / "run.mdf")), drive)


def test_groups_of_tdms_begin_when_they_say(drive: Drive, tmp_path: Path, imported: Import) -> None:
    nptdms = pytest.importorskip("nptdms")

    def channel(group: str, name: str, unit: str, values: np.ndarray, first: int, every: int) -> Any:
        wave = {"wf_start_time": np.datetime64(int(drive.ns[first]), "ns"), "wf_increment": 0.01 * every}
        values = np.ascontiguousarray(values[first::every])
        return nptdms.ChannelObject(
            group, name, values, properties={**wave, "wf_start_offset": 0.0, "unit_string": unit}
        )

    kinds = (("gyro", "rad/s", drive.gyro), ("accel", "m/s^2", drive.accel))
    channels = [channel("IMU", f"{n} {a}", u, v[:, i], 0, 1) for n, u, v in kinds for i, a in enumerate("xyz")]
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment([*channels, channel("Tach", "wheel speed", "m/s", drive.speed, 200, 5)])

    back = _recording(imported(tmp_path / "run.tdms"))

    assert back.description.start == START
    _same_imu(back, drive)
    _rolled(back, drive)
    assert back.tach is not None
    assert back.tach["t_s"].iloc[0] == pytest.approx(2.0)


def test_sessions_of_a_data_source_follow_each_other(drive: Drive, tmp_path: Path, imported: Import) -> None:
    h5py = pytest.importorskip("h5py")
    whole = write_rcm_dx(drive, tmp_path)
    with h5py.File(whole) as source, h5py.File(tmp_path / "two.rcmdx", "w") as target:
        old = source["RCMDX/FILE/PLATFORM/SESSION/IMU/INERTIAL"]
        for session, rows in (("B", slice(900, None)), ("A", slice(0, 850))):
            new = target.create_group(f"RCMDX/FILE/PLATFORM/{session}/IMU/INERTIAL")
            new["timestamp"] = old["timestamp"][rows]
            for name in set(old) - {"timestamp"}:
                new[f"{name}/data"] = old[f"{name}/data"][rows]
                new[f"{name}/data"].attrs["Unit"] = old[f"{name}/data"].attrs["Unit"]

    back = _recording(imported(tmp_path / "two.rcmdx"))

    np.testing.assert_allclose(back.imu["t_s"], np.delete(drive.t, slice(850, 900)), atol=2e-9)


def _sentences(drive: Drive, start: datetime, *kinds: str) -> str:
    out = []
    for i, t in enumerate(drive.gnss_t.tolist()):
        at = start + timedelta(seconds=t)
        clock, day = at.strftime("%H%M%S.00"), at.strftime("%d%m%y")
        place = f"4654.{i:05d},N,00724.00000,E"
        for kind in kinds:
            if kind == "GGA":
                out.append(f"GPGGA,{clock},{place},1,10,0.9,450.0,M,50.0,M,,")
            elif kind == "RMC" or (kind == "one RMC" and i == 0):
                out.append(f"GPRMC,{clock},A,{place},10.0,90.0,{day},,,A")
        out.append("GPVTG,90.0,T,,M,19.4,N,36.0,K,A")
    return "".join(f"${text}*{reduce(lambda a, b: a ^ ord(b), text, 0):02X}\r\n" for text in out)


@pytest.mark.parametrize("kinds", [("GGA", "one RMC"), ("GGA", "RMC"), ("RMC", "GGA"), ("RMC",)])
def test_a_receiver_s_log_passes_midnight(kinds: tuple[str, ...], drive: Drive, tmp_path: Path) -> None:
    pytest.importorskip("pyubx2")
    (tmp_path / "imu.csv").write_text("time,gyro_x\n0.0,0.1\n0.1,0.1\n0.2,0.1\n")
    (tmp_path / "gps.nmea").write_text(_sentences(drive, datetime(2026, 5, 1, 23, 59, 52, tzinfo=UTC), *kinds))

    gnss = next(t for t in source_format(tmp_path).tables(tmp_path, lambda _: None) if t.name == "gnss")

    first = pd.Timestamp("2026-05-01T23:59:52Z").value
    np.testing.assert_array_equal(gnss.frame["time_ns"], first + np.round(drive.gnss_t * 1e9).astype(np.int64))
    assert (gnss.frame["sd_up_m"] == (1000.0 if kinds == ("RMC",) else 5.4)).all()
