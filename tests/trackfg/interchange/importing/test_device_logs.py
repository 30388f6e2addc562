"""Logs as devices, phones and programs write them come in as what was measured, or are refused with what is wrong."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import axis_and_rest
from trackfg.interchange.importing.columns.written_units import number_and_unit
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.sensors.pulse_levels import are_levels, first_missed, rises
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.text import TextFormat
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.reading import read_times
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
Writer = Callable[[Drive, Path], Path]
G = STANDARD_GRAVITY
DEG = np.pi / 180.0
PULSES_PER_M = 10.0
WHEEL = {"tach_pulses_per_rev": "10", "tach_wheel_diameter_m": str(1.0 / np.pi)}


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def _is_of(recording: Recording, drive: Drive, *, wheel: bool = True) -> None:
    """Assert that rates, forces, times, and the wheel's distance are those of the drive."""
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=2e-5)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=2e-3)
    t = recording.imu["t_s"].to_numpy()
    np.testing.assert_allclose(t - t[0], drive.t, atol=2e-3)
    assert (recording.tach is not None) == wheel
    if recording.tach is not None:
        rolled = np.interp(recording.tach["t_s"] - t[0], drive.t, _distance(drive))
        measured = recording.tach["distance_m"].to_numpy()
        np.testing.assert_allclose(measured - measured[0], rolled - rolled[0], atol=0.2)


def _distance(drive: Drive) -> np.ndarray:
    return np.cumsum(drive.speed) / 100.0


def _values(drive: Drive) -> np.ndarray:
    return np.column_stack([drive.t, drive.gyro, drive.accel, drive.speed])


def _lines(path: Path, lines: list[str], encoding: str = "utf-8") -> Path:
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def _stamps(drive: Drive, form: str) -> list[str]:
    return list(pd.to_datetime(drive.ns).strftime(form))


def _axes_alone(drive: Drive, folder: Path) -> Path:
    rows = [",".join(f"{value:.7f}" for value in row[[0, 4, 5, 6, 1, 2, 3, 7]]) for row in _values(drive)]
    return _lines(folder / "log.csv", ["time,X,Y,Z,X,Y,Z,wheel speed (m/s)", *rows])


def _axes_alone_and_numbered(drive: Drive, folder: Path) -> Path:
    values = _values(drive) / [1.0, 1.0, 1.0, 1.0, G, G, G, 1.0]
    rows = [";".join(f"{value:.7f}" for value in row) for row in values]
    return _lines(folder / "log.csv", ["t;X1;Y1;Z1;X2;Y2;Z2;wheel_mps", *rows])


