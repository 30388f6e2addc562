"""Import of logs of inertial units, receivers, data loggers and flight controllers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import kind_in
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.proposal import propose_columns
from trackfg.interchange.importing.proposals.questions import Proposal, Question
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
G, DEG = STANDARD_GRAVITY, np.pi / 180.0
START = datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
GPS_NS = 315_964_800_000_000_000 - 18_000_000_000
"""The epoch of GPS, 1980-01-06, less its leap seconds, ns since 1970."""


def _text(
    path: Path, head: Sequence[str], *columns: Sequence[object], delimiter: str = ",", encoding: str = "utf-8"
) -> Path:
    path.parent.mkdir(exist_ok=True)
    rows = (
        delimiter.join(f"{cell:.9g}" if isinstance(cell, float) else str(cell) for cell in row)
        for row in zip(*columns, strict=True)
    )
    path.write_text("\n".join([*head, *rows]) + "\n", encoding=encoding)
    return path


def _rates(drive: Drive) -> list[np.ndarray]:
    return list((drive.gyro / DEG).T)


def _forces(drive: Drive) -> list[np.ndarray]:
    return list((drive.accel / G).T)


def _stamps(drive: Drive, form: str, hours: int = 0) -> list[str]:
    return [text[:-3] for text in pd.to_datetime(drive.ns + hours * 3_600_000_000_000).strftime(form)]


def _local_clock(drive: Drive) -> list[str]:
    return _stamps(drive, "%H:%M:%S.%f", hours=2)


def _with_commas(values: Sequence[float]) -> list[str]:
    return [f"{value:.8f}".replace(".", ",") for value in values]


def _is_of(recording: Recording | None, drive: Drive, *, dated: bool) -> None:
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=4e-5)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=2e-3)
    t = recording.imu["t_s"].to_numpy()
    assert recording.description.start == (START if dated else None)
    np.testing.assert_allclose(t - (0.0 if dated else t[0]), drive.t, atol=1e-4)


def _proposed(source: Path) -> tuple[Proposal, list[str]]:
    """Return what is proposed of a source, and the keys of what was asked."""
    keys: list[str] = []

    def answer(question: Question) -> str:
        keys.append(question.key)
        return question.default

    form = source_format(source)
    tables = list(form.tables(source, lambda _: None))
    return propose_columns(tables, answer, form.mapping(tables)), keys


def _two_clocks(drive: Drive, folder: Path) -> Path:
    """MetaWear writes a file for each sensor, in which dates stand beside seconds since its own first sample."""
    stamps = _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f", hours=2)
    for kind, unit, columns in (("Gyroscope", "deg/s", _rates(drive)), ("Accelerometer", "g", _forces(drive))):
        head = f"epoc (ms),timestamp (+0200),elapsed (s),x-axis ({unit}),y-axis ({unit}),z-axis ({unit})"
        _text(folder / "mw" / f"MetaWear_C1_{kind}_100Hz.csv", [head], drive.ns // 1_000_000, stamps, drive.t, *columns)
    return folder / "mw"


def _offset_in_the_name(drive: Drive, folder: Path) -> Path:
    head = "timestamp (+0200),elapsed (s),gx (deg/s),gy (deg/s),gz (deg/s),ax (g),ay (g),az (g)"
    stamps = _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f", hours=2)
    return _text(folder / "log.csv", [head], stamps, drive.t, *_rates(drive), *_forces(drive))


def _seconds_and_microseconds(drive: Drive, folder: Path) -> Path:
    """Spatial Manager of Advanced Navigation writes the Unix time and what is beyond it."""
    head = "Unix Time,Microseconds,Accelerometer X,Accelerometer Y,Accelerometer Z,Gyroscope X,Gyroscope Y,Gyroscope Z"
    seconds, rest = np.divmod(drive.ns // 1000, 1_000_000)
    return _text(folder / "RawSensors.csv", [head], seconds, rest, *drive.accel.T, *drive.gyro.T)


def _nanoseconds_of_gps(drive: Drive, folder: Path) -> Path:
    """VectorNav counts from 1980 in ns, and has what its sensors give before they are compensated, too."""
    units = {"UncompGyro": "rad/s", "UncompAccel": "m/s^2", "Gyro": "rad/s", "Accel": "m/s^2"}
    names = [f"{name}.{axis} [{unit}]" for name, unit in units.items() for axis in "XYZ"]
    raw = [*(drive.gyro + 0.01).T, *(drive.accel + 0.1).T]
    since_boot, of_gps = (drive.t * 1e9).astype(np.int64), drive.ns - GPS_NS
    head = ",".join(["TimeStartup [ns],TimeGps [ns]", *names])
    return _text(folder / "vn.csv", [head], since_boot, of_gps, *raw, *drive.gyro.T, *drive.accel.T)


def _french_day_of_the_year(drive: Drive, folder: Path) -> Path:
    axes = [f"Gyro {axis} (°/s)" for axis in "XYZ"] + [f"Acc {axis} (m/s²)" for axis in "XYZ"]
    parts = [[value] * drive.t.size for value in (2026, 121, 3, 12)]
    values = [_with_commas(column) for column in (drive.t, *_rates(drive), *drive.accel.T)]
    head = "\t".join(["Année\tJour\tHeure\tMinute\tSeconde", *axes])
    return _text(folder / "essai.txt", [head], *parts, *values, delimiter="\t", encoding="utf-16")


def _noon_among_blanks(drive: Drive, folder: Path) -> Path:
    clock = [f"{text} AM" for text in _stamps(drive, "%I:%M:%S.%f")]
    head = "Date  Time  RateX_deg/s  RateY_deg/s  RateZ_deg/s  AccX_g  AccY_g  AccZ_g"
    dates = ["01-May-2026"] * drive.t.size
    return _text(folder / "log.prn", [head], dates, clock, *_rates(drive), *_forces(drive), delimiter="   ")


@pytest.mark.parametrize(
    "write",
    [
        _two_clocks,
        _offset_in_the_name,
        _seconds_and_microseconds,
        _nanoseconds_of_gps,
        _french_day_of_the_year,
        _noon_among_blanks,
    ],
)
def test_a_log_keeps_its_date(
    write: Callable[[Drive, Path], Path], drive: Drive, imported: Import, tmp_path: Path
) -> None:
    _is_of(imported(write(drive, tmp_path)).loaded.recording, drive, dated=True)


def _rates_of_aircraft(drive: Drive, folder: Path) -> Path:
    """EvalTool of Inertial Sense calls its arrays after the letters of the rates."""
    names = [f"I.{name}[{i}]" for name in ("pqr", "acc") for i in range(3)]
    return _text(folder / "LOG_imu.csv", [",".join(["time", *names])], drive.t, *drive.gyro.T, *drive.accel.T)


def _increments_of_px4(drive: Drive, folder: Path) -> Path:
    """``vehicle_imu`` of PX4 has increments beside their intervals, and counts of calibrations that are no wheel's."""
    names = [f"{name}[{i}]" for name in ("delta_angle", "delta_velocity") for i in range(3)]
    head = ["timestamp", *names, "delta_angle_dt", "delta_velocity_dt", "accel_calibration_count"]
    us, ones = (1e6 * drive.t).round().astype(int), np.ones(drive.t.size, dtype=int)
    increments = [*(0.01 * drive.gyro).T, *(0.01 * drive.accel).T]
    intervals = [10_000 * ones, 10_000 * ones]
    return _text(folder / "log_vehicle_imu_0.csv", [",".join(head)], us, *increments, *intervals, ones)


