"""Logs with the habits of many vendors, in files of any kind, come in as what was measured, or are refused by name."""

from __future__ import annotations

import gzip
import io
import json
import re
import sqlite3
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported, converted, write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import propose
from trackfg.interchange.importing.proposals.questions import Question
from trackfg.interchange.importing.registry import source_format
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
G = STANDARD_GRAVITY


def _answered(source: Path, out: Path, **answers: str) -> tuple[Recording, list[str]]:
    """Import a source with answers by key, the default for all others; return the keys that were asked, too."""
    keys: list[str] = []

    def ask(question: Question) -> str:
        keys.append(question.key)
        return answers.get(question.key.replace(".", "_"), question.default)

    form = source_format(source)
    tables = form.tables(source, lambda _: None)
    proposal = propose(tables, ask, form.mapping(tables))
    made = write_imported(tables, mapping_of(proposal.sections, "proposal"), out, run_id="log")
    assert made.loaded.recording is not None
    return made.loaded.recording, keys


def _is_of(recording: Recording, drive: Drive, *, dated: bool, rate: float = 2e-5, force: float = 2e-3) -> None:
    """Assert that the rates, forces and times are those of the drive, and the tach's distance where there is one."""
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=rate)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=force)
    t = recording.imu["t_s"].to_numpy()
    zero = 0.0 if dated else t[0] - drive.t[0]
    np.testing.assert_allclose(t - zero, drive.t, atol=2e-3)
    if dated:
        assert recording.description.start == datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    if recording.tach is not None:
        rolled = np.interp(recording.tach["t_s"] - zero, drive.t, np.cumsum(drive.speed) / 100.0)
        measured = recording.tach["distance_m"].to_numpy()
        np.testing.assert_allclose(measured - measured[0], rolled - rolled[0], atol=0.2)


def _cells(
    drive: Drive, times: Sequence[str], *, rate: float = 1.0, force: float = 1.0, wheel: float = 1.0
) -> list[list[str]]:
    """Return rows of a time, six inertial values and the wheel's speed, divided by what a unit is worth."""
    values = np.column_stack([drive.gyro / rate, drive.accel / force, drive.speed / wheel])
    return [[time, *(f"{value:.8g}" for value in row)] for time, row in zip(times, values, strict=True)]


def _text(
    path: Path, head: Sequence[str], rows: Sequence[Sequence[str]], delimiter: str = ",", encoding: str = "utf-8"
) -> Path:
    lines = [*head, *(delimiter.join(row) for row in rows)]
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def _seconds(drive: Drive) -> list[str]:
    return [f"{t:.3f}" for t in drive.t]


def _stamps(drive: Drive, form: str, hours: int = 0) -> list[str]:
    return [text[:-3] for text in pd.to_datetime(drive.ns + hours * 3_600_000_000_000).strftime(form)]


DEG = np.pi / 180.0
HEAD = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,wheel_kmh"


def _units_in_names(drive: Drive, folder: Path) -> Path:
    return _text(folder / "log.csv", [HEAD], _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6))


def _durations_of_pandas(drive: Drive, folder: Path) -> Path:
    """Tables whose index, without a name, counts from a zero of its own; one of them has a column alone beside it."""
    times = pd.Index(pd.to_timedelta(drive.ns - drive.ns[0]))
    names = ["gx_dps", "gy_dps", "gz_dps", "ax_g", "ay_g", "az_g"]
    values = np.hstack([drive.gyro / DEG, drive.accel / G])
    pd.DataFrame(values, times, names).to_csv(folder / "imu.csv")
    pd.DataFrame({"wheel_kmh": 3.6 * drive.speed}, times).to_csv(folder / "wheel.csv")
    return folder


def _description_below_units(drive: Drive, folder: Path) -> Path:
    head = ["TIME\tGX\tGY\tGZ\tAX\tAY\tAZ\tV", "ms\tdeg/s\tdeg/s\tdeg/s\tmg\tmg\tmg\tmm/s"]
    head.append("since boot\trate\trate\trate\tacc\tacc\tacc\twheel")
    times = [f"{1e3 * t + 5e6:.0f}" for t in drive.t]
    return _text(folder / "log.tsv", head, _cells(drive, times, rate=DEG, force=1e-3 * G, wheel=1e-3), "\t")


def _delimiter_at_the_end(drive: Drive, folder: Path) -> Path:
    rows = [[*row, ""] for row in _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)]
    return _text(folder / "log.csv", [HEAD], rows)


def _numbered_rows_without_a_name(drive: Drive, folder: Path) -> Path:
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD], [[str(i), *row] for i, row in enumerate(rows)])


def _remarks_among_blanks(drive: Drive, folder: Path) -> Path:
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    rows[700:700] = [["% marker pressed"]]
    return _text(folder / "log.txt", ["// a logger", "% " + HEAD.replace(",", " ")], rows, "   ")


def _utf_16_without_a_mark(drive: Drive, folder: Path) -> Path:
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD], rows, encoding="utf-16-le")


def _japanese(drive: Drive, folder: Path) -> Path:
    names = [
        "時刻[s]",
        *(f"{name}{axis}[{unit}]" for name, unit in (("角速度", "deg/s"), ("加速度", "m/s2")) for axis in "XYZ"),
    ]
    rows = _cells(drive, _seconds(drive), rate=DEG, wheel=1 / 3.6)
    return _text(folder / "log.csv", [",".join([*names, "速度[km/h]"])], rows, encoding="shift_jis")


def _finnish(drive: Drive, folder: Path) -> Path:
    names = [
        f"{name} {axis} ({unit})" for name, unit in (("Kulmanopeus", "°/s"), ("Kiihtyvyys", "g")) for axis in "XYZ"
    ]
    rows = _cells(drive, _stamps(drive, "%d.%m.%Y %H.%M.%S,%f"), rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [";".join(["Aika", *names, "Nopeus (km/h)"])], rows, ";")