def _numbers_of_sensors(drive: Drive, folder: Path) -> Path:
    """Rows of a database say by a number which sensor they are of."""
    rows = [
        (ns // 1_000_000, sensor, *values[i].tolist())
        for i, ns in enumerate(drive.ns.tolist())
        for sensor, values in ((1, drive.gyro), (4, drive.accel))
    ]
    with sqlite3.connect(folder / "log.db") as connection:
        pd.DataFrame(rows, columns=["ts", "sensor_id", "x", "y", "z"]).to_sql("samples", connection, index=False)
    return folder / "log.db"


def _two_units_in_turn(drive: Drive, folder: Path) -> Path:
    """ArduPilot logs all its inertial sensors in one table; ``I`` is the number of each."""
    rows = [
        ",".join([f"{1e6 * t + 30 * i:.0f}", str(i), *(f"{value:.7f}" for value in (*(g + 0.02 * i), *(a + 0.3 * i)))])
        for t, g, a in zip(drive.t, drive.gyro, drive.accel, strict=True)
        for i in (0, 1)
    ]
    return _lines(folder / "IMU.csv", ["TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", *rows])


NAMES = ("t", "gx", "gy", "gz", "ax", "ay", "az", "wheel_mps")


def _pairs(drive: Drive, folder: Path) -> Path:
    return _lines(
        folder / "log.txt",
        [" ".join(f"{name}={value:.7f}" for name, value in zip(NAMES, row, strict=True)) for row in _values(drive)],
    )


def _pairs_of_a_serial_monitor(drive: Drive, folder: Path) -> Path:
    rows = [
        f"{stamp} -> " + ",".join(f"{name}: {value:.7f}" for name, value in zip(NAMES[1:], row[1:], strict=True))
        for stamp, row in zip(_stamps(drive, "%H:%M:%S.%f"), _values(drive), strict=True)
    ]
    return _lines(folder / "serial.log", ["Opening port COM7", *rows])


def _pairs_with_units(drive: Drive, folder: Path) -> Path:
    """A line for each message, as ``cantools decode --single-line`` prints frames of a bus."""
    lines = []
    for ns, gyro, accel, speed in zip(drive.ns, drive.gyro, drive.accel, drive.speed, strict=True):
        frame = f"({ns / 1e9:.6f}) can0 100#FBFFF5FFFFFF :: "
        for name, values, unit in (("Gyro", gyro, "rad/s"), ("Acc", accel, "m/s^2")):
            signals = ", ".join(f"{name}{axis}: {v:.7f} {unit}" for axis, v in zip("XYZ", values, strict=True))
            lines.append(f"{frame}{name.upper()}({signals})")
        lines.append(f"{frame}WHEEL(WheelSpeed: {3.6 * speed:.6f} km/h)")
    return _lines(folder / "decoded.txt", lines)


def _pairs_of_a_time_series(drive: Drive, folder: Path) -> Path:
    lines = [
        "imu,vehicle=em120 " + ",".join(f"{n}={v:.7f}" for n, v in zip(NAMES[1:], row[1:], strict=True)) + f" {ns}"
        for ns, row in zip(drive.ns, _values(drive), strict=True)
    ]
    return _lines(folder / "export.txt", lines)


def _pairs_in_braces(drive: Drive, folder: Path) -> Path:
    names = ("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ", "Wheel_mps")
    rows = [
        f"{stamp}: IMU {{TimeUS : {1e6 * row[0] + 5e6:.0f}, "
        + ", ".join(f"{name} : {value:.7f}" for name, value in zip(names, row[1:], strict=True))
        + "}"
        for stamp, row in zip(_stamps(drive, "%Y-%m-%d %H:%M:%S.%f"), _values(drive), strict=True)
    ]
    return _lines(folder / "imu.txt", rows)


def _units_in_cells(drive: Drive, folder: Path) -> Path:
    units = ("s", *["°/s"] * 3, *["g"] * 3, "km/h")
    values = _values(drive) / [1.0, *[DEG] * 3, *[G] * 3, 1.0 / 3.6]
    rows = [
        ";".join(f"{value:.7f} {unit}".replace(".", ",") for value, unit in zip(row, units, strict=True))
        for row in values
    ]
    return _lines(folder / "log.csv", ["Zeit;Gyro X;Gyro Y;Gyro Z;Acc X;Acc Y;Acc Z;Radgeschwindigkeit", *rows])


def _names_in_lines_of_data(drive: Drive, folder: Path) -> Path:
    """Text logs of ArduPilot list the cells of each kind of line in lines of their own."""
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 131, 43, IMU, QBffffff, TimeUS,Id,GyrX,GyrY,GyrZ,AccX,AccY,AccZ",
        "FMT, 150, 20, WENC, Qf, TimeUS,WheelDist",
        "MSG, 300000, ArduRover V4.2.3",
    ]
    for row, rolled in zip(_values(drive), _distance(drive), strict=True):
        lines.append(f"IMU, {1e6 * row[0]:.0f}, 0, " + ", ".join(f"{value:.7f}" for value in row[1:7]))
        lines.append(f"WENC, {1e6 * row[0]:.0f}, {rolled:.4f}")
    return _lines(folder / "00000017.log", lines)


