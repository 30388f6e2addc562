"""Logs as vendors write them, each odd in ways of its own, come in as what was measured."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import START_NS, Drive

from trackfg.datasets.scenarios import Simulation
from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported, write_imported
from trackfg.interchange.importing.delimited.data_rows import is_remark
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import propose, unused_columns
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import read_stations
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.reading import read_times
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.recording.model import Recording

Import = Callable[..., Imported]


def _lines(path: Path, *lines: str, encoding: str = "utf-8") -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def _recording(imported: Imported) -> Recording:
    assert imported.loaded.recording is not None
    return imported.loaded.recording


def _rows(drive: Drive, written: Callable[[int], Iterable[str]], delimiter: str) -> list[str]:
    return [delimiter.join(written(i)) for i in range(drive.t.size)]


def _distance(drive: Drive) -> np.ndarray:
    return np.cumsum(drive.speed) / 100.0


def _german(value: float, decimals: int) -> str:
    return f"{value:,.{decimals}f}".translate(str.maketrans(",.", ".,"))


def test_digits_in_groups_decimal_commas_and_dates_in_two_columns(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    stamps = pd.to_datetime(drive.ns)
    distance = 900.0 + 100.0 * _distance(drive)
    names = "Datum;Uhrzeit;Gyro X [°/s];Gyro Y [°/s];Gyro Z [°/s];Beschl X [mg];Beschl Y [mg];Beschl Z [mg];Weg [m];"

    def written(i: int) -> list[str]:
        values = [*np.degrees(drive.gyro[i]), *(drive.accel[i] / STANDARD_GRAVITY * 1e3)]
        clock = stamps[i].strftime("%H:%M:%S,%f")
        return [stamps[i].strftime("%d.%m.%Y"), clock, *(_german(v, 9) for v in values), _german(distance[i], 4), ""]

    path = _lines(tmp_path / "Messung.csv", "Messfahrt;17", "", names, *_rows(drive, written, ";"), encoding="utf-16")

    back = _recording(imported(path))

    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)
    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    assert back.tach is not None
    np.testing.assert_allclose(np.diff(back.tach["distance_m"]), np.diff(distance), atol=1e-4)
    assert back.description.start == datetime.fromtimestamp(START_NS // 10**9, UTC)


def test_names_in_two_rows_above_a_row_of_units(drive: Drive, tmp_path: Path, imported: Import) -> None:
    def written(i: int) -> list[str]:
        us = f"{START_NS // 1000 + round(drive.t[i] * 1e6)}"
        return [us, *(f"{v:.12f}" for v in (*drive.gyro[i], *drive.accel[i])), f"{int(4096 * i / 100) % 65536}"]

    head = [
        "UTC;Gyroscope;;;Accelerometer;;;Encoder",
        ";X;Y;Z;X;Y;Z;",
        "[us];[rad/s];[rad/s];[rad/s];[m/s^2];[m/s^2];[m/s^2];[pulses]",
    ]
    path = _lines(tmp_path / "imu.txt", *head, *_rows(drive, written, ";"))

    back = _recording(imported(path, tach_pulses_per_rev="4096"))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)
    assert back.tach is not None
    assert (np.diff(back.tach["distance_m"]) > 0.0).all()


@pytest.mark.parametrize("wraps_at", [65536, None])
def test_a_count_of_a_wheel_that_turns_back_is_signed_and_goes_on(
    wraps_at: int | None, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    distance = 3.0 * np.sin(0.9 * drive.t) ** 2 - 1.0  # to and fro, and below where the count began
    count = np.floor(distance / 1e-5).astype(int) + 150_000
    names = "time_s;" + ";".join(f"{sensor}_{a}" for sensor in ("gyro", "acc") for a in "xyz") + ";pulses"

    def written(i: int) -> list[str]:
        shown = count[i] % wraps_at if wraps_at else count[i]
        return [f"{drive.t[i]:.3f}", *(f"{v:.9f}" for v in (*drive.gyro[i], *drive.accel[i])), f"{shown}"]

    path = _lines(tmp_path / "trolley.csv", names, *_rows(drive, written, ";"))
    diameter = str(1e-5 * 1000 / np.pi)

    back = _recording(imported(path, tach_pulses_per_rev="1000", tach_wheel_diameter_m=diameter))

    assert back.description.tach is not None
    assert back.description.tach.signed
    assert back.tach is not None
    np.testing.assert_allclose(np.diff(back.tach["distance_m"]), np.diff(distance), atol=1.1e-5)


def test_a_count_of_16_bits_that_only_falls_is_a_wheel_s_and_of_the_other_sense(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    distance = np.cumsum(drive.speed) / 100.0
    count = np.floor(distance / 1e-4).astype(int)
    names = "time_s;" + ";".join(f"{sensor}_{a}" for sensor in ("gyro", "acc") for a in "xyz") + ";pulses"

    def written(i: int) -> list[str]:
        values = (f"{v:.9f}" for v in (*drive.gyro[i], *drive.accel[i]))
        return [f"{drive.t[i]:.3f}", *values, f"{-count[i] % 65536}"]

    path = _lines(tmp_path / "log.csv", names, *_rows(drive, written, ";"))
    back = _recording(imported(path, tach_pulses_per_rev="1000", tach_wheel_diameter_m=str(0.1 / np.pi)))

    assert back.tach is not None
    np.testing.assert_allclose(np.diff(back.tach["distance_m"]), np.diff(distance), atol=1.1e-4)
    assert back.description.tach is not None
    assert not back.description.tach.signed
    assert back.description.imu.axes == "FLU"


def test_rows_of_one_pulse_each_are_counted(drive: Drive, tmp_path: Path, imported: Import) -> None:
    _write_imu(drive, tmp_path)
    distance = np.cumsum(drive.speed) / 100.0
    moving = distance > 0.0
    times = np.interp(np.arange(0.1, distance[-1], 0.1), distance[moving], drive.t[moving])
    _lines(tmp_path / "wheel.csv", "time_s,pulse", *(f"{t:.6f},1" for t in times))

    back = _recording(imported(tmp_path, tach_pulses_per_rev="10", tach_wheel_diameter_m=str(1.0 / np.pi)))

    assert back.tach is not None
    rolled = np.interp(back.tach["t_s"], drive.t, distance)
    np.testing.assert_allclose(back.tach["distance_m"] - back.tach["distance_m"].iloc[0], rolled - rolled[0], atol=0.01)


def test_the_way_of_each_row_is_one_however_smoothly_it_rises_and_falls(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    way = 0.01 * (1.0 + 0.5 * np.sin(drive.t))
    names = "time_s;" + ";".join(f"{sensor}_{a}" for sensor in ("gyro", "acc") for a in "xyz") + ";distance_m"

    def written(i: int) -> list[str]:
        return [f"{drive.t[i]:.3f}", *(f"{v:.9f}" for v in (*drive.gyro[i], *drive.accel[i], way[i]))]

    back = _recording(imported(_lines(tmp_path / "rows.csv", names, *_rows(drive, written, ";"))))

    assert back.tach is not None
    np.testing.assert_allclose(np.diff(back.tach["distance_m"]), way[1:], atol=1e-8)


def test_gps_week_and_the_time_in_it_are_a_date(drive: Drive, tmp_path: Path, imported: Import) -> None:
    since = (START_NS - pd.Timestamp("1980-01-06").value) // 10**9 + 18
    names = "%Week,TOW(s),GyroX(deg/s),GyroY(deg/s),GyroZ(deg/s),AccelX(g),AccelY(g),AccelZ(g),WheelSpeed(mph)"

    def written(i: int) -> list[str]:
        values = [*np.degrees(drive.gyro[i]), *(drive.accel[i] / STANDARD_GRAVITY), drive.speed[i] / 0.44704]
        return [f"{since // 604800}", f"{since % 604800 + drive.t[i]:.3f}", *(f"{v:.12f}" for v in values)]

    back = _recording(imported(_lines(tmp_path / "INS.csv", names, *_rows(drive, written, ","))))

    assert back.description.start == datetime.fromtimestamp(START_NS // 10**9, UTC)
    np.testing.assert_allclose(back.imu["t_s"], drive.t, atol=1e-6)
    assert back.tach is not None
    moved = np.gradient(back.tach["distance_m"], back.tach["t_s"])
    np.testing.assert_allclose(moved[1:-1], drive.speed[1:-1], atol=0.01)


@pytest.mark.parametrize("dated", [False, True])
def test_times_of_day_past_midnight_are_of_one_night(
    dated: bool, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    zero = pd.Timestamp("2026-04-30T23:59:50")
    stamps = zero + pd.to_timedelta(drive.t, unit="s")
    names = "\t".join(
        ["Heure", *(f"{what} {axis}" for what in ("Vitesse angulaire", "Accélération") for axis in "xyz")]
    )
    units = "\t°/s\t°/s\t°/s\tm/s²\tm/s²\tm/s²"
    form = "%Y-%m-%d %H:%M:%S.%f" if dated else "%H:%M:%S.%f"

    def written(i: int) -> list[str]:
        values = (*np.degrees(drive.gyro[i]), *drive.accel[i])
        return [stamps[i].strftime(form), *(f"{v:.9f}".replace(".", ",") for v in values)]

    folder = tmp_path / "log"
    _lines(folder / "capteur.dat", names, units, *_rows(drive, written, "\t"), encoding="cp1252")
    _lines(folder / "PK.txt", "Heure\tPK", "23:59:58.000\t12+050", "00:00:05.500\t12+055,5")

    back = _recording(imported(folder))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    assert back.fixes is not None
    np.testing.assert_allclose(back.fixes["t_s"] - back.imu["t_s"].iloc[0], [8.0, 15.5], atol=1e-6)
    np.testing.assert_allclose(back.fixes["chainage_m"], [12050.0, 12055.5])


@pytest.mark.parametrize("posts", ["Zeit;km", "Date;km"])
def test_times_without_their_hour_go_on_into_the_next_one(
    posts: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    zero = pd.Timestamp("2026-05-01T03:59:50.02")
    stamps = zero + pd.to_timedelta(drive.t, unit="s")

    def excel(stamp: pd.Timestamp) -> str:
        return f"{stamp:%M:%S},{stamp.microsecond // 100_000}"

    def written(i: int) -> list[str]:
        return [excel(stamps[i]), *(f"{v:.9f}".replace(".", ",") for v in (*drive.gyro[i], *drive.accel[i]))]

    names = "Zeit;Gyro X [rad/s];Gyro Y [rad/s];Gyro Z [rad/s];Beschl X [m/s2];Beschl Y [m/s2];Beschl Z [m/s2]"
    _lines(tmp_path / "log" / "imu.csv", names, *_rows(drive, written, ";"))
    passed = zero + pd.to_timedelta([12.0, 15.5], unit="s")
    form = excel if posts.startswith("Zeit") else "{:%d.%m.%Y %H:%M:%S.%f}".format
    _lines(
        tmp_path / "log" / "posts.csv",
        posts,
        f"{form(passed[0])};12050",
        f"{form(passed[1])};12055",
    )

    back = _recording(imported(tmp_path / "log"))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(np.diff(back.imu["t_s"]), 0.01, atol=1e-3)
    assert (back.description.start == datetime(2026, 5, 1, 3, 59, 50, tzinfo=UTC)) == (posts == "Date;km")
    assert back.fixes is not None
    np.testing.assert_allclose(back.fixes["t_s"] - back.imu["t_s"].iloc[0], [12.0, 15.5], atol=0.1)


def test_a_time_of_a_table_of_minutes_and_seconds_that_is_none_is_named(tmp_path: Path) -> None:
    table = SourceTable(
        "log.csv", pd.DataFrame({"time": pd.Series(["00:00.0", *["00:01.5"] * 200, "x"], dtype="string")})
    )
    with pytest.raises(BadInputError, match=r"row 202: 'x' is no time; expected one as 12:00\.5"):
        read_times(table, ("time",), TimeNotation())


def test_a_header_may_be_a_remark(drive: Drive, tmp_path: Path, imported: Import) -> None:
    values = np.column_stack([drive.t, drive.gyro, drive.accel, _distance(drive)])
    path = tmp_path / "run7.txt"
    np.savetxt(path, values, header="made by numpy\nt wx wy wz fx fy fz dist_m", fmt="%.12e")

    back = _recording(imported(path))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    assert back.tach is not None


def test_miles_feet_am_and_pm_and_a_last_line_that_is_none(drive: Drive, tmp_path: Path, imported: Import) -> None:
    stamps = pd.to_datetime(drive.ns)
    names = [
        "Date/Time",
        "Roll Rate (dps)",
        "Pitch Rate (dps)",
        "Yaw Rate (dps)",
        "Long. Accel (g)",
        "Lat. Accel (g)",
        "Vert. Accel (g)",
    ]
    names += ["Wheel Speed (mph)", "Latitude", "Longitude", "Altitude (ft)"]
    form = "%m/%d/%Y %I:%M:%S.%f %p"

    def written(i: int) -> list[str]:
        values = [*np.degrees(drive.gyro[i]), *(drive.accel[i] / STANDARD_GRAVITY), drive.speed[i] / 0.44704]
        at = min(i // 100, drive.gnss_t.size - 1)
        place = [drive.latitude[at], drive.longitude[at], drive.height[at] / 0.3048]
        return [f'"{cell}"' for cell in (stamps[i].strftime(form), *(f"{v:.12f}" for v in (*values, *place)))]

    folder = tmp_path / "log"
    head = ['"Logger","RailView 2"', "", ",".join(f'"{name}"' for name in names)]
    _lines(folder / "run.csv", *head, *_rows(drive, written, ","), '"End of log"')
    posts = [
        f"{stamps[i].strftime(form)},{place},signal {i}" for i, place in ((500, "12m 34.5ch"), (1500, "12 mi 900 yds"))
    ]
    _lines(folder / "mileposts.csv", "Time,Milepost,Feature", *posts)

    back = _recording(imported(folder))

    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)
    assert back.gnss_origin is not None
    assert back.gnss_origin[2] == pytest.approx(500.0)
    assert back.fixes is not None
    np.testing.assert_allclose(back.fixes["chainage_m"], [12 * 1609.344 + 34.5 * 20.1168, 12 * 1609.344 + 900 * 0.9144])
    np.testing.assert_allclose(back.fixes["t_s"], [5.0, 15.0], atol=1e-6)


def test_what_is_not_used_is_named(drive: Drive, tmp_path: Path) -> None:
    values = np.column_stack([drive.t, drive.gyro, drive.accel, 20.0 + 0.0 * drive.t])
    names = ["time_s", "gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z", "Bearing temperature"]
    pd.DataFrame(values, columns=names).to_csv(tmp_path / "log.csv", index=False)
    tables = source_format(tmp_path / "log.csv").tables(tmp_path / "log.csv", lambda _: None)

    unused = unused_columns(propose(tables, lambda question: question.default).sections, tables)

    assert unused == {"log.csv": ["Bearing temperature"]}


@pytest.mark.parametrize(
    ("line", "remark"),
    [
        ("End of log", True),
        ('"Ende der Aufzeichnung";;;', True),
        ("# clock set; 3 s", True),
        ("0.15;1.2", False),
        ("2026-05-01T03:1", False),
        ("ab", False),
        ("Gyro;x", False),
        ("caf\x07e", False),
    ],
)
def test_a_remark_among_the_rows_is_distinguished_from_a_row_cut_off(line: str, remark: bool) -> None:
    assert is_remark(line, ";") is remark


def test_only_groups_of_three_digits_are_one_number(tmp_path: Path) -> None:
    path = _lines(tmp_path / "log.csv", "t;a;b;c", "0,5;1'234,5;1.234;01.05.2026", "0,6;-999,25;12.345.678;02.05.2026")

    table = read_text(path)

    assert table.numbers("a").tolist() == [1234.5, -999.25]
    assert table.numbers("b").tolist() == [1234.0, 12345678.0]
    assert table.frame["c"].tolist() == ["01.05.2026", "02.05.2026"]


@pytest.mark.parametrize("own_table", [True, False])
def test_balises_of_a_mapping_are_those_of_the_recording(own_table: bool, drive: Drive, tmp_path: Path) -> None:
    imu = pd.DataFrame(np.column_stack([drive.t, drive.gyro, drive.accel]), columns=["t", *"abcdef"])
    passages = pd.DataFrame({"when": [5.0, 9.0, 15.0], "tag": ["17", "18", "17"], "km": ["1+050", "", "1+050"]})
    register = pd.DataFrame({"tag": [17, 18], "km": ["1+050", ""], "s": [0.2, np.nan]})
    tables = [SourceTable("imu", imu), SourceTable("read", passages), SourceTable("register", register)]
    balises = {"file": "read", "time": "when", "id": "tag", "chainage": "km", "reading_sd_m": 0.3}
    balises |= {"places": "register", "sd": "s"} if own_table else {"sd": 0.2}
    section = {"file": "imu", "gyro": list("abc"), "accel": list("def")}
    mapping = mapping_of({"format": "trackfg-mapping/1", "imu": section, "balises": balises}, "mapping")

    back = _recording(write_imported(tables, mapping, tmp_path / "rec", run_id="run"))

    assert back.balises is not None
    assert back.balises["id"].tolist() == ["17", "18", "17"]
    np.testing.assert_array_equal(back.balises["chainage_m"], [1050.0, np.nan, 1050.0])
    assert back.balises["chainage_sd_m"].iloc[0] == 0.2
    assert back.description.balises is not None
    assert back.description.balises.reading_sd_m == 0.3


def test_a_log_that_continues_from_file_to_file_is_one(drive: Drive, tmp_path: Path, imported: Import) -> None:
    columns = ["time_s", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    whole = pd.DataFrame(np.column_stack([drive.t, drive.gyro, drive.accel]), columns=columns)
    (tmp_path / "log").mkdir()
    for number, rows in enumerate((slice(0, 900), slice(900, 950), slice(950, None)), start=9):
        whole[rows].to_csv(tmp_path / f"log/part{number}.csv", index=False)

    back = _recording(imported(tmp_path / "log"))

    np.testing.assert_array_equal(back.imu["t_s"], drive.t)
    np.testing.assert_array_equal(back.gyro, drive.gyro)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_parts_of_a_log_that_hold_no_rows_are_left_out_and_named(
    form: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    columns = ["time_s", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    whole = pd.DataFrame(np.column_stack([drive.t, drive.gyro, drive.accel]), columns=columns)
    (tmp_path / "log").mkdir()
    for hour, rows in (("07", slice(0, 0)), ("08", slice(0, 900)), ("09", slice(900, None))):
        write = whole[rows].to_csv if form == "csv" else whole[rows].to_parquet
        write(tmp_path / f"log/imu_{hour}.{form}", index=False)
    if form == "csv":
        (tmp_path / "log/imu_10.csv").touch()

    back = imported(tmp_path / "log")
    notes = source_format(tmp_path / "log").tables(tmp_path / "log", lambda _: None)[0].notes

    np.testing.assert_array_equal(_recording(back).gyro, drive.gyro)
    named = ["imu_07.csv", "imu_10.csv"] if form == "csv" else ["imu_07.parquet"]
    assert [note for note in notes if "no rows" in note] == [f"{name}: has no rows: left out" for name in named]


def test_a_table_without_rows_that_continues_no_other_is_refused(tmp_path: Path) -> None:
    pd.DataFrame({"time_s": np.arange(20.0), "v": 1.0}).to_csv(tmp_path / "speed.csv", index=False)
    _lines(tmp_path / "gnss_1.csv", "time_s,lat,lon")

    with pytest.raises(BadInputError, match=r"gnss_1.csv: no rows of numbers found below the names of columns"):
        source_format(tmp_path).tables(tmp_path, lambda _: None)


@pytest.mark.parametrize("moved_s", [-5.0, 60.0])
def test_logs_that_overlap_or_are_far_apart_stay_two(moved_s: float, drive: Drive, tmp_path: Path) -> None:
    columns = ["time_s", *(f"gyro_{a}" for a in "xyz")]
    for number, begin in ((1, 0.0), (2, 20.0 + moved_s)):
        values = np.column_stack([begin + drive.t, drive.gyro])
        pd.DataFrame(values, columns=columns).to_csv(tmp_path / f"imu{number}.csv", index=False)

    tables = source_format(tmp_path).tables(tmp_path, lambda _: None)

    assert [table.name for table in tables] == ["imu1.csv", "imu2.csv"]


def test_increments_and_times_in_days_of_a_spreadsheet(drive: Drive, tmp_path: Path, imported: Import) -> None:
    days = 46143.25 + drive.t / 86400.0
    units = {"dTheta": "deg", "dVel": "m/s"}
    names = ";".join(["Zeitstempel", *(f"{name}_{a}[{unit}]" for name, unit in units.items() for a in "xyz")])

    def written(i: int) -> list[str]:
        steps = (*(np.degrees(drive.gyro[i]) / 100.0), *(drive.accel[i] / 100.0))
        return [f"{days[i]:.12f}", *(f"{v:.15f}" for v in steps)]

    back = _recording(imported(_lines(tmp_path / "imu.asc", names, *_rows(drive, written, ";"))))

    assert back.description.start == datetime(2026, 5, 1, 6, tzinfo=UTC)
    np.testing.assert_allclose(back.imu["t_s"], drive.t, atol=2e-6)
    np.testing.assert_allclose(back.accel, drive.accel, rtol=1e-4)
    np.testing.assert_allclose(back.gyro, drive.gyro, rtol=1e-4)


def test_a_workbook_with_units_balises_and_their_register(drive: Drive, tmp_path: Path, imported: Import) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "IMU"
    sheet.append(["Measurement 17"])
    sheet.append(["Time", *(f"w{a}" for a in "xyz"), *(f"a{a}" for a in "xyz"), "Odometer"])
    sheet.append(["s", *["deg/s"] * 3, *["g"] * 3, "ft"])
    distance = _distance(drive)
    for i in range(drive.t.size):
        rates, forces = np.degrees(drive.gyro[i]), drive.accel[i] / STANDARD_GRAVITY
        sheet.append([drive.t[i], *map(float, rates), *map(float, forces), distance[i] / 0.3048])
    passages, register = book.create_sheet("Read"), book.create_sheet("Register")
    for row in (["Time", "Balise ID"], [8.0, 4711], [15.0, 4712]):
        passages.append(row)
    for row in (["Balise ID", "km", "sd_m"], [4711, "12+345", 0.2], [4712, "12+350.5", 0.3]):
        register.append(row)
    book.save(tmp_path / "run.xlsx")

    back = _recording(imported(tmp_path / "run.xlsx"))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)
    assert back.tach is not None
    np.testing.assert_allclose(np.ptp(back.tach["distance_m"]), np.ptp(distance))
    assert back.fixes is None
    assert back.balises is not None
    assert back.balises["id"].tolist() == ["4711", "4712"]
    assert back.balises["chainage_m"].tolist() == [12345.0, 12350.5]
    assert back.balises["chainage_sd_m"].tolist() == [0.2, 0.3]


@pytest.mark.parametrize("names", ["t,id,km", "t;Balisen-Nr.;Kilometer"])
def test_ids_beside_places_are_those_of_balises(names: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    _write_imu(drive, tmp_path)
    rows = ["8.0,4711,12+345.0", "15.0,4712,12+350.5"]
    text = "\n".join([names, *rows]) + "\n"
    (tmp_path / "balises.csv").write_text(text.replace(",", ";") if ";" in names else text)

    back = _recording(imported(tmp_path))

    assert back.fixes is None
    assert back.balises is not None
    assert back.balises["id"].tolist() == ["4711", "4712"]
    assert back.balises["chainage_m"].tolist() == [12345.0, 12350.5]


def test_balises_of_a_line_against_its_chainages(drive: Drive, tmp_path: Path, imported: Import) -> None:
    _write_imu(drive, tmp_path)
    (tmp_path / "balises.csv").write_text("t,id,km\n8.0,4712,12+350.5\n15.0,4711,12+345.0\n")

    assert _recording(imported(tmp_path)).description.track.direction == -1


def test_an_id_of_samples_is_none_of_balises(drive: Drive, tmp_path: Path, imported: Import) -> None:
    _write_imu(drive, tmp_path)
    table = pd.read_csv(tmp_path / "imu.csv")
    table.assign(id=range(len(table))).to_csv(tmp_path / "imu.csv", index=False)
    (tmp_path / "posts.csv").write_text("t,km\n8.0,12+345.0\n15.0,12+350.5\n")

    back = _recording(imported(tmp_path))

    assert back.balises is None
    assert back.fixes is not None


def _write_imu(drive: Drive, folder: Path) -> None:
    values = np.column_stack([drive.t, drive.gyro, drive.accel])
    names = ["time_s", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    pd.DataFrame(values, columns=names).to_csv(folder / "imu.csv", index=False)


@pytest.mark.parametrize(
    ("columns", "unit_m", "step_m"),
    [(("MP", "FEET"), 1609.344, 0.3048), (("Mile", "Yards"), 1609.344, 0.9144), (("km", "m"), 1000.0, 1.0)],
)
def test_posts_are_places_in_two_columns(
    columns: tuple[str, str], unit_m: float, step_m: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _write_imu(drive, tmp_path)
    # The last post is one of a mile, or kilometre, that is longer than it should be.
    rest = np.array([100.0, 345.5, unit_m / step_m + 30.0])
    posts = pd.DataFrame({"time_s": [2.0, 8.0, 15.0], columns[0]: 12, columns[1]: rest})
    posts.to_csv(tmp_path / "posts.csv", index=False)

    back = _recording(imported(tmp_path))

    np.testing.assert_allclose(back.fixes["chainage_m"], 12 * unit_m + step_m * rest, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "unit_m"), [("MP", 1609.344), ("Milepost", 1609.344), ("PK", 1000.0), ("Post ft", 0.3048)]
)
def test_the_name_of_a_column_of_places_is_its_unit(
    name: str, unit_m: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _write_imu(drive, tmp_path)
    pd.DataFrame({"time_s": [2.0, 8.0], name: [12.25, 12.5]}).to_csv(tmp_path / "posts.csv", index=False)

    back = _recording(imported(tmp_path))

    np.testing.assert_allclose(back.fixes["chainage_m"], unit_m * np.array([12.25, 12.5]), rtol=1e-12)


def test_mileposts_count_by_the_kilometrage_of_the_mapping() -> None:
    foot = 0.3048
    equations = [{"chainage_m": 0.0, "km": "12 mi"}, {"chainage_m": 5310 * foot, "km": "13 mi"}]
    line = LineKilometrage.model_validate({"equation": equations}).kilometrage()
    table = SourceTable("posts.csv", pd.DataFrame({"MP": [12, 12, 13], "FEET": [100.0, 5300.0, 5.0]}))

    chainage = read_stations(table, ("MP", "FEET"), "mi", line)

    np.testing.assert_allclose(chainage, foot * np.array([100, 5300, 5315]), atol=1e-6)


def _table(drive: Drive, force: list[str], rate: list[str], more: dict[str, np.ndarray], g: float) -> pd.DataFrame:
    columns = {name: drive.accel[:, i] / g for i, name in enumerate(force)}
    columns |= {name: drive.gyro[:, i] for i, name in enumerate(rate)}
    return pd.DataFrame(columns | more)


def test_a_phone_s_estimate_of_gravity_is_no_accelerometer(drive: Drive, tmp_path: Path, imported: Import) -> None:
    units = {"ACCELEROMETER": "m/s²", "GYROSCOPE": "rad/s", "GRAVITY": "m/s²", "LINEAR ACCELERATION": "m/s²"}
    names = [[f"{name} {axis} ({unit})" for axis in "XYZ"] for name, unit in units.items()]
    gravity = np.array([0.0, 0.0, 9.81])
    more = {name: np.full(drive.t.size, gravity[i]) for i, name in enumerate(names[2])}
    more |= {name: drive.accel[:, i] - gravity[i] for i, name in enumerate(names[3])}
    more["Time since start in ms "] = np.round(1e3 * drive.t).astype(int)
    _table(drive, names[0], names[1], more, 1.0).to_csv(tmp_path / "andro.csv", index=False, sep=";")

    np.testing.assert_allclose(_recording(imported(tmp_path / "andro.csv")).accel, drive.accel, atol=1e-9)


def test_of_two_accelerations_that_state_no_unit_the_one_with_gravity_is_taken(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    more = {f"a{axis}": drive.accel[:, i] - (9.81 if axis == "z" else 0.0) for i, axis in enumerate("xyz")}
    more |= {f"B{axis}": np.full(drive.t.size, value) for axis, value in zip("xyz", (20, 0, -40), strict=True)}
    table = _table(drive, ["gFx", "gFy", "gFz"], ["wx", "wy", "wz"], more, STANDARD_GRAVITY)
    table.insert(0, "time", drive.t)
    table.to_csv(tmp_path / "toolbox.csv", index=False)

    np.testing.assert_allclose(_recording(imported(tmp_path / "toolbox.csv")).accel, drive.accel, atol=1e-9)


def test_g_forces_are_an_acceleration(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _table(drive, [f"GForce{a}" for a in "XYZ"], [f"Gyro{a}" for a in "XYZ"], {}, STANDARD_GRAVITY)
    table.insert(0, "Time", pd.to_datetime(drive.ns).strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    lines = table.to_csv(index_label="Record").splitlines()
    path = _lines(tmp_path / "box.csv", "Format,RaceBox CSV", "Track,None", "Laps,0", "", *lines)

    np.testing.assert_allclose(_recording(imported(path)).accel, drive.accel, atol=1e-9)


@pytest.mark.parametrize("ticks", [np.arange(2000) * 10_000 + 3_900_000, np.full(2000, np.nan)])
def test_sample_time_fine_may_count_microseconds_or_be_empty(
    ticks: np.ndarray, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    more = {"SampleTimeFine": ticks, "PacketCounter": np.arange(2000)}
    names = [[f"{name}_{axis}" for axis in "XYZ"] for name in ("Acc", "Gyr")]
    table = _table(drive, *names, more, 1.0).astype({"SampleTimeFine": "Int64"})
    path = _lines(tmp_path / "dot.csv", "OutputRate:,100Hz", *table.to_csv(index=False).splitlines())

    back = _recording(imported(path))

    np.testing.assert_allclose(back.imu["t_s"] - back.imu["t_s"].iloc[0], drive.t, atol=1e-6)


def test_curves_of_the_positions_show_a_gyro_s_unit(
    simulated_in_full: Callable[..., Simulation], tmp_path: Path, imported: Import
) -> None:
    """In mrad/s they are as large as rates in deg/s may be; the path turns by as many mrad."""
    drive = Drive.of(simulated_in_full("mainline-field", seed=1, duration_s=300.0).recording)
    at = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    more = {"time": drive.t, "latitude": drive.latitude[at], "longitude": drive.longitude[at]}
    names = [[f"{name}_{axis}" for axis in "xyz"] for name in ("acc", "gyro")]
    _table(drive._replace(gyro=1e3 * drive.gyro), *names, more, 1.0).to_csv(tmp_path / "slow.csv", index=False)

    back = _recording(imported(tmp_path / "slow.csv"))

    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "lost", "found"), [("fix_quality", 0, 4), ("valid", "V", "A"), ("gnssFixOk", False, True)]
)
def test_rows_in_which_a_receiver_has_no_position_are_left_out(
    name: str, lost: Any, found: Any, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    """They repeat the last position, or are the receiver's own guess."""
    _write_imu(drive, tmp_path)
    known = np.arange(20) % 5 > 0
    places = {"lat": drive.latitude, "lon": drive.longitude, "alt": drive.height}
    table = pd.DataFrame({"time_s": drive.gnss_t, **places, name: np.where(known, found, lost)})
    table["HDOP"] = np.where(known, 1.5, 99.9)
    table.to_csv(tmp_path / "gps.csv", index=False)

    gnss = _recording(imported(tmp_path)).gnss

    assert gnss is not None
    np.testing.assert_allclose(gnss["t_s"], drive.gnss_t[known])
    np.testing.assert_allclose(gnss["east_sd_m"], 1.5 * (0.05 if found == 4 else 3.0))  # RTK