def _columns_of_two_levels(drive: Drive, folder: Path) -> Path:
    values = np.column_stack([drive.gyro, drive.accel, drive.speed])
    columns = [(name, axis) for name in ("gyro", "accel") for axis in "xyz"]
    frame = pd.DataFrame(values, index=pd.to_datetime(drive.ns, utc=True), columns=[*columns, ("wheel_mps", "")])
    frame.columns = pd.MultiIndex.from_tuples(frame.columns)
    frame.to_parquet(folder / "log.parquet")
    return folder / "log.parquet"


def _units_of_everyone(drive: Drive, folder: Path) -> Path:
    head = "t[s];wx[mdeg/s];wy[mdeg/s];wz[mdeg/s];ax[cm/s2];ay[cm/s2];az[cm/s2];v[ft/s]"
    return _text(
        folder / "log.csv", [head], _cells(drive, _seconds(drive), rate=1e-3 * DEG, force=1e-2, wheel=0.3048), ";"
    )


def _letters_of_aircraft(drive: Drive, folder: Path) -> Path:
    head = "t_s,p_dps,q_dps,r_dps,nx_g,ny_g,nz_g,v_kmh"
    return _text(folder / "log.csv", [head], _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6))


def _week_that_starts_again(drive: Drive, folder: Path) -> Path:
    times = [f"{(604_790.0 + t) % 604_800.0:.3f}" for t in drive.t]
    head = HEAD.replace("t_s", "tow_s")
    return _text(folder / "log.csv", [head], _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))


def _microseconds_of_32_bits(drive: Drive, folder: Path) -> Path:
    times = [str((round(1e6 * t) + 2**32 - 9_000_000) % 2**32) for t in drive.t]
    head = HEAD.replace("t_s", "micros_us")
    return _text(folder / "log.csv", [head], _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))


def _sample_time_fine(drive: Drive, folder: Path) -> Path:
    times = [str((round(1e4 * t) + 2**32 - 50_000) % 2**32) for t in drive.t]
    rows = [
        [str((i + 65_000) % 65_536), *row]
        for i, row in enumerate(_cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))
    ]
    head = "PacketCounter,SampleTimeFine," + HEAD.partition(",")[2]
    return _text(folder / "log.txt", ["// Start Time: Unknown", head], rows)


def _time_of_day_in_digits(drive: Drive, folder: Path) -> Path:
    times = _stamps(drive, "%H%M%S.%f", 0)
    head = HEAD.replace("t_s", "UTC")
    rows = _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [head], rows)


def _date_and_time_in_digits(drive: Drive, folder: Path) -> Path:
    times = _stamps(drive, "%H%M%S.%f")
    head = "Date," + HEAD.replace("t_s", "UTC")
    rows = [["010526", *row] for row in _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6)]
    return _text(folder / "log.csv", [head], rows)


def _iso_with_an_offset(drive: Drive, folder: Path) -> Path:
    times = [f"{stamp}+0200" for stamp in _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f", 2)]
    return _text(folder / "log.csv", [HEAD], _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))


def _name_of_a_zone(drive: Drive, folder: Path) -> Path:
    times = [f"{stamp} CEST" for stamp in _stamps(drive, "%Y-%m-%d %H:%M:%S.%f", 2)]
    return _text(folder / "log.csv", [HEAD], _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))


def _repeated_and_displaced_rows(drive: Drive, folder: Path) -> Path:
    rows = _cells(drive, _stamps(drive, "%Y-%m-%dT%H:%M:%S.%fZ"), rate=DEG, force=G, wheel=1 / 3.6)
    times = [text[:-1] + "Z" for text in _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f000")]
    rows = [[f"{time[:23]}Z", *row[1:]] for time, row in zip(times, rows, strict=True)]
    rows[300:302] = [rows[300], rows[300], rows[301]]
    rows[900], rows[901] = rows[901], rows[900]
    return _text(folder / "log.csv", [HEAD], rows)


def _a_row_for_each_sensor(drive: Drive, folder: Path) -> Path:
    rows = []
    for i, ns in enumerate(drive.ns):
        rows.append(["Gyroscope", str(ns), *(f"{value:.7f}" for value in drive.gyro[i])])
        rows.append(["Accelerometer", str(ns), *(f"{value:.7f}" for value in drive.accel[i])])
        rows.append(["WheelSpeed", str(ns), f"{drive.speed[i]:.5f}", "", ""])
    return _text(folder / "log.csv", ["sensor,timestamp,x,y,z"], rows)


def _channels(drive: Drive) -> dict[str, np.ndarray]:
    values = {
        f"{kind}_{axis}": values[:, i]
        for kind, values in (("gyro", drive.gyro), ("accel", drive.accel))
        for i, axis in enumerate("xyz")
    }
    return {**values, "wheel_speed": drive.speed}


def _a_file_for_each_channel(drive: Drive, folder: Path) -> Path:
    (source := folder / "channels").mkdir()
    for name, values in _channels(drive).items():
        _text(
            source / f"{name}.csv",
            ["time,value"],
            [[str(ns), f"{value:.7f}"] for ns, value in zip(drive.ns, values, strict=True)],
        )
    return source


def _beside_a_readme(drive: Drive, folder: Path) -> Path:
    source = folder / "car 12"
    source.mkdir()
    _units_in_names(drive, source)
    (source / "README.txt").write_text("Logged on car 12.\nAxes: forward, left, up.\n")
    return source


def _axes_before_words(drive: Drive, folder: Path) -> Path:
    names = "Time,RollRate (deg/s),PitchRate (deg/s),YawRate (deg/s),XAccel (g),YAccel (g),ZAccel (g),wheel_kmh"
    return _text(folder / "log.csv", [names], _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6))


def _files_of_sensors(drive: Drive) -> dict[str, str]:
    files = {}
    for name, names, values in (
        ("gyroscope", "x,y,z", drive.gyro),
        ("accelerometer", "x,y,z", drive.accel),
        ("odometer", "distance_m", np.cumsum(drive.speed)[:, None] / 100.0),
    ):
        rows = (
            ",".join([str(ns), *(f"{value:.8f}" for value in row)]) for ns, row in zip(drive.ns, values, strict=True)
        )
        files[f"run/{name}/data.csv"] = "\n".join([f"timestamp,{names}", *rows]) + "\n"
    return files