def _numbers_of_a_clock_without_zeros(drive: Drive, folder: Path) -> Path:
    times = [
        f"{t.year}-{t.month}-{t.day} {t.hour}:{t.minute}:{t.second}:{t.microsecond // 1000}"
        for t in pd.to_datetime(drive.ns)
    ]
    head = "Time\tAccX(g)\tAccY(g)\tAccZ(g)\tAsX(°/s)\tAsY(°/s)\tAsZ(°/s)\twheel (m/s)"
    values = _values(drive)[:, [4, 5, 6, 1, 2, 3, 7]] / [G, G, G, DEG, DEG, DEG, 1.0]
    rows = ["\t".join([time, *(f"{value:.7f}" for value in row)]) for time, row in zip(times, values, strict=True)]
    return _lines(folder / "log.txt", [head, *rows])


def _twelve_hours_without_a_date(drive: Drive, folder: Path) -> Path:
    before_midnight = drive._replace(t=drive.t + 20 * 3600 + 47 * 60 + 50)
    times = _stamps(before_midnight, "%I:%M:%S.%f %p")
    head = "Time,gx (rad/s),gy (rad/s),gz (rad/s),ax (m/s2),ay (m/s2),az (m/s2),wheel (m/s)"
    rows = [
        ",".join([time, *(f"{value:.7f}" for value in row[1:])])
        for time, row in zip(times, _values(drive), strict=True)
    ]
    return _lines(folder / "log.csv", [head, *rows])


def _lines_above_filled_up(drive: Drive, folder: Path) -> Path:
    """A spreadsheet fills the rows above a table with empty cells when it saves them as text."""
    head = [
        "Gerät;1234" + 6 * ";",
        "Messrate [Hz];100" + 6 * ";",
        7 * ";",
        "Zeit;Gyro;;;Beschleunigung;;;Rad",
        ";X;Y;Z;X;Y;Z;v",
        "s;°/s;°/s;°/s;m/s²;m/s²;m/s²;km/h",
    ]
    values = _values(drive) / [1.0, *[DEG] * 3, 1.0, 1.0, 1.0, 1.0 / 3.6]
    rows = [";".join(f"{value:.7f}".replace(".", ",") for value in row) for row in values]
    return _lines(folder / "log.csv", [*head, *rows], "cp1252")


def _units_above_the_names(drive: Drive, folder: Path) -> Path:
    """LabVIEW has the units above the names, and a name for a comment that its rows leave out."""
    end = "***End_of_Header***"
    head = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t,", end + "\t", "\t"]
    head += ["Channels\t7" + 7 * "\t"]
    for name, cells in (
        ("Date", ["2026/05/01"] * 7),
        ("Time", ["05:12:00,0"] * 7),
        ("Y_Unit_Label", ["deg/s"] * 3 + ["g"] * 3 + ["km/h"]),
        ("Delta_X", ["0,01"] * 7),
    ):
        head.append("\t".join([name, *cells, ""]))
    head += [end + 8 * "\t", "X_Value\tGyro X\tGyro Y\tGyro Z\tAcc X\tAcc Y\tAcc Z\tWheel speed\tComment"]
    values = _values(drive) / [1.0, *[DEG] * 3, *[G] * 3, 1.0 / 3.6]
    rows = ["\t".join(f"{value:.7f}".replace(".", ",") for value in row) for row in values]
    return _lines(folder / "test_001.lvm", head + rows)


def _times_of_each_channel(drive: Drive, folder: Path) -> Path:
    """LabVIEW has times before each channel, and numbers of samples in as many cells as a row has values."""
    values = _values(drive) / [1.0, *[DEG] * 3, *[G] * 3, 1.0 / 3.6]
    names = ["Gyro X", "Gyro Y", "Gyro Z", "Acc X", "Acc Y", "Acc Z", "Wheel speed"]
    head = ["LabVIEW Measurement", "Separator\tTab", "X_Columns\tMulti", "***End_of_Header***", "", "Channels\t7"]
    cells = (("Samples", ["2000"] * 7), ("Y_Unit_Label", ["deg/s"] * 3 + ["g"] * 3 + ["km/h"]), ("X0", ["0"] * 7))
    head += [f"{name}\t" + "\t\t".join(of_channels) for name, of_channels in cells]
    head += ["***End_of_Header***", "\t".join(f"X_Value\t{name}" for name in names) + "\tComment"]
    rows = ["\t".join(f"{row[0]:.3f}\t{value:.7f}" for value in row[1:]) for row in values]
    return _lines(folder / "test_001.lvm", head + rows)