def _frame_behind_the_axis(drive: Drive, folder: Path) -> Path:
    """NAVgraph of OXTS has a letter for the frame behind that of the axis: of the vehicle."""
    units = {"Acceleration": "m/s²", "Angular rate": "deg/s"}
    names = [f"{name} {axis}v ({unit})" for name, unit in units.items() for axis in "XYZ"]
    return _text(folder / "nav.csv", [",".join(["Time (s)", *names])], drive.t, *drive.accel.T, *_rates(drive))


def _channel_numbers_below_names(drive: Drive, folder: Path) -> Path:
    names = [f"Drehrate {a} [°/s]" for a in "XYZ"] + [f"Beschleunigung {a} [m/s²]" for a in "XYZ"]
    head = ["Messdatei: fahrt.bin", "", "\t".join(["Zeit [s]", *names]), "\t".join(f"CH{i}" for i in range(1, 8))]
    values = [_with_commas(column) for column in (drive.t, *_rates(drive), *drive.accel.T)]
    return _text(folder / "fahrt.asc", head, *values, delimiter="\t", encoding="cp1252")


def _scales_of_counts(drive: Drive, folder: Path) -> Path:
    """GCSV of Gyroflow states what a tick and a count of each sensor are worth."""
    head = ["GYROFLOW IMU LOG", "version,1.3", "orientation,XYZ", "tscale,0.0001", "gscale,5e-5", "ascale,0.0001"]
    rates, forces = (drive.gyro / 5e-5).round().astype(int), (drive.accel / G / 1e-4).round().astype(int)
    ticks = (1e4 * drive.t).round().astype(int)
    return _text(folder / "cam.gcsv", [*head, "t,gx,gy,gz,ax,ay,az"], ticks, *rates.T, *forces.T)