def _folders_in_a_zip(drive: Drive, folder: Path) -> Path:
    with zipfile.ZipFile(folder / "run.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in _files_of_sensors(drive).items():
            archive.writestr(name, text)
    return folder / "run.zip"


def _folders_in_a_tar(drive: Drive, folder: Path) -> Path:
    with tarfile.open(folder / "run.tar.gz", "w:gz") as archive:
        for name, text in _files_of_sensors(drive).items():
            info = tarfile.TarInfo(name)
            info.size = len(text.encode())
            archive.addfile(info, io.BytesIO(text.encode()))
    return folder / "run.tar.gz"


def _compressed(drive: Drive, folder: Path) -> Path:
    path = _units_in_names(drive, folder)
    (folder / "log.csv.gz").write_bytes(gzip.compress(path.read_bytes()))
    return folder / "log.csv.gz"


def _frame(drive: Drive) -> pd.DataFrame:
    return pd.DataFrame({"timestamp": pd.to_datetime(drive.ns, utc=True), **_channels(drive)})


def _parquet(drive: Drive, folder: Path) -> Path:
    _frame(drive).to_parquet(folder / "log.parquet")
    return folder / "log.parquet"


def _feather_of_a_zone(drive: Drive, folder: Path) -> Path:
    frame = _frame(drive)
    frame.assign(timestamp=frame["timestamp"].dt.tz_convert("Europe/Zurich")).to_feather(folder / "log.feather")
    return folder / "log.feather"


def _matlab_structs(drive: Drive, folder: Path) -> Path:
    from scipy.io import savemat

    imu = {"time": drive.t, "gyr": drive.gyro, "acc": drive.accel.T}
    savemat(folder / "run.mat", {"imu": imu, "odo": {"time": drive.t, "wheel_speed": drive.speed}, "fs": 100.0})
    return folder / "run.mat"


def _matlab_7_3(drive: Drive, folder: Path) -> Path:
    import h5py

    with h5py.File(folder / "run.mat", "w", userblock_size=512) as file:
        for name, values in (("imu/t", drive.t[None]), ("imu/gyro", drive.gyro.T), ("imu/accel", drive.accel.T)):
            file[name] = values
        file["wheel_speed"] = drive.speed[None]
    content = (folder / "run.mat").read_bytes()
    (folder / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" ") + content[512:])
    return folder / "run.mat"


def _npz(drive: Drive, folder: Path) -> Path:
    np.savez(folder / "run.npz", time=drive.t, gyro=drive.gyro, accel=drive.accel, wheel_speed=drive.speed)
    return folder / "run.npz"


def _json_lines(drive: Drive, folder: Path) -> Path:
    lines = []
    for i, ns in enumerate(drive.ns.tolist()):
        gyro, acc = (dict(zip("xyz", values[i].tolist(), strict=True)) for values in (drive.gyro, drive.accel))
        lines.append(json.dumps({"type": "imu", "ts": ns // 1000, "gyro": gyro, "acc": acc}))
        lines.append(json.dumps({"type": "odo", "ts": ns // 1000, "wheel_speed": float(drive.speed[i])}))
    (folder / "log.jsonl").write_text("\n".join(lines))
    return folder / "log.jsonl"


def _json_columns(drive: Drive, folder: Path) -> Path:
    columns = {"time": drive.t.tolist(), **{name: values.tolist() for name, values in _channels(drive).items()}}
    (folder / "log.json").write_text(json.dumps({"meta": {"device": "x"}, "data": columns}))
    return folder / "log.json"


def _sqlite(drive: Drive, folder: Path) -> Path:
    with sqlite3.connect(folder / "log.db") as connection:
        _frame(drive).assign(timestamp=drive.ns).to_sql("imu", connection, index=False)
    return folder / "log.db"


def _row_for_each_field(drive: Drive, folder: Path) -> Path:
    stamps = [f"{stamp}Z" for stamp in _stamps(drive, "%Y-%m-%dT%H:%M:%S.%f")]
    rows = [
        ["", "_result", "0", stamp, "imu", name, f"{values[i]:.7f}"]
        for i, stamp in enumerate(stamps)
        for name, values in _channels(drive).items()
    ]
    return _text(folder / "log.csv", [",result,table,_time,_measurement,_field,_value"], rows)


def _labview(drive: Drive, folder: Path) -> Path:
    end = "***End_of_Header***\t"
    head = ["LabVIEW Measurement\t", "Separator\tTab", end, "\t", "Channels\t7", "Samples\t2000\t2000", end]
    head.append("X_Value\t" + HEAD.partition(",")[2].replace(",", "\t") + "\tComment")
    rows = [[*row, ""] for row in _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)]
    return _text(folder / "log.lvm", head, rows, "\t")


def _distance_of_each_kilometre(drive: Drive, folder: Path) -> Path:
    rolled = (np.cumsum(drive.speed) / 100.0 + 995.0) % 1000.0
    rows = [
        [*row[:7], f"{d:.5f}"] for row, d in zip(_cells(drive, _seconds(drive), rate=DEG, force=G), rolled, strict=True)
    ]
    return _text(folder / "log.csv", [HEAD.replace("wheel_kmh", "distance_m")], rows)


def _distance_of_each_row(drive: Drive, folder: Path) -> Path:
    rolled = np.round(np.cumsum(drive.speed) / 100.0, 2)
    steps = np.diff(rolled, prepend=rolled[0])
    rows = [
        [*row[:7], f"{d:.2f}"] for row, d in zip(_cells(drive, _seconds(drive), rate=DEG, force=G), steps, strict=True)
    ]
    return _text(folder / "log.csv", [HEAD.replace("wheel_kmh", "distance_m")], rows)


def _seconds_and_nanoseconds(drive: Drive, folder: Path) -> Path:
    vectors = ("angular_velocity", "linear_acceleration")
    head = ["header.stamp.sec", "header.stamp.nanosec"]
    head += [f"{vector}.{axis}" for vector in vectors for axis in "xyz"] + ["wheel_speed_kmh"]
    head += [f"{vector}_covariance[{i}]" for vector in vectors for i in range(9)]
    rows = _cells(drive, [f"{ns // 10**9},{ns % 10**9}" for ns in drive.ns], wheel=1 / 3.6)
    return _text(folder / "imu.csv", [",".join(head)], [[*row, *["0.0"] * 18] for row in rows])


def _ticks_of_dot_net(drive: Drive, folder: Path) -> Path:
    times = [f"{ns // 100 + 621_355_968_000_000_000}" for ns in drive.ns]
    rows = _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD.replace("t_s", "Ticks")], rows)


def _milliseconds_beside_a_clock(drive: Drive, folder: Path) -> Path:
    times = [stamp.replace(".", ",") for stamp in _stamps(drive, "%Y-%m-%d,%H:%M:%S.%f")]
    rows = _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD.replace("t_s", "Date,Time,Milliseconds")], rows)


def _parts_of_a_date(drive: Drive, folder: Path, form: str, names: str) -> Path:
    rows = _cells(drive, _stamps(drive, form), rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD.replace("t_s", names)], rows)