def _packets_of_samples(drive: Drive, folder: Path) -> Path:
    """Movesense sends eight samples with one time."""

    def samples(values: np.ndarray) -> list[dict[str, float]]:
        return [dict(zip("xyz", row, strict=True)) for row in values.tolist()]

    packets = [
        {"imu": {"Timestamp": round(1e3 * drive.t[i]), "ArrayAcc": samples(drive.accel[i : i + 8]),
                 "ArrayGyro": samples(drive.gyro[i : i + 8])}}
        for i in range(0, drive.t.size, 8)
    ]  # fmt: skip
    (folder / "log.json").write_text(json.dumps({"data": packets}))
    return folder / "log.json"


def _packets_of_axes(drive: Drive, folder: Path) -> Path:
    """A list for each axis, with one time for ten samples, beside a quaternion."""
    values = dict(zip(NAMES[1:7], np.hstack([drive.gyro, drive.accel]).T, strict=True))
    packets = [
        {"t": float(drive.t[i]), **{name: axis[i : i + 10].tolist() for name, axis in values.items()}}
        for i in range(0, drive.t.size, 10)
    ]
    return _lines(
        folder / "log.jsonl", [json.dumps({**packet, "info": {"q": [1.0, 0.0, 0.0, 0.0]}}) for packet in packets]
    )


def _words_that_end_in_y(drive: Drive, folder: Path) -> Path:
    """MoTeC names rates ``Gyro Roll Velocity``, and forces ``G Force Long``; all its cells are in quotation marks."""
    names = ["Time", *(f"Gyro {axis} Velocity" for axis in ("Roll", "Pitch", "Yaw"))]
    names += [f"G Force {axis}" for axis in ("Long", "Lat", "Vert")] + ["Wheel Speed FL"]
    units = ["s", *["deg/s"] * 3, *["G"] * 3, "km/h"]
    values = _values(drive) / [1.0, *[DEG] * 3, *[G] * 3, 1.0 / 3.6]
    rows = [[f"{value:.7f}" for value in row] for row in values]
    head = ['"Format","MoTeC CSV File",,,"Workbook",""', '"Sample Rate","100.000","Hz",,"End Time","20.0","s"', ""]
    quoted = [",".join(f'"{cell}"' for cell in row) for row in (names, units, *rows)]
    return _lines(folder / "motec.csv", [*head, *quoted[:2], "", *quoted[2:]])


def _counts_of_a_unit(drive: Drive, folder: Path) -> Path:
    """Data sheets say how many counts a unit has."""
    head = ["# gyro sensitivity: 3276.8 LSB/(deg/s)", "# accelerometer: 16384 LSB/g", ",".join(NAMES)]
    values = np.round(_values(drive) / [1.0, *[DEG / 3276.8] * 3, *[G / 16384.0] * 3, 1e-3])
    values[:, 0], values[:, 7] = 1e3 * drive.t, drive.speed * 1e3
    rows = [",".join(f"{value:.0f}" for value in row) for row in values]
    head[-1] = head[-1].replace("wheel_mps", "wheel_mm/s").replace("t,", "t_ms,", 1)
    return _lines(folder / "raw.csv", head + rows)


def _a_receiver_s_speed_first(drive: Drive, folder: Path) -> Path:
    head = "t_s,gx_rad/s,gy_rad/s,gz_rad/s,ax_m/s2,ay_m/s2,az_m/s2,Speed_GPS (km/h),Speed_OBD (km/h)"
    rows = [",".join(f"{v:.7f}" for v in (*row[:7], 4.0 * row[7], 3.6 * row[7])) for row in _values(drive)]
    return _lines(folder / "log.csv", [head, *rows])


