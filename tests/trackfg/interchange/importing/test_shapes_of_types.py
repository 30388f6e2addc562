"""Formats whose columns have types, such as Parquet and MDF, come in the shapes and notations that text comes in."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest
from interchange.foreign_forms import Drive

from trackfg.interchange.importing.columns.calendar_columns import COMPOSED, with_whole_dates
from trackfg.interchange.importing.columns.time_columns import time_columns
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.delimited.written_numbers import with_numbers
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.shapes.array_tables import tables_of_arrays
from trackfg.interchange.importing.shapes.binary_points import points_of, systems_of
from trackfg.interchange.importing.shapes.channel_tables import by_sensor
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.messages import measured_ns
from trackfg.numerics import geodesy
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
Tables = dict[str, dict[str, np.ndarray | list[str]]]


def _parquet(tables: Tables, folder: Path) -> Path:
    for name, columns in tables.items():
        pd.DataFrame(columns).to_parquet(folder / f"{name}.parquet")
    return folder


def _sqlite(tables: Tables, folder: Path) -> Path:
    with sqlite3.connect(folder / "log.db") as connection:
        for name, columns in tables.items():
            pd.DataFrame(columns).to_sql(name, connection, index=False)
    return folder / "log.db"


def _json(tables: Tables, folder: Path) -> Path:
    records = {name: pd.DataFrame(columns).to_dict(orient="records") for name, columns in tables.items()}
    (folder / "log.json").write_text(json.dumps(records))
    return folder / "log.json"


def _xlsx(tables: Tables, folder: Path) -> Path:
    with pd.ExcelWriter(folder / "log.xlsx") as book:
        for name, columns in tables.items():
            pd.DataFrame(columns).to_excel(book, sheet_name=name, index=False)
    return folder / "log.xlsx"


def _hdf5(tables: Tables, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "log.h5", "w") as file:
        for name, columns in tables.items():
            for column, values in columns.items():
                text = isinstance(values, list)
                file.create_dataset(f"{name}/{column}", data=values, dtype=h5py.string_dtype() if text else None)
    return folder / "log.h5"


def _matlab(tables: Tables, folder: Path) -> Path:
    from scipy.io import savemat

    content = {
        name: {
            column: np.array(values, dtype=object)[:, None] if isinstance(values, list) else values[:, None]
            for column, values in columns.items()
        }
        for name, columns in tables.items()
    }
    savemat(folder / "log.mat", content)
    return folder / "log.mat"


def _mdf(tables: Tables, folder: Path) -> Path:
    asammdf = pytest.importorskip("asammdf")
    log = asammdf.MDF(version="4.10")
    for columns in tables.values():
        times = np.asarray(columns["unix_time"], dtype=np.float64)
        log.append(
            [
                asammdf.Signal(
                    np.array([cell.encode() for cell in values]) if isinstance(values, list) else values,
                    times - 1_777_605_120.0,
                    name=name,
                    encoding="utf-8" if isinstance(values, list) else None,
                )
                for name, values in columns.items()
                if name != "unix_time"
            ]
        )
    log.start_time = pd.Timestamp(1_777_605_120, unit="s", tz="UTC").to_pydatetime()
    log.save(folder / "log.mf4")
    log.close()
    return folder / "log.mf4"


def _tdms(tables: Tables, folder: Path) -> Path:
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject(name, column, values)
        for name, columns in tables.items()
        for column, values in columns.items()
    ]
    with nptdms.TdmsWriter(folder / "log.tdms") as writer:
        writer.write_segment(channels)
    return folder / "log.tdms"


def _mcap(tables: Tables, folder: Path) -> Path:
    writing = pytest.importorskip("mcap.writer")
    with (folder / "log.mcap").open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        schema = writer.register_schema("log", "jsonschema", b"{}")
        for name, columns in tables.items():
            topic = writer.register_channel(f"/{name}", "json", schema)
            for row in pd.DataFrame(columns).to_dict(orient="records"):
                ns = round(row.pop("unix_time") * 1e9)
                writer.add_message(topic, log_time=ns, publish_time=ns, data=json.dumps(row).encode())
        writer.finish()
    return folder / "log.mcap"


WRITERS = [_parquet, _sqlite, _json, _xlsx, _hdf5, _matlab, _mdf, _tdms, _mcap]


def _imu(drive: Drive) -> dict[str, np.ndarray | list[str]]:
    columns: dict[str, np.ndarray | list[str]] = {"unix_time": drive.ns / 1e9}
    columns |= {f"gyro_{axis}": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    return columns | {f"acc_{axis}": drive.accel[:, i] for i, axis in enumerate("xyz")}


def _recording(made: Imported, drive: Drive) -> Recording:
    recording = made.loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-9)
    assert recording.description.start is not None
    return recording


@pytest.mark.parametrize("write", WRITERS)
def test_positions_from_the_centre_of_the_earth(
    write: Callable[[Tables, Path], Path], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    ecef = geodesy.geodetic_to_ecef(np.stack([drive.latitude, drive.longitude, drive.height], axis=1))
    places = {"unix_time": drive.gnss_ns / 1e9} | {f"ecef_{axis}": ecef[:, i] for i, axis in enumerate("xyz")}
    source = tmp_path / "log"
    source.mkdir()
    recording = _recording(imported(write({"imu": _imu(drive), "gnss": places}, source)), drive)
    assert recording.gnss is not None
    north = np.interp(recording.gnss["t_s"], drive.gnss_t, drive.latitude - drive.latitude[-1]) * np.radians(
        6_372_000.0
    )
    moved = recording.gnss["north_m"] - recording.gnss["north_m"].iloc[-1]
    np.testing.assert_allclose(moved, north, atol=0.3)


@pytest.mark.parametrize("write", WRITERS)
def test_points_in_text_and_numbers_with_a_decimal_comma(
    write: Callable[[Tables, Path], Path], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    points = [f"POINT({x:.9f} {y:.9f})" for x, y in zip(drive.longitude, drive.latitude, strict=True)]
    heights = [f"{height + 0.25 * i:.2f}".replace(".", ",") for i, height in enumerate(drive.height)]
    places: dict[str, np.ndarray | list[str]] = {"unix_time": drive.gnss_ns / 1e9, "place": points, "height_m": heights}
    source = tmp_path / "log"
    source.mkdir()
    recording = _recording(imported(write({"imu": _imu(drive), "gnss": places}, source)), drive)
    assert recording.gnss is not None
    assert len(recording.gnss) == len(points)
    np.testing.assert_allclose(np.diff(recording.gnss["up_m"]), 0.25, atol=1e-6)


@pytest.mark.parametrize("write", WRITERS)
def test_numbers_that_stand_for_none(
    write: Callable[[Tables, Path], Path], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    speeds = np.where(np.arange(drive.t.size) % 10 == 0, drive.speed * 3.6, -9999.0)
    source = tmp_path / "log"
    source.mkdir()
    recording = _recording(imported(write({"imu": {**_imu(drive), "wheel_speed_kmh": speeds}}, source)), drive)
    assert recording.tach is not None
    assert np.ptp(recording.tach["distance_m"]) == pytest.approx(np.trapezoid(drive.speed, drive.t), rel=0.02)


def _point(x: float, y: float, z: float, kind: str) -> bytes:
    head = {"iso": (1001,), "flat": (1,), "postgis": (0xA0000001, 4326)}[kind]
    numbers = (x, y) if kind == "flat" else (x, y, z)
    return struct.pack(f"<B{len(head)}I{len(numbers)}d", 1, *head, *numbers)


@pytest.mark.parametrize("kind", ["iso", "flat", "postgis"])
def test_points_in_bytes_of_geoparquet(kind: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _parquet({"imu": _imu(drive)}, source)
    places = zip(drive.longitude, drive.latitude, drive.height, strict=True)
    points = [_point(*place, kind) for place in places]
    pd.DataFrame({"unix_time": drive.gnss_ns / 1e9, "geometry": points}).to_parquet(source / "gnss.parquet")
    recording = _recording(imported(source), drive)
    assert recording.gnss is not None
    assert recording.gnss_origin is not None
    assert recording.gnss_origin[0] == pytest.approx(drive.latitude[0], abs=1e-3)


def test_bytes_that_are_no_points_are_named(tmp_path: Path) -> None:
    table = pa.table({"t": [0.0, 0.1], "image": [b"abc", b"de"], "spectrum": [[1.0, 2.0], [3.0]]})
    pa.parquet.write_table(table, tmp_path / "log.parquet")
    (read,) = source_format(tmp_path / "log.parquet").tables(tmp_path / "log.parquet", lambda _: None)
    assert read.columns == ["t"]
    assert read.notes == ("log.parquet: columns of lists or bytes are not read: image, spectrum",)


def test_the_reference_system_of_geoparquet_is_that_of_its_metadata() -> None:
    geo = {"columns": {"a": {"crs": {"id": {"authority": "EPSG", "code": 25832}}}, "b": {}, "c": {"crs": None}}}
    assert systems_of({b"geo": json.dumps(geo).encode()}) == {"a": {"25832"}, "b": set(), "c": set()}
    assert systems_of(None) == {}
    cells = [struct.pack("<BI2d", 1, 1, 400_000.0, 5_200_000.0), None]
    named = points_of(cells, {"25832"})
    assert named is not None
    assert list(named) == ["easting EPSG:25832", "northing EPSG:25832"]
    assert points_of([b"\x01\x02\x00\x00\x00" + bytes(16)], set()) is None  # a line


def test_a_spreadsheet_states_its_sampling_rate_above_the_names(drive: Drive, tmp_path: Path, imported: Import) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    names = [f"{sensor} {axis} [{unit}]" for sensor, unit in (("Gyro", "rad/s"), ("Acc", "m/s2")) for axis in "XYZ"]
    for row in (["Logger 7"], ["Sampling rate: 100 Hz"], ["Packet", *names]):
        book.active.append(row)
    for i, row in enumerate(np.hstack([drive.gyro, drive.accel]).tolist()):
        book.active.append([(i + 65_000) % 65_536, *row])
    book.save(tmp_path / "log.xlsx")
    recording = imported(tmp_path / "log.xlsx").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(np.diff(recording.imu["t_s"]), 0.01, atol=1e-9)
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-9)


def test_an_array_of_six_columns_may_be_dates(drive: Drive) -> None:
    dates = pd.to_datetime(drive.ns)
    parts = [dates.year, dates.month, dates.day, dates.hour, dates.minute, dates.second + dates.microsecond / 1e6]
    (table,) = tables_of_arrays({"time": np.stack(parts, axis=1).astype(np.float64), "gyro": drive.gyro}, "log.mat")
    assert table.columns == ["year", "month", "day", "hour", "minute", "second", "gyro x", "gyro y", "gyro z"]
    (table,) = tables_of_arrays({"wheels": np.full((5, 6), 3.5)}, "log.mat")
    assert table.columns[0] == "wheels 1"


@pytest.mark.parametrize(
    ("cells", "values"),
    [
        (["0,25", "-1.234,5", "NaN"], [0.25, -1234.5, np.nan]),
        (["0.25", "1,234.5", ""], [0.25, 1234.5, np.nan]),
        (["12", "-7", "N/A"], [12.0, -7.0, np.nan]),
        (["\u22120.5", "0.5", "1e-3"], [-0.5, 0.5, 1e-3]),
    ],
)
def test_numbers_as_text_are_numbers(cells: list[str], values: list[float]) -> None:
    table = with_numbers(SourceTable("log", pd.DataFrame({"v": pd.Series(cells, dtype="string")})))
    np.testing.assert_array_equal(table.numbers("v"), values)


@pytest.mark.parametrize("cells", [["1,234", "5,678"], ["0012", "x7"], ["05:12:00", "05:12:01"]])
def test_what_may_be_no_number_stays_text(cells: list[str]) -> None:
    table = SourceTable("log", pd.DataFrame({"v": pd.Series(cells, dtype="string")}))
    assert with_numbers(table) is table


def test_names_of_balises_stay_as_they_are_written() -> None:
    table = SourceTable("log", pd.DataFrame({"balise_id": pd.Series(["00123", "00124"], dtype="string")}))
    assert with_numbers(table) is table


def test_times_in_ns_as_text_keep_their_digits() -> None:
    text = pd.Series(["1777605120000000001", "1777605120010000003"], dtype="string")
    table = with_numbers(SourceTable("log", pd.DataFrame({"time_ns": text})))
    assert table.frame["time_ns"].tolist() == [1777605120000000001, 1777605120010000003]


@pytest.mark.parametrize("unit", ["A", ""])
def test_a_current_is_no_number_of_a_sensor(unit: str) -> None:
    column = np.arange(400) * 7 % (2 if unit else 37)
    table = SourceTable("log", pd.DataFrame({"t": np.arange(400) / 100.0, "I": column, "v": 0.5}), {"I": unit})
    assert by_sensor(table) == [table]


def test_a_date_of_whole_seconds_gives_way_to_a_finer_time() -> None:
    t = np.arange(500) / 100.0
    parts = {"year": 2026, "month": 5, "day": 1, "hour": 3, "minute": 12, "second": np.floor(t).astype(np.int64)}
    dated = with_whole_dates(SourceTable("log", pd.DataFrame(parts, index=range(t.size))))
    assert time_columns(dated) == (COMPOSED,)
    fine = with_whole_dates(SourceTable("log", pd.DataFrame({"time_s": t, **parts})))
    assert time_columns(fine) == ("time_s",)


@pytest.mark.parametrize(
    ("stamp", "is_taken"),
    [
        (1_777_605_120.25, True),
        (1_777_605_120_250, True),
        (1_777_605_120_250_000, True),
        ("2026-05-01T03:12:00.250Z", True),
        ("2026-05-01T05:12:00.250", False),  # of another zone
        (12.5, False),
        (True, False),
        ("start", False),
    ],
)
def test_a_message_may_state_its_time_as_a_number_or_a_text(stamp: object, is_taken: bool) -> None:
    received = 1_777_605_120_700_000_000
    measured = measured_ns({"timestamp": stamp, "gyro": [0.0, 0.0, 0.0]}, received)
    assert measured == pytest.approx(received - 450_000_000 if is_taken else received, abs=1_000, rel=0.0)