def _day_of_the_year(drive: Drive, folder: Path) -> Path:
    return _parts_of_a_date(drive, folder, "%Y,%j,%H,%M,%S.%f", "Year,Day of Year,Hour,Minute,Second")


def _short_names_of_a_date(drive: Drive, folder: Path) -> Path:
    return _parts_of_a_date(drive, folder, "%Y,%m,%d,%H,%M,%S.%f", "year,month,day,hour,min,sec")


def _week_and_seconds_of_it(drive: Drive, folder: Path) -> Path:
    seconds = (drive.ns - pd.Timestamp("1980-01-06").value) / 1e9 + 18.0
    times = [f"{t // 604_800:.0f},{t % 604_800:.3f}" for t in seconds]
    rows = _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6)
    return _text(folder / "log.csv", [HEAD.replace("t_s", "GPS Week,SOW")], rows)


DATED = (
    _milliseconds_beside_a_clock, _ticks_of_dot_net,
    _seconds_and_nanoseconds, _day_of_the_year, _short_names_of_a_date, _week_and_seconds_of_it,
    _row_for_each_field, _finnish, _columns_of_two_levels,
    _date_and_time_in_digits, _iso_with_an_offset, _name_of_a_zone, _repeated_and_displaced_rows,
    _a_row_for_each_sensor,
    _a_file_for_each_channel, _folders_in_a_zip, _folders_in_a_tar, _parquet, _feather_of_a_zone, _json_lines, _sqlite,
)  # fmt: skip
UNDATED = (
    _labview, _distance_of_each_kilometre, _distance_of_each_row,
    _durations_of_pandas,
    _units_in_names, _description_below_units, _delimiter_at_the_end, _numbered_rows_without_a_name,
    _remarks_among_blanks,
    _utf_16_without_a_mark, _japanese, _units_of_everyone, _letters_of_aircraft, _week_that_starts_again,
    _microseconds_of_32_bits, _sample_time_fine, _time_of_day_in_digits, _compressed, _matlab_structs, _matlab_7_3,
    _npz,
    _json_columns, _beside_a_readme, _axes_before_words,
)  # fmt: skip


@pytest.mark.parametrize("write", [*DATED, *UNDATED], ids=lambda write: write.__name__)
def test_a_log_comes_in_as_it_was_measured(
    write: Callable[[Drive, Path], Path], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    recording = imported(write(drive, tmp_path)).loaded.recording
    assert recording is not None
    assert recording.description.imu.axes == "FLU"
    assert recording.tach is not None
    _is_of(recording, drive, dated=write in DATED)


def test_a_clock_that_jumps_by_years_is_an_error_of_the_recording(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    frame = pd.DataFrame(drive.gyro, columns=["gx_radps", "gy_radps", "gz_radps"])
    frame[["ax_mps2", "ay_mps2", "az_mps2"]] = drive.accel
    frame["speed_mps"] = drive.speed
    frame.insert(0, "time_s", drive.t + np.where(drive.t > 10.0, 1.6e9, 0.0))
    frame.to_csv(tmp_path / "log.csv", index=False)
    (error,) = [one for one in imported(tmp_path / "log.csv").loaded.findings if one.level == "error"]
    assert "no rows for 1.6e+09 s before this one" in str(error)


def test_counts_are_worth_what_the_remarks_say_and_gravity_confirms(drive: Drive, tmp_path: Path) -> None:
    rows = [
        [f"{1e3 * t:.0f}", *map(str, counts)]
        for t, counts in zip(
            drive.t,
            np.column_stack([drive.gyro / (8.75e-3 * DEG), drive.accel / (0.122e-3 * G)]).round().astype(int),
            strict=True,
        )
    ]  # fmt: skip
    remarks = ["# gyro: 8.75 mdps/LSB", "# accelerometer: 0.122 mg/LSB"]
    source = _text(tmp_path / "log.csv", [*remarks, "t_ms,gx,gy,gz,ax,ay,az"], rows)

    recording, keys = _answered(source, tmp_path / "told")

    _is_of(recording, drive, dated=False, rate=1e-4, force=2e-3)
    assert "imu.accel_unit" not in keys
    bare = _text(tmp_path / "bare.csv", ["t_ms,gx,gy,gz,ax,ay,az"], rows)
    with pytest.raises(BadInputError, match=r"imu.gyro_unit: the source does not say it .*8.75 mdeg/s"):
        _answered(bare, tmp_path / "silent")
    recording, _ = _answered(bare, tmp_path / "answered", imu_gyro_unit="8.75 mdeg/s")
    _is_of(recording, drive, dated=False, rate=1e-4, force=0.02 * G)


@pytest.mark.parametrize(("unit", "mps"), [("km/h", 1 / 3.6), ("mph", 0.44704), ("m/s", 1.0), ("mm/s", 1e-3)])
def test_the_force_shows_units_that_are_not_stated(unit: str, mps: float, tmp_path: Path) -> None:
    rng, t = np.random.default_rng(1), np.arange(20_000) / 100.0
    forward = 0.4 * np.sin(2.0 * np.pi * t / 30.0)
    speed = 12.0 + np.cumsum(forward) / 100.0
    turn = 0.03 * np.sin(2.0 * np.pi * t / 25.0)
    gyro = np.column_stack([0 * t, 0 * t, turn]) + 1e-4 * rng.standard_normal((t.size, 3))
    force = np.column_stack([forward, speed * turn, G + 0 * t]) + 0.01 * rng.standard_normal((t.size, 3))
    names = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), np.column_stack([gyro / DEG, force / G]).T, strict=True))
    pd.DataFrame({"t": t, **names, "v": speed / mps}).to_csv(tmp_path / "log.csv", index=False)

    recording, keys = _answered(tmp_path / "log.csv", tmp_path / "r")

    assert "tach.unit" not in keys
    assert "imu.gyro_unit" not in keys
    assert recording.tach is not None
    np.testing.assert_allclose(np.ptp(recording.tach["distance_m"]), np.trapezoid(speed, t), rtol=1e-4)
    np.testing.assert_allclose(recording.gyro, gyro, atol=1e-6)