@pytest.mark.parametrize(
    ("title", "start"),
    [
        (["Datum;01.05.2026", "Messzug;MT-4"], datetime(2026, 5, 1, 3, 12, tzinfo=UTC)),
        (["run of 2026-05-01"], datetime(2026, 5, 1, 3, 12, tzinfo=UTC)),
        (["calibrated 2025-11-03", "run of 2026-05-01"], None),
    ],
)
def test_times_of_day_are_on_the_one_day_that_a_line_above_them_states(
    title: list[str], start: datetime | None, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    table = _table(drive, ["acc_x", "acc_y", "acc_z"], ["gyro_x", "gyro_y", "gyro_z"], {}, 1.0)
    table.insert(0, "time", pd.to_datetime(drive.ns).strftime("%H:%M:%S.%f"))
    path = _lines(tmp_path / "run.csv", *title, *table.to_csv(index=False, sep=";").splitlines())

    back = _recording(imported(path))

    assert back.description.start == start
    np.testing.assert_allclose(back.imu["t_s"] - back.imu["t_s"].iloc[0], drive.t, atol=1e-6)


@pytest.mark.parametrize("name", ["Horodatage", "Fecha y hora", "Zp."])
def test_a_column_of_dates_is_the_time_whatever_its_name(
    name: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    table = _table(drive, ["acc_x", "acc_y", "acc_z"], ["gyro_x", "gyro_y", "gyro_z"], {}, 1.0)
    table.insert(0, "Remarque", "essai: 1")
    table.insert(1, name, pd.to_datetime(drive.ns).strftime("%d.%m.%Y %H:%M:%S.%f"))
    table.to_csv(tmp_path / "run.csv", index=False, sep=";", decimal=",")

    back = _recording(imported(tmp_path / "run.csv"))

    assert back.description.start == datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    np.testing.assert_allclose(back.imu["t_s"] - back.imu["t_s"].iloc[0], drive.t, atol=1e-6)