def _sentences_of_a_sketch(drive: Drive, folder: Path) -> Path:
    """Examples of Adafruit print a line for each sensor, whose last number has the unit, and an empty one."""
    lines = []
    for stamp, rate, force in zip(_stamps(drive, "%H:%M:%S.%f"), drive.gyro, drive.accel, strict=True):
        for name, (x, y, z), unit in (("Acceleration", force, "m/s^2"), ("Rotation", rate, "rad/s")):
            lines.append(f"{stamp} -> {name} X: {x:.7f}, Y: {y:.7f}, Z: {z:.7f} {unit}")
        lines += [f"{stamp} -> Temperature: 25.10 degC", f"{stamp} -> "]
    return _text(folder / "monitor.txt", lines)


def _dictionaries_of_python(drive: Drive, folder: Path) -> Path:
    axes = [[dict(zip("xyz", row, strict=True)) for row in values.tolist()] for values in (drive.gyro, drive.accel)]
    rows = zip(drive.t.tolist(), *axes, strict=True)
    return _text(folder / "log.txt", [str({"t": t, "gyro": rate, "accel": force}) for t, rate, force in rows])


def _units_in_messages(drive: Drive, folder: Path) -> Path:
    lines = []
    for t, rate, force in zip(drive.t, (drive.gyro / DEG).tolist(), drive.accel.tolist(), strict=True):
        for topic, vector, unit in (("imu/gyro", rate, "deg/s"), ("imu/acc", force, "m/s2")):
            lines.append(json.dumps({"topic": topic, "payload": {"t": round(t, 3), "v": vector, "unit": unit}}))
    return _text(folder / "mqtt.jsonl", lines)


@pytest.mark.parametrize(
    "write",
    [
        _sentences_of_a_sketch,
        _dictionaries_of_python,
        _units_in_messages,
        _rates_of_aircraft,
        _increments_of_px4,
        _frame_behind_the_axis,
        _channel_numbers_below_names,
        _scales_of_counts,
    ],
)
def test_names_of_instruments_are_known(
    write: Callable[[Drive, Path], Path], drive: Drive, imported: Import, tmp_path: Path
) -> None:
    recording = imported(write(drive, tmp_path)).loaded.recording
    _is_of(recording, drive, dated=False)
    assert recording is not None
    assert recording.tach is None


def test_a_date_takes_the_place_of_no_clock_that_it_does_not_go_with(
    drive: Drive, imported: Import, tmp_path: Path
) -> None:
    """Dates of when a computer received the samples are no times of theirs."""
    received = drive.ns + np.random.default_rng(1).integers(0, 9_000_000, drive.t.size)
    dates = pd.to_datetime(received).strftime("%Y-%m-%d %H:%M:%S.%f")
    head = "pc_time,tow(sec),gx(rad/s),gy(rad/s),gz(rad/s),ax(g),ay(g),az(g)"
    log = _text(tmp_path / "log.csv", [head], dates, drive.t, *drive.gyro.T, *_forces(drive))
    _is_of(imported(log).loaded.recording, drive, dated=False)