def test_units_show_on_other_axes_too(tmp_path: Path) -> None:
    """Of a sensor on its side, which states no unit, the forces say something once it is known which is forward."""
    run = simulate("mainline", seed=3, duration_s=240.0).recording
    assert run.tach is not None
    t = run.imu["t_s"].to_numpy()
    gyro, accel = np.degrees(run.gyro)[:, [1, 2, 0]], run.accel[:, [1, 2, 0]]
    speed = np.gradient(np.interp(t, run.tach["t_s"], run.tach["distance_m"]), t) * 3.6
    speed = pd.Series(speed).rolling(200, center=True, min_periods=1).mean().to_numpy()
    names = ["time_s", "gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z", "speed"]
    pd.DataFrame(np.column_stack([t, gyro, accel, speed]), columns=names).to_csv(tmp_path / "log.csv", index=False)

    recording, keys = _answered(tmp_path / "log.csv", tmp_path / "r")

    assert recording.description.imu.axes == "LUF"
    assert not {"tach.unit", "imu.gyro_unit"} & set(keys)
    np.testing.assert_allclose(recording.gyro, run.gyro, atol=1e-6)
    assert recording.tach is not None
    np.testing.assert_allclose(np.ptp(recording.tach["distance_m"]), np.ptp(run.tach["distance_m"]), rtol=0.01)


def test_a_unit_that_is_not_known_is_asked_and_turns_need_the_wheel(drive: Drive, tmp_path: Path) -> None:
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=0.5 * 0.86 * np.pi / 30.0)
    names = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,wheel speed [{}]"
    turning = _text(tmp_path / "log.csv", [names.format("rpm")], rows)
    recording, keys = _answered(turning, tmp_path / "r", tach_wheel_diameter_m="0.86")
    _is_of(recording, drive, dated=False)
    assert "tach.wheel_diameter_m" in keys

    unknown = _text(tmp_path / "unknown.csv", [names.format("furlongs")], rows)
    with pytest.raises(BadInputError, match=r"tach.unit: the source does not say it \(Unit of .*furlongs"):
        _answered(unknown, tmp_path / "u")


def test_a_rate_in_a_unit_that_is_not_known_is_asked(drive: Drive, tmp_path: Path) -> None:
    head = ",".join(["t [s]", *(f"gyro {axis} [gon/s]" for axis in "xyz"), *(f"acc {axis} [g]" for axis in "xyz")])
    rows = [row[:7] for row in _cells(drive, _seconds(drive), rate=np.pi / 200.0, force=G)]
    source = _text(tmp_path / "log.csv", [head], rows)

    with pytest.raises(BadInputError, match=r"imu.gyro_unit: .* \(Unit of gyro x, .*, which the source calls gon/s\)"):
        _answered(source, tmp_path / "refused")
    recording, _ = _answered(source, tmp_path / "made", imu_gyro_unit="0.9 deg/s")

    _is_of(recording, drive, dated=False)


def test_pulses_per_turn_are_not_assumed(drive: Drive, tmp_path: Path) -> None:
    pulses = np.floor(np.cumsum(drive.speed) / 100.0 / (np.pi * 0.92 / 90)).astype(int)
    rows = [
        [*row[:7], str(n)] for row, n in zip(_cells(drive, _seconds(drive), rate=DEG, force=G), pulses, strict=True)
    ]
    source = _text(tmp_path / "log.csv", [HEAD.replace("wheel_kmh", "pulses")], rows)

    with pytest.raises(BadInputError, match=r"tach\.pulses_per_rev: the source does not say it \(Pulses per turn"):
        _answered(source, tmp_path / "assumed")
    recording, _ = _answered(source, tmp_path / "r", tach_pulses_per_rev="90")
    _is_of(recording, drive, dated=False)


def test_samples_without_times_are_counted_at_a_rate_that_is_stated_or_asked(drive: Drive, tmp_path: Path) -> None:
    names = "counter,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,wheel_kmh"
    rows = _cells(drive, [str((i + 200) % 256) for i in range(drive.t.size)], rate=DEG, force=G, wheel=1 / 3.6)
    del rows[600:610]
    stated = _text(tmp_path / "stated.csv", ["# Sampling rate: 100 Hz", names], rows)

    recording, _ = _answered(stated, tmp_path / "r")

    assert np.diff(recording.imu["t_s"]).max() == pytest.approx(0.11)  # ten samples are lost
    bare = _text(tmp_path / "bare.csv", [names], rows)
    with pytest.raises(BadInputError, match=r"imu\.rate_hz: the source does not say it"):
        _answered(bare, tmp_path / "bare")
    recording, keys = _answered(bare, tmp_path / "asked", imu_rate_hz="100")
    assert keys[0] == "imu.rate_hz"
    assert np.diff(recording.imu["t_s"]).max() == pytest.approx(0.11)