def _a_counter_that_stays(drive: Drive, folder: Path) -> Path:
    head = "t_s,gx_rad/s,gy_rad/s,gz_rad/s,ax_m/s2,ay_m/s2,az_m/s2,accel_calibration_count,Wheel (m/s)"
    rows = [",".join(f"{value:.7f}" for value in row[:7]) + f",3,{row[7]:.7f}" for row in _values(drive)]
    return _lines(folder / "log.csv", [head, *rows])


def _pairs_of_a_phone_s_log(drive: Drive, folder: Path) -> Path:
    """Android writes days without a year."""
    rows = [
        f"05-01 {stamp} 1234 1250 D SensorLog: "
        + " ".join(f"{name}={value:.7f}" for name, value in zip(NAMES[1:], row[1:], strict=True))
        for stamp, row in zip(_stamps(drive, "%H:%M:%S.%f"), _values(drive), strict=True)
    ]
    return _lines(folder / "logcat.txt", rows)


def _records_in_a_text_file(drive: Drive, folder: Path) -> Path:
    rows = [
        json.dumps({"t": t, "imu": {"gyro": gyro.tolist(), "acc": accel.tolist()}, "wheel_speed_mps": speed})
        for t, gyro, accel, speed in zip(drive.t, drive.gyro, drive.accel, drive.speed, strict=True)
    ]
    return _lines(folder / "log.txt", rows)


def _columns_with_units_in_json(drive: Drive, folder: Path) -> Path:
    units = ("s", *["deg/s"] * 3, *["g"] * 3, "km/h")
    values = _values(drive) / [1.0, *[DEG] * 3, *[G] * 3, 1.0 / 3.6]
    columns = {
        name: {"unit": unit, "values": column.tolist()}
        for name, unit, column in zip((*NAMES[:7], "wheel"), units, values.T, strict=True)
    }
    (folder / "log.json").write_text(json.dumps(columns))
    return folder / "log.json"


def _merged_names(drive: Drive, folder: Path) -> Path:
    head = ["Time\tGyro\t\t\tAccelerometer\t\t\tOdometer speed", "(s)\t(rad/s)\t\t\t(m/s²)\t\t\t(m/s)"]
    rows = ["\t".join(f"{value:.7f}" for value in row) for row in _values(drive)]
    return _lines(folder / "log.txt", head + rows)


WITHOUT_A_WHEEL = (_numbers_of_sensors, _two_units_in_turn, _packets_of_samples, _packets_of_axes)
WITH_A_WHEEL = (
    _axes_alone, _axes_alone_and_numbered, _pairs, _pairs_of_a_serial_monitor, _pairs_with_units,
    _pairs_of_a_time_series, _pairs_in_braces, _units_in_cells, _names_in_lines_of_data,
    _numbers_of_a_clock_without_zeros, _twelve_hours_without_a_date, _lines_above_filled_up, _units_above_the_names,
    _times_of_each_channel,
    _words_that_end_in_y, _counts_of_a_unit, _a_receiver_s_speed_first, _a_counter_that_stays,
    _pairs_of_a_phone_s_log, _records_in_a_text_file, _columns_with_units_in_json, _merged_names,
)  # fmt: skip


@pytest.mark.parametrize("write", [*WITH_A_WHEEL, *WITHOUT_A_WHEEL], ids=lambda write: write.__name__)
def test_a_log_comes_in_as_it_was_measured(write: Writer, drive: Drive, tmp_path: Path, imported: Import) -> None:
    recording = _recording(imported(write(drive, tmp_path)))
    _is_of(recording, drive, wheel=write in WITH_A_WHEEL)
    assert recording.description.imu.axes == "FLU"