def test_accuracies_in_other_units_become_metres(drive: Drive, imported: Import, tmp_path: Path) -> None:
    head = "t [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [g],ay [g],az [g]"
    _text(tmp_path / "log" / "imu.csv", [head], drive.t, *drive.gyro.T, *_forces(drive))
    places = [[f"{value:.9f}" for value in column] for column in (drive.latitude, drive.longitude, drive.height)]
    head = "t [s],lat,lon,alt [m],HAccuracy [0.01 m],v_accuracy(cm)"
    cells = [[2] * drive.gnss_t.size, [3] * drive.gnss_t.size]
    _text(tmp_path / "log" / "pos.csv", [head], drive.gnss_t, *places, *cells)
    recording = imported(tmp_path / "log").loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    sigmas = recording.gnss[["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy()
    np.testing.assert_allclose(sigmas, np.broadcast_to([0.02, 0.02, 0.03], sigmas.shape))
    assert "gnss_speed" not in recording.others


@pytest.mark.parametrize(
    ("name", "kind"), [("v_accuracy(meters)", "sd_vertical"), ("velocity [m]", None), ("v (m/s)", "speed")]
)
def test_an_accuracy_and_a_length_are_no_speeds(name: str, kind: str | None) -> None:
    assert kind_in(SourceTable("log.csv", pd.DataFrame({name: [1.0, 2.0]})), name) == kind


@pytest.mark.parametrize(
    ("name", "kind"), [("GPS.Lat", "latitude"), ("GPS.Lng", "longitude"), ("accel_calibration_count", None)]
)
def test_names_of_flight_controllers(name: str, kind: str | None) -> None:
    assert meaning(name) == kind


INERTIAL = "gx [deg/s];gy [deg/s];gz [deg/s];ax [g];ay [g];az [g]"


@pytest.mark.parametrize("form", ["date", "unix"])
def test_times_of_day_are_of_the_zone_of_the_dates_beside_them(
    form: str, drive: Drive, imported: Import, tmp_path: Path
) -> None:
    """Their zone is asked where dates beside them say that they are on the calendar."""
    dates = _stamps(drive, "%d.%m.%Y %H:%M:%S.%f", hours=2) if form == "date" else list(drive.ns // 1_000_000)
    _text(tmp_path / "run" / "imu.csv", [f"Datum;{INERTIAL}"], dates, *_rates(drive), *_forces(drive), delimiter=";")
    clock = _local_clock(drive)[::10]
    _text(tmp_path / "run" / "rad.csv", ["Uhrzeit;v Rad [km/h]"], clock, 3.6 * drive.speed[::10], delimiter=";")
    recording = imported(tmp_path / "run", time_zone="Europe/Zurich").loaded.recording
    _is_of(recording, drive, dated=True)
    assert recording is not None
    assert recording.tach is not None
    np.testing.assert_allclose(recording.tach["t_s"], drive.t[::10], atol=1e-3)


def test_the_zone_of_a_date_above_times_of_day_is_asked(drive: Drive, imported: Import, tmp_path: Path) -> None:
    """WitMotion states the date once, above times of day."""
    head = ["StartTime: 2026-05-01 05:12:00.000", f"Time(s);{INERTIAL}"]
    log = _text(tmp_path / "wit.txt", head, _local_clock(drive), *_rates(drive), *_forces(drive), delimiter=";")
    _is_of(imported(log, time_zone="Europe/Zurich").loaded.recording, drive, dated=True)
    _, keys = _proposed(log)
    assert "time_zone" in keys


def test_measurements_of_influx_in_one_file_are_a_table_each(drive: Drive, imported: Import, tmp_path: Path) -> None:
    lines = []
    for i, (ns, rate, force) in enumerate(zip(drive.ns, drive.gyro, drive.accel, strict=True)):
        values = zip(("gx", "gy", "gz", "ax", "ay", "az"), [*rate, *force], strict=True)
        lines.append(f"imu,host=pi,axle=3 {','.join(f'{name}={value:.8f}' for name, value in values)} {ns}")
        lines += [f"wheel,host=pi speed_kmh={3.6 * drive.speed[i]:.3f} {ns}"] if i % 10 == 0 else []
    recording = imported(_text(tmp_path / "line.txt", lines)).loaded.recording
    _is_of(recording, drive, dated=True)
    assert recording is not None
    assert recording.tach is not None
    assert len(recording.tach) == drive.t.size // 10


@pytest.mark.parametrize("name", ["vars.txt", "vars.mat"])
def test_variables_of_octave_are_refused_with_what_converts_them(name: str, tmp_path: Path) -> None:
    text = "# Created by Octave 8.4.0\n# name: gyro\n# type: matrix\n# rows: 2\n# columns: 3\n 0 1 2\n 0 1 2\n"
    (tmp_path / name).write_text(text)
    with pytest.raises(BadInputError, match=r"Octave.*save -v7 FILE\.mat"):
        source_format(tmp_path / name)