def test_dates_of_a_zone_that_they_do_not_state_are_asked(drive: Drive, tmp_path: Path) -> None:
    times = _stamps(drive, "%d.%m.%Y %H:%M:%S.%f", 2)
    source = _text(tmp_path / "log.csv", [HEAD], _cells(drive, times, rate=DEG, force=G, wheel=1 / 3.6))

    recording, keys = _answered(source, tmp_path / "r", time_zone="Europe/Zurich")

    assert "time_zone" in keys
    _is_of(recording, drive, dated=True)
    days = [f"{46143 + (3 + 2) / 24 + (12 * 60 + t) / 86400:.11f}" for t in drive.t]
    source = _text(
        tmp_path / "days.csv", [HEAD.replace("t_s", "Date")], _cells(drive, days, rate=DEG, force=G, wheel=1 / 3.6)
    )
    recording, _ = _answered(source, tmp_path / "days", time_zone="Europe/Zurich")
    _is_of(recording, drive, dated=True)


@pytest.mark.parametrize("missing", ["-9999", "---", "#N/A", "-1.#IND", "\\N"])
def test_what_stands_for_no_value_is_no_value(missing: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    names = HEAD + ",lat,lon,alt"
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    for i, row in enumerate(rows):
        j, rest = divmod(i, 100)
        place = [f"{drive.latitude[j]:.9f}", f"{drive.longitude[j]:.9f}", f"{drive.height[j]:.3f}"]
        row[7:] = [row[7] if i % 10 == 0 else missing, *(place if rest == 0 else [missing] * 3)]

    recording = imported(_text(tmp_path / "log.csv", [names], rows)).loaded.recording

    assert recording is not None
    assert recording.gnss is not None
    assert len(recording.gnss) == 20
    assert len(recording.tach) == 200
    _is_of(recording, drive, dated=False)


def _blank(drive: Drive, path: Path, rows: Sequence[int], cell: str = "") -> Path:
    """A log whose IMU has no second rate and no third force in these rows."""
    cells = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    for row in rows:
        cells[row][2] = cells[row][6] = cell
    return _text(path, [HEAD], cells)


def test_rows_of_the_imu_with_a_blank_cell_are_left_out_and_counted(drive: Drive, tmp_path: Path) -> None:
    source, gone = _blank(drive, tmp_path / "log.csv", [700, 701, 1500]), [700, 701, 1500]
    form = source_format(source)
    tables = form.tables(source, lambda _: None)
    proposal = propose(tables, lambda question: question.default, form.mapping(tables))
    conversion = converted(tables, mapping_of(proposal.sections, "proposal"), run_id="log")
    (note,) = conversion.notes
    assert note.startswith("log.csv: 3 rows without a value of ")
    recording = conversion.write(tmp_path / "r").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, np.delete(drive.gyro, gone, axis=0), atol=2e-5)
    assert recording.tach is not None
    assert len(recording.tach) == len(drive.t)


def test_a_cell_of_blanks_is_empty(drive: Drive, tmp_path: Path) -> None:
    recording, _ = _answered(_blank(drive, tmp_path / "log.csv", [100, 900], "   "), tmp_path / "out")

    assert len(recording.imu) == drive.t.size - 2
    assert recording.tach is not None


def test_rows_that_are_there_twice_count_once_however_many(drive: Drive, tmp_path: Path) -> None:
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    twice = [row for i, row in enumerate(rows) for _ in range(2 if 500 <= i < 700 else 1)]

    recording, _ = _answered(_text(tmp_path / "log.csv", [HEAD], twice), tmp_path / "out")

    _is_of(recording, drive, dated=False)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda rows: rows[::-1], r"log.csv: column 't_s', row 3: earlier than the row before \(1999 such rows\)"),
        (
            lambda rows: [[re.sub("^-", "minus ", cell) for cell in row] for row in rows],
            r"log.csv: column 'gx_dps', row \d: 'minus \d.*' is not a number \(\d+ such cells\); expected a number",
        ),
    ],
)
def test_what_is_wrong_with_a_column_is_named(
    damage: Callable[[list[list[str]]], list[list[str]]], message: str, drive: Drive, tmp_path: Path
) -> None:
    rows = damage(_cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6))

    with pytest.raises(BadInputError, match=message):
        _answered(_text(tmp_path / "log.csv", [HEAD], rows), tmp_path / "out")


def test_a_log_that_is_not_usable_is_refused_by_its_own_name(drive: Drive, tmp_path: Path, imported: Import) -> None:
    source = _blank(drive, tmp_path / "log.csv", range(1200))
    with pytest.raises(
        BadInputError, match=r"^propos.*: the recording would not be usable: log.csv, column '"
    ) as refusal:
        imported(source)
    assert str(refusal.value).count("log.csv, column '") == 2
    assert "data row 1 (t = 0 s): empty or NaN (1200 such rows)" in str(refusal.value)
    assert "parquet" not in str(refusal.value)


