"""Import of logs of cameras, evaluation kits and measuring programs, and of spreadsheets in other languages."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import kind_in
from trackfg.interchange.importing.conversion import Imported, converted
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import propose
from trackfg.interchange.importing.proposals.questions import Proposal
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
G, DEG = STANDARD_GRAVITY, np.pi / 180.0
INERTIAL = "gx [deg/s],gy [deg/s],gz [deg/s],ax [g],ay [g],az [g]"


def _text(path: Path, head: Sequence[str], *columns: Sequence[object], delimiter: str = ",", end: str = "") -> Path:
    path.parent.mkdir(exist_ok=True)
    rows = (
        delimiter.join(f"{cell:.8g}" if isinstance(cell, float) else str(cell) for cell in row) + end
        for row in zip(*columns, strict=True)
    )
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


def _inertial(drive: Drive) -> list[np.ndarray]:
    return [*(drive.gyro / DEG).T, *(drive.accel / G).T]


def _stamps(drive: Drive, form: str) -> list[str]:
    return [text[:-3] for text in pd.to_datetime(drive.ns).strftime(form)]


def _is_of(recording: Recording | None, drive: Drive) -> None:
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-5)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-3)
    t = recording.imu["t_s"].to_numpy()
    np.testing.assert_allclose(np.diff(t), np.diff(drive.t), atol=2e-3)
    if recording.tach is not None:
        rolled = np.interp(recording.tach["t_s"] - t[0] + drive.t[0], drive.t, np.cumsum(drive.speed) / 100.0)
        np.testing.assert_allclose(recording.tach["distance_m"], rolled - rolled[0], atol=0.2)


def _gopro(drive: Drive, folder: Path, *, named: bool) -> Path:
    stamps = [f"{stamp}Z" for stamp in _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f")]
    for key, name, unit, values in (
        ("ACCL", "Accelerometer", "m/s2", drive.accel),
        ("GYRO", "Gyroscope", "rad/s", drive.gyro),
    ):
        names = [f'"{name} ({axis}) [{unit}]"' for axis in "zxy"] if named else [f'"{name} [{unit}]"', '"1"', '"2"']
        head = ",".join(['"cts"', '"date"', *names, '"temperature [°C]"'])
        _text(folder / "go" / f"GH01-{key}.csv", [head], 1e3 * drive.t, stamps, *values[:, [2, 0, 1]].T, drive.t)
    t = drive.gnss_t
    head = '"cts","date","GPS (Lat.) [deg]","GPS (Long.) [deg]","GPS (Alt.) [m]","GPS (2D speed) [m/s]","fix"'
    fix = np.where(t < 5.0, 0, 3).tolist()
    speed, at = np.interp(t, drive.t, drive.speed), drive.ns[0] + np.round((t - drive.t[0]) * 1e9).astype(np.int64)
    dates = [f"{date}Z" for date in pd.to_datetime(at).strftime("%Y-%m-%dT%H:%M:%S.%f")]
    positions = [[f"{value:.9f}" for value in column] for column in (drive.latitude, drive.longitude, drive.height)]
    _text(folder / "go" / "GH01-GPS5.csv", [head], 1e3 * t, dates, *positions, speed, fix)
    return folder / "go"


@pytest.mark.parametrize("named", [True, False])
def test_a_gopro_gives_samples_positions_and_speeds(
    drive: Drive, imported: Import, tmp_path: Path, named: bool
) -> None:
    """Its columns come as z, x, y, in brackets or as one name before 1 and 2; ``fix`` says where it has no position."""
    axes = {"imu_axes": "FLU" if named else "UFL"}
    recording = imported(_gopro(drive, tmp_path, named=named), **axes).loaded.recording
    _is_of(recording, drive)
    assert recording is not None
    assert recording.gnss is not None
    assert len(recording.gnss) == np.count_nonzero(drive.gnss_t >= 5.0)
    assert "gnss_speed" in recording.others


def _numbered(drive: Drive, folder: Path) -> Path:
    names = [f"{name}_{i}" for name in ("AngularVelocity", "Acceleration") for i in (1, 2, 3)]
    times = [f"{t:.3f} sec" for t in drive.t]
    return _text(
        folder / "tt.csv", [",".join(["Time", *names, "WheelSpeed"])], times, *drive.gyro.T, *drive.accel.T, drive.speed
    )


def _capitals_without_times(drive: Drive, folder: Path) -> Path:
    names = [f"{axis}{name}_OUT ({unit})" for name, unit in (("GYRO", "deg/s"), ("ACCL", "g")) for axis in "XYZ"]
    head = ["Sample rate: 100 SPS", ",".join(["Count", *names, "DATA_CNTR", "VEH_V_WHL [km/h]"])]
    count = list(range(len(drive.t)))
    return _text(folder / "adis.csv", head, count, *_inertial(drive), [i % 65_536 for i in count], 3.6 * drive.speed)


def _axes_behind_colons(drive: Drive, folder: Path) -> Path:
    names = [f"IMU::{name}::{axis}[{unit}]" for name, unit in (("Gyro", "deg/s"), ("Acc", "g")) for axis in "XYZ"]
    head = ",".join(["Time[s]", *names, "Brake::WheelSpeed[km/h]"])
    return _text(folder / "can.csv", [head], drive.t, *_inertial(drive), 3.6 * drive.speed)


def _labview_without_times(drive: Drive, folder: Path) -> Path:
    head = [
        "LabVIEW Measurement\t",
        "X_Columns\tNo",
        "***End_of_Header***",
        "Channels\t7",
        "Samples" + "\t2000" * 7 + "\t",
    ]
    head += ["Y_Unit_Label" + "\tdeg/s" * 3 + "\tg" * 3 + "\tkm/h\t", "X0" + "\t0.0" * 7 + "\t"]
    head += ["Delta_X" + "\t0.010000" * 7 + "\t"]
    head += ["***End_of_Header***", "X_Value\tGyro X\tGyro Y\tGyro Z\tAcc X\tAcc Y\tAcc Z\tWheel\tComment"]
    blank = [""] * len(drive.t)
    return _text(folder / "log.lvm", head, blank, *_inertial(drive), 3.6 * drive.speed, delimiter="\t")


def _delimiters_behind_rows(drive: Drive, folder: Path) -> Path:
    head = f"t [s],{INERTIAL},wheel [km/h]"
    return _text(folder / "log.csv", [head], drive.t, *_inertial(drive), 3.6 * drive.speed, end=",,")


def _names_in_a_list(drive: Drive, folder: Path) -> Path:
    head = ["# trackbox 1.2", "# Columns: time gyro_x gyro_y gyro_z acc_x acc_y acc_z wheel_speed"]
    head.append("# Units: s deg/s deg/s deg/s g g g km/h")
    return _text(folder / "log.txt", head, drive.t, *_inertial(drive), 3.6 * drive.speed, delimiter=" ")


def _units_without_the_last(drive: Drive, folder: Path) -> Path:
    """As Inertial Explorer writes them, whose last column is a quality."""
    head = ["Source: GNSS/INS Epochs", "Time GyroX GyroY GyroZ AccX AccY AccZ WheelSpeed Q"]
    head.append("(sec) (deg/s) (deg/s) (deg/s) (g) (g) (g) (km/h)")
    ones = [1] * len(drive.t)
    return _text(folder / "ie.txt", head, drive.t, *_inertial(drive), 3.6 * drive.speed, ones, delimiter=" ")


def _spreadsheet_with_faults(drive: Drive, folder: Path) -> Path:
    speed: list[object] = [float(value) for value in 3.6 * drive.speed]
    speed[300:304] = ["#DIV/0!", "#WERT!", "#BEZUG!", "#VALUE!"]
    return _text(folder / "log.csv", [f"t [s],{INERTIAL},v Rad [km/h]"], drive.t, *_inertial(drive), speed)


def _french(drive: Drive, folder: Path) -> Path:
    times = [stamp.replace(".", ",") for stamp in _stamps(drive, "%d/%m/%Y %H:%M:%S.%f")]
    names = [
        f"{name} {axis} ({unit})"
        for name, unit in (("Vitesse angulaire", "°/s"), ("Accélération", "g"))
        for axis in "XYZ"
    ]
    head = ";".join(["Horodatage", *names, "Vitesse roue (km/h)"])
    return _text(folder / "essai.csv", [head], times, *_inertial(drive), 3.6 * drive.speed, delimiter=";")


def _russian(drive: Drive, folder: Path) -> Path:
    """Units stand behind a comma, as ISO 80000 has them in the heads of tables."""
    names = [
        f"{name} {axis}, {unit}"
        for name, unit in (("Угловая скорость", "°/с"), ("Ускорение", "м/с²"))
        for axis in "XYZ"
    ]
    head = ";".join(["Время, с", *names, "Скорость колеса, км/ч"])
    values = [*(drive.gyro / DEG).T, *drive.accel.T, 3.6 * drive.speed]
    return _text(folder / "zapis.csv", [head], drive.t, *values, delimiter=";")


def _influx(drive: Drive, folder: Path) -> Path:
    rows = np.column_stack([drive.gyro, drive.accel, drive.speed]).tolist()
    values = [[f"{stamp}Z", *row] for stamp, row in zip(_stamps(drive, "%Y-%m-%dT%H:%M:%S.%f"), rows, strict=True)]
    series = {"name": "imu", "columns": ["time", "gx", "gy", "gz", "ax", "ay", "az", "wheel_mps"], "values": values}
    (folder / "query.json").write_text(json.dumps({"results": [{"statement_id": 0, "series": [series]}]}))
    return folder / "query.json"


def _dates_in_days(drive: Drive, folder: Path) -> Path:
    """A date and a time of day that a spreadsheet has lost the formats of."""
    days = [f"{ns // 86_400_000_000_000 + 25_569}" for ns in drive.ns]
    parts = [f"{ns % 86_400_000_000_000 / 86_400e9:.10f}" for ns in drive.ns]
    head = f"Date,Time,{INERTIAL},wheel [km/h]"
    return _text(folder / "log.csv", [head], days, parts, *_inertial(drive), 3.6 * drive.speed)


def _sheet_of_text(drive: Drive, folder: Path) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Zeit [s]", *INERTIAL.split(","), "v Rad [km/h]"])
    for row in zip(drive.t, *_inertial(drive), 3.6 * drive.speed, strict=True):
        book.active.append([f"{value:.7f}".replace(".", ",") for value in row])
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


def _structs(drive: Drive, folder: Path) -> Path:
    vectors = {
        name: [dict(zip("xyz", row, strict=True)) for row in values.tolist()] for name, values in _vectors(drive)
    }
    table = pa.table(
        {"timestamp": pa.array(drive.ns, pa.timestamp("ns", tz="UTC")), **vectors, "wheel_mps": drive.speed}
    )
    pa.parquet.write_table(table, folder / "log.parquet")
    return folder / "log.parquet"


def _lists(drive: Drive, folder: Path) -> Path:
    vectors = {name: values.tolist() for name, values in _vectors(drive)}
    pa.parquet.write_table(pa.table({"t_s": drive.t, **vectors, "wheel_mps": drive.speed}), folder / "log.parquet")
    return folder / "log.parquet"


def _vectors(drive: Drive) -> list[tuple[str, np.ndarray]]:
    return [("gyro", drive.gyro), ("accel", drive.accel)]


def _compound_with_vectors(drive: Drive, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    rows = np.zeros(len(drive.t), [("time", "f8"), ("gyro", "f8", 3), ("accel", "f8", 3), ("wheel_mps", "f8")])
    for name, values in (("time", drive.t), *_vectors(drive), ("wheel_mps", drive.speed)):
        rows[name] = values
    with h5py.File(folder / "log.h5", "w") as file:
        file["imu"] = rows
    return folder / "log.h5"


def _russian_of_windows(drive: Drive, folder: Path) -> Path:
    path = _russian(drive, folder)
    path.write_bytes(path.read_text(encoding="utf-8").replace("²", "2").encode("cp1251"))
    return path


def _series_of_grafana(drive: Drive, folder: Path) -> Path:
    stamps = [f"{stamp}+00:00" for stamp in _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f")]
    named = dict(
        zip(["gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z"], [*drive.gyro.T, *drive.accel.T], strict=True)
    )
    rows = [
        (name, at, float(v))
        for name, values in (named | {"wheel_mps": drive.speed}).items()
        for at, v in zip(stamps, values, strict=True)
    ]
    return _text(folder / "grafana.csv", ['"Series";"Time";"Value"'], *zip(*rows, strict=True), delimiter=";")


@pytest.mark.parametrize(
    "write",
    [
        _numbered,
        _capitals_without_times,
        _axes_behind_colons,
        _labview_without_times,
        _delimiters_behind_rows,
        _names_in_a_list,
        _units_without_the_last,
        _spreadsheet_with_faults,
        _french,
        _russian,
        _russian_of_windows,
        _dates_in_days,
        _sheet_of_text,
        _structs,
        _lists,
        _compound_with_vectors,
        _influx,
        _series_of_grafana,
    ],
)
def test_a_log_comes_in_as_what_was_measured(
    write: Callable[[Drive, Path], Path], drive: Drive, imported: Import, tmp_path: Path
) -> None:
    recording = imported(write(drive, tmp_path), imu_gyro_unit="rad/s").loaded.recording
    _is_of(recording, drive)
    assert recording is not None
    assert recording.tach is not None


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%d_%H-%M-%S.%f",
        "%d %B %Y %H:%M:%S.%f",
        "%b %d, %Y %H:%M:%S.%f",
        "%m/%d/%y %H:%M:%S.%f",
    ],
)
def test_dates_with_words_underscores_and_short_years(
    form: str, drive: Drive, imported: Import, tmp_path: Path
) -> None:
    stamps = _stamps(drive, form)
    log = _text(tmp_path / "log.csv", [f"Time;{INERTIAL.replace(',', ';')}"], stamps, *_inertial(drive), delimiter=";")
    recording = imported(log).loaded.recording
    _is_of(recording, drive)
    assert recording is not None
    assert recording.description.start is not None
    assert recording.description.start.year == 2026


def _proposed(source: Path) -> tuple[Proposal, Sequence[SourceTable]]:
    form = source_format(source)
    tables = form.tables(source, lambda _: None)
    return propose(tables, lambda question: question.default, form.mapping(tables)), tables


def _with_speeds(drive: Drive, folder: Path, *names: str) -> Path:
    speeds = [
        3.6 * drive.speed * (1.0 if i == len(names) - 1 else 0.0) + 80.0 * (i < len(names) - 1)
        for i in range(len(names))
    ]
    return _text(folder / "log.csv", [",".join(["t [s]", INERTIAL, *names])], drive.t, *_inertial(drive), *speeds)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("wheel speed [km/h]",), ""),
        (("Speed [km/h]",), "which no name says"),
        (("v1 [km/h]",), "which no name says"),
        (("v_soll [km/h]", "v_ist [km/h]"), "which no name says"),
        (("Speed limit [km/h]", "Train speed [km/h]"), "which no name says"),
        (("Radar speed [km/h]",), "of no wheel"),
        (("Correvit v [km/h]",), "of no wheel"),
    ],
)
def test_it_is_said_what_is_taken_for_the_wheel(
    names: tuple[str, ...], said: str, drive: Drive, tmp_path: Path
) -> None:
    """Set values and limits are never taken; a column in km/h is a speed whatever its name."""
    proposal, _ = _proposed(_with_speeds(drive, tmp_path, *names))
    assert proposal.sections["tach"]["column"] == names[-1].partition(" [")[0]
    reason = proposal.reasons.get("tach.column", "")
    assert said in reason if said else not reason


@pytest.mark.parametrize(("unit", "tenths"), [("0.1 km/h", 36.0), ("0.01 km/h", 360.0), ("km/h", 3.6)])
def test_the_speed_of_a_bus_is_in_tenths_or_hundredths(unit: str, tenths: float, tmp_path: Path) -> None:
    t = np.arange(12_000) / 100.0
    acceleration = np.where(t > 10.0, 0.5 * np.sin(2.0 * np.pi * (t - 10.0) / 30.0), 0.0)
    speed = np.cumsum(acceleration) / 100.0
    noise = np.random.default_rng(5).normal(0.0, 0.02, (3, t.size))
    force = noise + np.stack([acceleration, 0.0 * t, 0.0 * t + 9.81])
    head = "t [s],gx [deg/s],gy [deg/s],gz [deg/s],ax [m/s2],ay [m/s2],az [m/s2],wheel_speed"
    cells = np.round(tenths * speed).astype(int).tolist()
    proposal, _ = _proposed(_text(tmp_path / "log.csv", [head], t, *noise, *force, cells))
    assert proposal.sections["tach"]["unit"] == unit


@pytest.mark.parametrize("of_files", [True, False])
def test_a_radar_beside_a_wheel_is_a_speed_over_ground(of_files: bool, drive: Drive, tmp_path: Path) -> None:
    if of_files:
        source = tmp_path / "run"
        _text(source / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
        for name in ("radar", "tacho"):
            _text(source / f"{name}.csv", ["t [s],v [km/h]"], drive.t, 3.6 * drive.speed)
    else:
        names = f"t [s],{INERTIAL},radar speed [km/h],wheel speed [km/h]"
        source = _text(tmp_path / "log.csv", [names], drive.t, *_inertial(drive), 3.6 * drive.speed, 3.6 * drive.speed)
    proposal, tables = _proposed(source)
    assert "radar" not in f"{proposal.sections['tach']['file']} {proposal.sections['tach']['column']}"
    (speed,) = proposal.sections["speed"]
    assert "radar" in f"{speed['file']} {speed['column']}"
    made = converted(tables, mapping_of(proposal.sections, "proposal"), run_id="log").write(tmp_path / "rec")
    assert made.loaded.recording is not None
    np.testing.assert_allclose(made.loaded.recording.others["speed/1"]["speed_mps"], drive.speed, atol=1e-6)


def test_the_speeds_of_a_file_named_after_gps_are_the_receivers(drive: Drive, tmp_path: Path) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    speed = np.interp(drive.gnss_t, drive.t, drive.speed)
    _text(tmp_path / "run" / "gps.csv", ["t [s],speed [km/h]"], drive.gnss_t, 3.6 * speed)
    proposal, _ = _proposed(tmp_path / "run")
    assert "tach" not in proposal.sections
    assert proposal.sections["gnss_speed"]["column"] == "speed"


@pytest.mark.parametrize(
    ("head", "cell"),
    [
        ("Latitude,N/S,Longitude,E/W", "{lat:.9f},S,{lon:.9f},W"),
        ("Latitude,Longitude", "{lat:.9f} S,{lon:.9f}W"),
        ("Latitude,Longitude", "S{lat:.9f},W {lon:.9f}"),
        ("Latitude,Longitude", "{lat_d}°{lat_m}'{lat_s:.6f}''S,{lon_d}°{lon_m}'{lon_s:.6f}''W"),
        ("Latitude,Longitude", "-{lat_d} {lat_m} {lat_s:.6f},-{lon_d} {lon_m} {lon_s:.6f}"),
        (
            "Lat_deg,Lat_min,Lat_sec,Lon_deg,Lon_min,Lon_sec",
            "-{lat_d},{lat_m},{lat_s:.6f},-{lon_d},{lon_m},{lon_s:.6f}",
        ),
        (
            "Lat [deg],Lat [min],Lat [s],NS,Lon [deg],Lon [min],Lon [s],EW",
            "{lat_d},{lat_m},{lat_s:.6f},S,{lon_d},{lon_m},{lon_s:.6f},W",
        ),
        ("LatDeg,LatMin,LonDeg,LonMin", "-{lat_d},{lat_mm:.8f},-{lon_d},{lon_mm:.8f}"),
    ],
)
def test_hemispheres_and_minutes_of_an_angle_are_read(
    head: str, cell: str, drive: Drive, imported: Import, tmp_path: Path
) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    cells = []
    for lat, lon in zip(drive.latitude, drive.longitude, strict=True):
        parts = {f"{name}_{key}": value for name, angle in (("lat", lat), ("lon", lon)) for key, value in _parts(angle)}
        cells.append(cell.format(lat=lat, lon=lon, **parts))
    _text(tmp_path / "run" / "gps.csv", [f"t [s],{head},Altitude [m]"], drive.gnss_t, cells, drive.height)
    made = imported(tmp_path / "run")
    place = pd.read_parquet(made.folder / "gnss.parquet")
    np.testing.assert_allclose(place.filter(like="Lat").squeeze(), -drive.latitude, atol=1e-8)
    np.testing.assert_allclose(place.filter(like="Lon").squeeze(), -drive.longitude, atol=1e-8)


def _parts(angle: float) -> list[tuple[str, float]]:
    minutes = angle % 1.0 * 60.0
    return [("d", int(angle)), ("m", int(minutes)), ("s", minutes % 1.0 * 60.0), ("mm", minutes)]


def test_degrees_minutes_and_seconds_of_inertial_explorer_are_three_cells(
    drive: Drive, imported: Import, tmp_path: Path
) -> None:
    """Its header has one name, and one unit, above the three."""
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    lines = [
        "Project:     run",
        "Program:     Inertial Explorer Version 8.90.6611",
        "",
        "   TimeS        Latitude         Longitude        H-Ell     Q",
        "  (sec)     (+/-D M S)       (+/-D M S)          (m)       ",
    ]
    for t, lat, lon, height in zip(drive.gnss_t, drive.latitude, drive.longitude, drive.height, strict=True):
        angles = "  ".join("-{d} {m:02d} {s:08.5f}".format(**dict(_parts(angle))) for angle in (lat, lon))
        lines.append(f"  {t:.2f}  {angles}  {height:.3f}  1")
    (tmp_path / "run" / "trajectory.txt").write_text("\n".join(lines) + "\n\n")
    made = imported(tmp_path / "run")
    place = pd.read_parquet(made.folder / "gnss.parquet")
    np.testing.assert_allclose(place.filter(like="Latitude").squeeze(), -drive.latitude, atol=1e-8)
    np.testing.assert_allclose(place.filter(like="Longitude").squeeze(), -drive.longitude, atol=1e-8)


def test_an_error_in_metres_is_no_minute(drive: Drive, imported: Import, tmp_path: Path) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    head = "t [s],Latitude [deg],Latitude Error [m],Longitude [deg],Longitude Error [m]"
    error = np.full(drive.gnss_t.size, 1.5)
    _text(tmp_path / "run" / "gps.csv", [head], drive.gnss_t, drive.latitude, error, drive.longitude, error)
    made = imported(tmp_path / "run")
    place = pd.read_parquet(made.folder / "gnss.parquet")
    np.testing.assert_allclose(place["Latitude"], drive.latitude, atol=1e-6)


def test_minutes_beside_0_degrees_have_no_sign(drive: Drive, imported: Import, tmp_path: Path) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    head = "t [s],Lat_deg,Lat_min,Lon_deg,Lon_min"
    minutes = [(angle % 1.0) * 60.0 for angle in (drive.latitude, drive.longitude)]
    west = ["-0"] * drive.gnss_t.size
    _text(tmp_path / "run" / "gps.csv", [head], drive.gnss_t, [46] * len(west), minutes[0], west, minutes[1])
    with pytest.raises(BadInputError, match="0 degrees beside minutes have no sign; expected a letter of EW"):
        imported(tmp_path / "run")


@pytest.mark.parametrize(
    ("names", "power", "has_speed", "unit"),
    [
        (("lat", "lon"), 7, False, "1e-7 deg"),
        (("lat", "lon"), 6, True, "1e-6 deg"),
        (("lat", "lon"), 5, True, "1e-5 deg"),
        (("latitudeE6", "longitudeE6"), 6, False, "1e-6 deg"),
        (("lat", "lon"), None, False, "rad"),
    ],
)
def test_the_unit_of_positions_is_that_with_which_they_move_as_they_do(
    names: tuple[str, str], power: int | None, has_speed: bool, unit: str, drive: Drive, tmp_path: Path
) -> None:
    """Radians as degrees would lie in the Gulf of Guinea; whole numbers may be of several powers of ten."""
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    plan = [drive.latitude, drive.longitude]
    cells = [[f"{a * DEG:.12f}" if power is None else f"{a * 10**power:.0f}" for a in column] for column in plan]
    speed = [np.interp(drive.gnss_t, drive.t, drive.speed)] if has_speed else []
    head = ",".join(["t [s]", *names, "alt [m]", *["speed [m/s]"] * has_speed])
    _text(tmp_path / "run" / "gps.csv", [head], drive.gnss_t, *cells, drive.height, *speed)
    proposal, _ = _proposed(tmp_path / "run")
    assert proposal.sections["gnss"]["position_unit"] == unit


def test_whole_numbers_whose_power_of_ten_nothing_shows_are_asked(
    drive: Drive, imported: Import, tmp_path: Path
) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    cells = [[f"{a * 1e6:.0f}" for a in column] for column in (drive.latitude, drive.longitude)]
    _text(tmp_path / "run" / "gps.csv", ["t [s],lat,lon,alt [m]"], drive.gnss_t, *cells, drive.height)
    made = imported(tmp_path / "run", gnss_position_unit="1e-6 deg")
    np.testing.assert_allclose(pd.read_parquet(made.folder / "gnss.parquet")["lat"], drive.latitude, atol=1e-6)


def test_places_at_a_steady_rate_are_no_fixes(drive: Drive, tmp_path: Path) -> None:
    """Another system has computed them, so that their errors are no errors of each by itself."""
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    km = 12.0 + np.cumsum(drive.speed) / 1e5
    _text(tmp_path / "run" / "place.csv", ["t [s],km"], drive.t[::10], [f"{place:.5f}" for place in km[::10]])
    proposal, _ = _proposed(tmp_path / "run")
    assert "fixes" not in proposal.sections
    assert "computed" in proposal.reasons["fixes"]


def test_a_depth_below_the_origin_is_a_height(drive: Drive, imported: Import, tmp_path: Path) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    t = drive.gnss_t
    _text(tmp_path / "run" / "pos.csv", ["t_s,north_m,east_m,down_m"], t, 3.0 * t, 0.0 * t, -0.5 * t)
    recording = imported(tmp_path / "run").loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    np.testing.assert_allclose(np.diff(recording.gnss["up_m"]), 0.5 * np.diff(recording.gnss["t_s"]), atol=1e-6)


def test_a_height_of_0_of_a_fix_in_two_dimensions_says_nothing(drive: Drive, imported: Import, tmp_path: Path) -> None:
    _text(tmp_path / "run" / "imu.csv", [f"t [s],{INERTIAL}"], drive.t, *_inertial(drive))
    height = np.where(drive.gnss_t < 8.0, 0.0, 500.0)
    places = [[f"{value:.9f}" for value in column] for column in (drive.latitude, drive.longitude)]
    _text(tmp_path / "run" / "gps.csv", ["t [s],lat,lon,alt [m]"], drive.gnss_t, *places, height)
    recording = imported(tmp_path / "run").loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    assert (recording.gnss["up_sd_m"].to_numpy() > 100.0).tolist() == (height == 0.0).tolist()


def test_filtered_and_coarse_sensors_are_the_last_to_be_proposed(drive: Drive, tmp_path: Path) -> None:
    kinds = [f"{name}_{axis}" for name in ("gyro_filt", "gyro", "acc_hg", "acc") for axis in "xyz"]
    values = [*drive.gyro.T, *drive.gyro.T, *drive.accel.T, *drive.accel.T]
    proposal, _ = _proposed(_text(tmp_path / "log.csv", [",".join(["t_s", *kinds])], drive.t, *values))
    assert proposal.sections["imu"]["gyro"] == ["gyro_x", "gyro_y", "gyro_z"]
    assert proposal.sections["imu"]["accel"] == ["acc_x", "acc_y", "acc_z"]


def test_an_accuracy_across_is_no_acceleration() -> None:
    frame = pd.DataFrame({"Horiz Acc": [1.0], "Vert Acc (g)": [1.0], "Horizontal accuracy": [1.0]})
    table = SourceTable("log.csv", frame)
    assert [kind_in(table, name) for name in table.columns] == ["sd_horizontal", "accel", "sd_horizontal"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.00,1,2,3\n0.01,1,2,3\n0.02,1,2,3\n", "no row of names of columns"),
        ("Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2\n1,100,false,Rx,0,2,0A,0B\n2,100,false,Rx,0,2,0A,0B\n", "raw CAN"),
        (
            "#BESTPOSA,COM1,0,78.5,FINESTEERING,2387,4.00,02000020,b1f6,16809;SOL_COMPUTED*b6\n%RAWIMUSA,2387,4.0;1*c0\n",
            "NovAtel in ASCII",
        ),
        ("t,yaw rate,ax,ay,az\n" + "".join(f"{i},0,0,0,9.8\n" for i in range(30)), "yaw rate alone: all three axes"),
        ("t,roll,pitch,ax,ay,az\n" + "".join(f"{i},0,0,0,0,9.8\n" for i in range(30)), "roll, pitch: angles"),
        ("t,gyro_x,gyro_y,gyro_z,FreeAcc_E,FreeAcc_N\n" + "".join(f"{i},0,0,0.1,0,0\n" for i in range(30)), "gravity"),
    ],
)
def test_what_is_not_read_is_refused_by_what_it_is(text: str, said: str, imported: Import, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(BadInputError, match=said):
        imported(tmp_path / "log.csv")