def test_columns_of_axes_alone_are_asked_where_gravity_does_not_show_them(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    values = np.column_stack([drive.t, drive.gyro, 0.3 * drive.accel])
    rows = [",".join(f"{value:.7f}" for value in row) for row in values]
    _lines(tmp_path / "log.csv", ["time,X,Y,Z,X,Y,Z", *rows])
    with pytest.raises(BadInputError, match=r"imu\.accel: .*Which columns.*expected one of X, X\.2"):
        imported(tmp_path / "log.csv")


def test_a_cell_in_another_unit_is_named_with_its_row(drive: Drive, tmp_path: Path, imported: Import) -> None:
    path = _units_in_cells(drive, tmp_path)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[700] = lines[700].replace("km/h", "mph")
    with pytest.raises(BadInputError, match=r"log\.csv: column 'Radgeschwindigkeit', row 701: '.* mph' is not in km/h"):
        imported(_lines(path, lines))


@pytest.mark.parametrize("cell", ["12+345", "12.3 km", "km 12.345"])
def test_places_with_units_stay_as_they_are_written(cell: str, drive: Drive, tmp_path: Path) -> None:
    _lines(tmp_path / "posts.csv", ["time;place", *(f"{t};{cell}" for t in range(5))])
    (table,) = TextFormat().tables(tmp_path / "posts.csv", lambda _: None)
    assert table.column("place").tolist() == [cell] * 5


@given(st.floats(-1e6, 1e6), st.sampled_from(["m/s^2", "km/h", "°/s", "ms", "g", "mdps"]), st.booleans(), st.booleans())
def test_a_number_and_its_unit_are_those_that_were_written(value: float, unit: str, blank: bool, comma: bool) -> None:
    number = f"{value:.6f}".replace(".", "," if comma else ".")
    assert number_and_unit(f"{number}{' ' if blank else ''}{unit}") == (number, unit)


@pytest.mark.parametrize("cell", ["9.81", "m/s", "2026-05-01", "03:12:00", "1.2.3 g", "5 apples", "", "12+345", "- g"])
def test_other_cells_hold_no_quantity(cell: str) -> None:
    assert number_and_unit(cell) is None


@settings(deadline=None, max_examples=50)
@given(rows=st.floats(1.5, 8.0), duty=st.floats(0.1, 0.9), phase=st.floats(0.0, 1.0), pulses=st.integers(1000, 2000))
def test_no_pulse_of_a_level_is_lost_without_a_word(rows: float, duty: float, phase: float, pulses: int) -> None:
    """Pulses of a wheel, down to so many ``rows`` a pulse, are all counted, or a row is named before any is lost."""
    speed = 0.05 + 0.95 * np.sin(np.linspace(0.0, np.pi, int(rows * pulses * 1.5)))
    turned = phase + np.cumsum(speed) / rows
    levels = (turned % 1.0 < duty).astype(float)
    until = slice(0, first_missed(levels))
    counted, true = rises(levels)[until], np.floor(turned[until]) - np.floor(turned[0])
    assert np.abs(counted - true).max() <= 1.0


def test_a_level_that_is_sampled_too_seldom_is_refused_at_its_row(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    """At 3.2 m/s the wheel gives 96 pulses a second, at 100 rows."""
    level = (30.0 * _distance(drive) % 1.0 >= 0.5).astype(int)
    assert are_levels(level)
    names = [f"gyro_{axis} [rad/s]" for axis in "xyz"] + [f"acc_{axis} [m/s^2]" for axis in "xyz"]
    table = pd.DataFrame(np.hstack([drive.gyro, drive.accel]), columns=names).assign(Tacho=level)
    table.insert(0, "time [s]", drive.t)
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(BadInputError, match=r"log\.csv: column 'Tacho', row \d+: .*pulses are lost") as refused:
        imported(tmp_path / "log.csv", **WHEEL)
    row = int(str(refused.value).split("row ")[1].split(":")[0])
    assert 30.0 * drive.speed[row - 2] < 60.0  # before a pulse takes fewer than two rows


@pytest.mark.parametrize("name", ["Angular Velocity X", "X Angular Velocity", "Gyro Roll Velocity", "roll velocity"])
def test_the_last_letter_of_a_word_is_no_axis(name: str) -> None:
    assert axis_and_rest(name)[0] == "x"


def test_the_time_of_a_measurement_comes_before_that_of_its_receipt(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    """``rostopic echo -p`` writes when a message was received first."""
    vectors = ("field.angular_velocity", "field.linear_acceleration")
    head = ["%time,field.header.seq,field.header.stamp", *(f"{vector}.{axis}" for vector in vectors for axis in "xyz")]
    late = drive.ns + 60_000_000 + 1000 * np.arange(drive.ns.size)
    rows = [
        ",".join([str(received), str(i), str(ns), *(f"{value:.7f}" for value in row[1:7])])
        for i, (received, ns, row) in enumerate(zip(late, drive.ns, _values(drive), strict=True))
    ]
    recording = _recording(imported(_lines(tmp_path / "imu.csv", [",".join(head), *rows])))
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-6)


def test_a_speed_named_after_gps_is_the_receiver_s_without_positions(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    head = "t_s,gx_rad/s,gy_rad/s,gz_rad/s,ax_m/s2,ay_m/s2,az_m/s2,GPS speed (km/h)"
    held = np.interp(np.floor(drive.t), drive.t, drive.speed)
    rows = [",".join(f"{v:.7f}" for v in (*row[:7], 3.6 * v)) for row, v in zip(_values(drive), held, strict=True)]
    recording = _recording(imported(_lines(tmp_path / "log.csv", [head, *rows])))
    assert recording.tach is None
    speeds = recording.others["gnss_speed"]
    moving = speeds["speed_mps"] > 1.0
    np.testing.assert_allclose(
        speeds["speed_mps"][moving], np.interp(speeds["t_s"][moving], drive.t, drive.speed), atol=1e-3
    )
    assert len(speeds) <= drive.t[-1] + 1


def test_frames_of_a_film_are_no_milliseconds() -> None:
    table = SourceTable("t.csv", pd.DataFrame({"t": ["03:12:00:23", "03:12:00:24"]}))
    with pytest.raises(BadInputError, match="no time in a known notation"):
        read_times(table, ("t",), TimeNotation())


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("candump.log", "(1777605120.002500) can0 100#FBFFF5FFFFFF\n"),
        ("bus.asc", "date Fri May 1 05:12:00.000 am 2026\nbase hex  timestamps absolute\n"),
        ("bus.trc", ";$FILEVERSION=2.0\n"),
    ],
)
def test_frames_of_a_bus_are_refused_with_what_decodes_them(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "imu.csv").write_text("t,gx\n0,1\n1,2\n")
    with pytest.raises(BadInputError, match=r"raw CAN frames.*cantools"):
        TextFormat().tables(tmp_path / name, lambda _: None)
    if name.endswith((".log", ".asc")):
        with pytest.raises(BadInputError, match=r"raw CAN frames.*cantools"):
            TextFormat().tables(tmp_path, lambda _: None)


def test_sensors_that_write_a_row_each_share_their_times(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """PlotJuggler exports several messages as one table with blank cells."""
    axes = [f"/imu/{vector}/{axis}" for vector in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    head = ",".join(["__time", *axes, "/gps/latitude", "/gps/longitude", "/gps/altitude"])
    samples = zip(drive.t, np.hstack([drive.gyro, drive.accel]), strict=True)
    rows = [(t, 1, ",".join(f"{value:.7f}" for value in sample) + ",,,") for t, sample in samples]
    places = zip(drive.gnss_t, drive.latitude, drive.longitude, drive.height, strict=True)
    rows += [(t, 0, 6 * "," + ",".join(f"{value:.9f}" for value in place)) for t, *place in places]
    lines = [head, *(f"{t:.3f},{cells}" for t, _, cells in sorted(rows))]
    recording = _recording(imported(_lines(tmp_path / "log.csv", lines)))
    _is_of(recording, drive, wheel=False)
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["t_s"], drive.gnss_t)