def test_times_of_day_over_the_end_of_summer_time_are_refused_once_by_the_name_of_their_column(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    of_day = pd.to_datetime(drive.ns - np.where(drive.t > 10.0, 3_600_000_000_000, 0)).strftime("%H:%M:%S.%f")
    head = HEAD.replace("t_s", "Uhrzeit")
    source = _text(tmp_path / "log.csv", [head], _cells(drive, of_day.tolist(), rate=DEG, force=G))
    with pytest.raises(BadInputError, match=r"log\.csv, column 'Uhrzeit', data row 1002 .* by 3599\.99 s") as refusal:
        imported(source)
    assert "set back, as at the end of summer time, add as much to the times of all later" in str(refusal.value)
    assert str(refusal.value).count("earlier than the row before") == 1


def test_a_clock_that_keeps_winter_time_is_none_of_a_zone_with_summer_time(drive: Drive, tmp_path: Path) -> None:
    stamps = (pd.Timestamp("2026-03-29 01:59:50") + pd.to_timedelta(drive.t, unit="s")).strftime("%Y-%m-%d %H:%M:%S.%f")
    source = _text(tmp_path / "log.csv", [HEAD], _cells(drive, stamps.tolist(), rate=DEG, force=G, wheel=1 / 3.6))
    with pytest.raises(BadInputError, match=r"1000 times such as 2026-03-29 02:00:00 lie in the hour that Eu"):
        _answered(source, tmp_path / "summer", time_zone="Europe/Zurich")
    recording, _ = _answered(source, tmp_path / "winter", time_zone="Etc/GMT-1")
    assert recording.description.start == datetime(2026, 3, 29, 0, 59, 50, tzinfo=UTC)


def test_of_two_sensors_one_is_chosen_with_its_own_accelerometer(drive: Drive, tmp_path: Path) -> None:
    one, two = ([f"imu{n}_{name}" for name in ("gx", "gy", "gz", "ax", "ay", "az")] for n in (1, 2))
    columns = {"t_s": drive.t}
    for names, factor in ((one, 2.0), (two, 1.0)):
        columns |= dict(zip(names, np.column_stack([factor * drive.gyro, drive.accel]).T, strict=True))
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)

    recording, keys = _answered(tmp_path / "log.csv", tmp_path / "r", imu_gyro="imu2_gx", imu_gyro_unit="rad/s")

    assert keys[0] == "imu.gyro"
    assert recording.description.imu.accel == ("imu2_ax", "imu2_ay", "imu2_az")
    _is_of(recording, drive, dated=False)


def test_a_column_of_another_quantity_is_no_sensor(drive: Drive, tmp_path: Path, imported: Import) -> None:
    columns = {"t_s": drive.t}
    columns |= {f"Mag_{axis} [mG]": 400.0 + 0 * drive.t for axis in "XYZ"}
    columns |= {f"Gyro bias {axis} [deg/s]": 0.1 + 0 * drive.t for axis in "XYZ"} | {
        f"q{i}": 0.5 + 0 * drive.t for i in range(4)
    }
    columns |= {f"Gyr_{axis} [rad/s]": drive.gyro[:, i] for i, axis in enumerate("XYZ")}
    columns |= {f"Acc_{axis} [m/s^2]": drive.accel[:, i] for i, axis in enumerate("XYZ")}
    columns |= {f"Vel{axis} [m/s]": 0.6 * drive.speed for axis in "XYZ"}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)

    recording = imported(tmp_path / "log.csv").loaded.recording

    assert recording is not None
    assert recording.tach is None  # a velocity by axes is a receiver's
    _is_of(recording, drive, dated=False)


def test_posts_of_a_line_against_its_chainages(drive: Drive, tmp_path: Path, imported: Import) -> None:
    (source := tmp_path / "s").mkdir()
    _text(source / "imu.csv", [HEAD], _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6))
    _text(
        source / "posts.csv", ["time_s;Ort"], [["6.000", "PK 12k345"], ["9.000", "12k340"], ["14.000", "12 k 330"]], ";"
    )

    recording = imported(source).loaded.recording

    assert recording is not None
    assert recording.fixes is not None
    assert recording.fixes["chainage_m"].tolist() == [12_345.0, 12_340.0, 12_330.0]
    assert recording.description.track.direction == -1


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.ulg", b"ULog\x01\x12\x35" + bytes(500), "is a ULog of PX4, which is not read.*ulog2csv"),
        ("log.bin", b"\xa3\x95\x80" + bytes(500), "is a log of ArduPilot.*mavlogdump"),
        ("log.asc", b"%RAWIMUSA,2416,444720.0;2416,1,2,3,4,5,6,7*00\n" * 50, "NovAtel in ASCII.*novatel-edie"),
        ("log.txt", b"$VNIMU,+0.1,+0.2,+0.3,1,2,9.8,0,0,0,20,101*00\n" * 50, "VectorNav.*row number"),
        ("log.ods", b"PK\x03\x04", "OpenDocument.*save it as .xlsx or .csv"),
        ("log.pkl", b"\x80\x04", "a pickle.*to_parquet"),
        ("log.dat", b"|CF,2,1,1;" + bytes(50), "imc FAMOS"),
        ("log.csv.zst", b"\x28\xb5\x2f\xfd" + bytes(50), "zstd -d"),
        ("log.parquet", b"PAR1" + bytes(50), "log.parquet: cannot be read"),
        ("log.feather", b"ARROW1" + bytes(50), "log.feather: cannot be read"),
        ("log.db", b"SQLite format 3\0" + bytes(50), "log.db: cannot be read"),
        ("bag_0.db3", b"SQLite format 3\0" + bytes(50), "a SQLite database.*of a ROS 2 bag give the folder"),
        ("log.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "log.mat: cannot be read"),
        ("log.npz", b"PK\x03\x04" + bytes(50), "log.npz: cannot be read"),
        ("log.jsonl", b'{"t": 1}\n{"t": \n', "log.jsonl: row 2 is no JSON"),
        ("log.json", b'{"a": 1}', "log.json: holds no table"),
        ("log.csv.gz", gzip.compress(b"t,a\n1,2\n", mtime=0)[:-9], "log.csv.gz: cannot be unpacked"),
        ("log.tar", b"\0" * 100, "of no known format|cannot be unpacked"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_named_with_what_to_do(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInputError, match=message):
        source_format(tmp_path / name).tables(tmp_path / name, lambda _: None)


def test_lines_of_several_kinds_are_tables_that_a_mapping_names(drive: Drive, tmp_path: Path) -> None:
    lines = ["% a merged log", "% GYRO;Time(s);Gyr_X(rad/s);Gyr_Y(rad/s);Gyr_Z(rad/s);Accuracy"]
    for t, gyro, accel in zip(drive.t, drive.gyro, drive.accel, strict=True):
        lines.append(";".join(["GYRO", f"{t:.3f}", *(f"{value:.7f}" for value in gyro), "3"]))
        lines.append(";".join(["ACCE", f"{t:.3f}", *(f"{value:.7f}" for value in accel)]))
        if round(100 * t) % 100 == 0:
            lines.append("$GPRMC,031200.00,A,4654.0000,N,00724.0000,E,0.0,0.0,010526,,,A*5C")
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    form = source_format(tmp_path / "log.txt")

    tables = {table.name: table for table in form.tables(tmp_path / "log.txt", lambda _: None)}

    assert list(tables) == ["log.txt/GYRO", "log.txt/ACCE", "gnss"]
    assert tables["log.txt/GYRO"].columns == ["Time", "Gyr_X", "Gyr_Y", "Gyr_Z", "Accuracy"]
    imu = {
        "file": ["log.txt/GYRO", "log.txt/ACCE"],
        "time": "Time",
        "gyro": ["Gyr_X", "Gyr_Y", "Gyr_Z"],
        "accel": ["c2", "c3", "c4"],
    }
    mapping = mapping_of({"format": "trackfg-mapping/1", "imu": imu}, "m")
    recording = write_imported([*tables.values()], mapping, tmp_path / "r", run_id="r").loaded.recording
    assert recording is not None
    _is_of(recording, drive, dated=False)


@pytest.mark.parametrize("column", ["gx_dps", "v_kmh"])
def test_a_word_among_numbers_is_named_with_its_row(
    column: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    head = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,v_kmh"
    values = np.column_stack([drive.t, drive.gyro / DEG, drive.accel / G, 3.6 * drive.speed])
    rows = [[f"{value:.9f}" for value in row] for row in values]
    rows[700][head.split(",").index(column)] = "overflow"

    with pytest.raises(BadInputError, match=f"column '{column}', row 702: 'overflow' is not a number; expected a"):
        imported(_text(tmp_path / "log.csv", [head], rows))


@pytest.mark.parametrize("unit", ["rad", "1e-7 deg", "1e-7 deg, mm", "deg, ft", "ddmm"])
def test_coordinates_in_other_units(unit: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    degrees = np.interp(drive.t, drive.gnss_t, drive.latitude), np.full(drive.t.size, 7.4)
    written = {
        "rad": (np.radians(degrees), "lat [rad],lon [rad],alt [m]", "{:.12f}", 1.0),
        "1e-7 deg": (np.round(np.multiply(degrees, 1e7)), "lat,lon,height", "{:.0f}", 1000.0),
        "1e-7 deg, mm": (np.round(np.multiply(degrees, 1e7)), "lat_1e7,lon_1e7,alt_mm", "{:.0f}", 1000.0),
        "deg, ft": (np.asarray(degrees), "lat,lon,alt_ft", "{:.9f}", 1 / 0.3048),
        "ddmm": (np.floor(degrees) * 100.0 + np.mod(degrees, 1.0) * 60.0, "lat,lon,alt", "{:.7f}", 1.0),
    }
    coordinates, names, form, height = written[unit]
    rows = _cells(drive, _seconds(drive), rate=DEG, force=G, wheel=1 / 3.6)
    rows = [
        [*row, *(form.format(v) for v in place), f"{500 * height:.7f}"]
        for row, place in zip(rows, coordinates.T, strict=True)
    ]
    source = _text(tmp_path / "log.csv", [f"{HEAD},{names}"], rows)
    if unit == "ddmm":
        with pytest.raises(BadInputError, match="degrees and minutes in one number"):
            imported(source)
        return

    recording = imported(source).loaded.recording

    assert recording is not None
    assert recording.gnss_origin is not None
    np.testing.assert_allclose(recording.gnss_origin, [drive.latitude[0], 7.4, 500.0], atol=1e-6)


def test_axes_in_different_units_are_refused(drive: Drive, tmp_path: Path, imported: Import) -> None:
    source = _text(tmp_path / "log.csv", [HEAD.replace("az_g", "az_mps2")], _cells(drive, _seconds(drive)))
    with pytest.raises(BadInputError, match="columns ax_g, ay_g, az_mps2 are in g, g, mps2; expected one unit"):
        imported(source)


def test_an_accelerometer_of_other_signs_is_asked_for(drive: Drive, tmp_path: Path) -> None:
    source = _text(tmp_path / "log.csv", [HEAD], _cells(drive, _seconds(drive), rate=DEG, force=-G, wheel=1 / 3.6))

    recording, keys = _answered(source, tmp_path / "r", imu_accel_signs="other signs")

    assert "imu.accel_signs" in keys
    assert recording.description.imu.axes == "FLU"
    _is_of(recording, drive, dated=False)


@pytest.mark.parametrize(("own_rate", "question_default"), [(True, "yes"), (False, "no")])
def test_a_speed_that_changes_between_positions_is_taken_for_a_wheels(
    drive: Drive, tmp_path: Path, own_rate: bool, question_default: str
) -> None:
    """Beside positions of 1 Hz that a table of 100 Hz repeats: a receiver's speed is repeated with them."""
    last = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    speed = drive.speed if own_rate else np.interp(drive.gnss_t, drive.t, drive.speed)[last]
    columns = [drive.t, *drive.gyro.T, *drive.accel.T, speed, drive.latitude[last], drive.longitude[last]]
    names = ["time_s", *(f"{kind}_{axis}" for kind in ("gyro", "acc") for axis in "xyz"), "speed_mps", "lat", "lon"]
    pd.DataFrame(dict(zip(names, columns, strict=True))).to_csv(tmp_path / "log.csv", index=False)
    questions: dict[str, Question] = {}

    def ask(question: Question) -> str:
        questions[question.key] = question
        return question.default

    tables = source_format(tmp_path / "log.csv").tables(tmp_path / "log.csv", lambda _: None)
    proposal = propose(tables, ask, source_format(tmp_path / "log.csv").mapping(tables))
    assert questions["tach.column"].default == question_default
    assert ("tach" in proposal.sections) == own_rate
