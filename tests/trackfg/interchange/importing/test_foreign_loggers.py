"""Loggers and converters with habits of their own: overlapping files, arrays in brackets, solutions, other frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import START_NS, Drive
from typer.testing import CliRunner

import trackfg
from trackfg.cli.main import app
from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.sources.receivers.gnss_log import read_positions
from trackfg.numerics import geodesy
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
_LEAP_NS = 18_000_000_000
"""GPS time is so far ahead of UTC, ns."""


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def _table(drive: Drive) -> pd.DataFrame:
    columns = {f"gyro_{axis} [rad/s]": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"acc_{axis} [m/s^2]": drive.accel[:, i] for i, axis in enumerate("xyz")}
    return pd.DataFrame({"time [s]": drive.t, **columns, "wheel_speed [m/s]": drive.speed})


@pytest.mark.parametrize("moved", [0.0, 1e-3])
def test_files_that_begin_with_the_last_rows_of_the_one_before_are_one_log(
    moved: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    """Other rows at the same times are another log's, and none of the two is chosen without a question."""
    source = tmp_path / "log"
    source.mkdir()
    table = _table(drive)
    table[:1200].to_csv(source / "log_00.csv", index=False)
    table[1000:].assign(**{"gyro_x [rad/s]": drive.gyro[1000:, 0] + moved}).to_csv(source / "log_01.csv", index=False)
    recording = _recording(imported(source))
    assert len(recording.imu) == (2000 if moved == 0.0 else 1200)
    np.testing.assert_allclose(recording.imu["t_s"], drive.t[: len(recording.imu)])


def test_numbers_in_brackets_are_axes_of_an_array_and_no_units(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """As ``ulog2csv`` writes the logs of PX4."""
    us = np.round((drive.t + 3.0) * 1e6).astype(np.int64)
    columns = {f"gyro_rad[{i}]": drive.gyro[:, i] for i in range(3)} | {"gyro_integral_dt": 5000}
    columns |= {f"accelerometer_m_s2[{i}]": drive.accel[:, i] for i in range(3)}
    source = tmp_path / "log"
    source.mkdir()
    pd.DataFrame({"timestamp": us, **columns}).to_csv(source / "log_sensor_combined_0.csv", index=False)
    places = {
        "lat": np.round(drive.latitude * 1e7).astype(np.int64),
        "lon": np.round(drive.longitude * 1e7).astype(np.int64),
        "alt": np.round(drive.height * 1e3).astype(np.int64),
        "vel_m_s": np.interp(drive.gnss_t, drive.t, drive.speed),
    }
    stamps = np.round((drive.gnss_t + 3.0) * 1e6).astype(np.int64)
    pd.DataFrame({"timestamp": stamps, **places}).to_csv(source / "log_vehicle_gps_position_0.csv", index=False)

    recording = _recording(imported(source, imu_gyro_unit="rad/s"))

    np.testing.assert_allclose(recording.gyro, drive.gyro)
    np.testing.assert_allclose(recording.accel, drive.accel)
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.others["gnss_speed"]["speed_mps"], places["vel_m_s"])


def _solution(path: Path, drive: Drive, scale: str = "GPST", *, weeks: bool = False, velocity: bool = False) -> Path:
    named = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio"
    motion = " vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun"
    lines = ["% program : RTKLIB ver.2.4.3", f"%  {scale}    {named}{motion if velocity else ''}"]
    for i, ns in enumerate(drive.gnss_ns + (_LEAP_NS if scale == "GPST" else 0)):
        stamp = pd.Timestamp(int(ns))
        clock = f"{stamp:%Y/%m/%d %H:%M:%S}.{stamp.microsecond // 1000:03d}"
        if weeks:
            seconds = (stamp - pd.Timestamp("1980-01-06")).total_seconds()
            clock = f"{int(seconds // 604800)} {seconds % 604800:.3f}"
        place = f"{drive.latitude[i]:.9f} {drive.longitude[i]:.9f} {drive.height[i]:.4f} 1 12 0.02 0.01 0.03 0 0 0"
        lines.append(f"{clock} {place} 0.00 15.3" + (" 3.0 4.0 0.0 0.06 0.08 0.1 0 0 0" if velocity else ""))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("scale", "weeks"), [("GPST", False), ("GPST", True), ("UTC", False)])
def test_a_solution_of_rtklib_lies_beside_the_tables(
    scale: str, weeks: bool, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _table(drive).assign(**{"time [s]": drive.ns}).rename(columns={"time [s]": "time_ns"}).to_csv(
        source / "imu.csv", index=False
    )
    _solution(source / "rover.pos", drive, scale, weeks=weeks, velocity=True)

    recording = _recording(imported(source))

    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["t_s"], drive.gnss_t, atol=1e-6)
    sigmas = recording.gnss[["east_sd_m", "north_sd_m", "up_sd_m"]]
    np.testing.assert_allclose(sigmas, np.tile([0.01, 0.02, 0.03], (len(sigmas), 1)))
    np.testing.assert_allclose(recording.others["gnss_speed"]["speed_mps"], 5.0)


def test_a_solution_of_rtklib_in_ecef_has_the_sigmas_of_its_covariance(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _table(drive).assign(**{"time [s]": drive.ns}).rename(columns={"time [s]": "time_ns"}).to_csv(
        source / "imu.csv", index=False
    )
    place = geodesy.geodetic_to_ecef(np.stack([drive.latitude, drive.longitude, drive.height], axis=1))
    sd_enu = np.array([0.01, 0.02, 0.05])
    lines = [
        "%  GPST  x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio vx(m/s) "
        "vy(m/s) vz(m/s) sdvx sdvy sdvz sdvxy sdvyz sdvzx"
    ]
    for i, ns in enumerate(drive.gnss_ns + _LEAP_NS):
        to_ecef = geodesy.ecef_from_enu(drive.latitude[i], drive.longitude[i])
        covariance = to_ecef @ np.diag(sd_enu**2) @ to_ecef.T
        parts = covariance[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]
        roots = " ".join(f"{root:.7f}" for root in np.sign(parts) * np.sqrt(np.abs(parts)))
        velocity = to_ecef @ [3.0, 4.0, 0.5]
        numbers = (
            f"{' '.join(f'{x:.4f}' for x in place[i])} 1 12 {roots} 0.00 15.3 {' '.join(map(str, velocity))} {roots}"
        )
        lines.append(f"{pd.Timestamp(int(ns)):%Y/%m/%d %H:%M:%S.%f} {numbers}")
    (source / "rover.pos").write_text("\n".join(lines) + "\n")

    recording = _recording(imported(source))

    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["t_s"], drive.gnss_t, atol=1e-6)
    sigmas = recording.gnss[["east_sd_m", "north_sd_m", "up_sd_m"]]
    np.testing.assert_allclose(sigmas, np.tile(sd_enu, (len(sigmas), 1)), rtol=1e-3)
    north = np.radians(drive.latitude) * 6_371_000.0
    np.testing.assert_allclose(np.ptp(recording.gnss["north_m"]), np.ptp(north), rtol=5e-3)
    np.testing.assert_allclose(recording.others["gnss_speed"]["speed_mps"], 5.0)


def test_a_solution_in_another_form_is_refused_by_name(drive: Drive, tmp_path: Path) -> None:
    path = _solution(tmp_path / "rover.pos", drive, "JST")
    with pytest.raises(BadInputError, match=r"rover\.pos: has no line '% GPST .*Hint: set out-solformat = llh"):
        read_positions(path)
    path = _solution(tmp_path / "rover.pos", drive)
    path.write_text(path.read_text().replace("latitude(deg) longitude(deg) height(m)", "e-baseline(m) n-baseline(m) u"))
    with pytest.raises(BadInputError, match=r"rover\.pos: .*expected a solution of RTKLIB in degrees or ECEF"):
        read_positions(path)
    path = _solution(tmp_path / "rover.pos", drive)
    path.write_text(path.read_text() + "2026/05/01 03:12\n")
    with pytest.raises(BadInputError, match=r"rover\.pos: row 23: expected 15 cells"):
        read_positions(path)


def test_files_of_a_folder_that_are_not_read_are_named(drive: Drive, tmp_path: Path) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _table(drive).to_csv(source / "imu.csv", index=False)
    for name in ("rover.obs", "README.txt", ".hidden"):
        (source / name).write_text("x")
    done = CliRunner().invoke(app, ["init", str(source), "-o", str(tmp_path / "rec"), "--yes"])
    assert done.exit_code == 0, done.output
    assert "not read of log: rover.obs\n" in done.output.replace("README", "X")


@pytest.mark.parametrize("again", [1, 3])
def test_a_logger_that_starts_anew_writes_the_names_again(
    again: int, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    names, *rows = _table(drive).to_csv(index=False).splitlines()
    for i in range(again):
        rows.insert(300 * (i + 1), names)
    (tmp_path / "log.csv").write_text("\n".join([names, *rows]))
    recording = _recording(imported(tmp_path / "log.csv"))
    np.testing.assert_allclose(recording.imu["t_s"], drive.t)
    np.testing.assert_allclose(recording.gyro, drive.gyro)


def _quoted(rows: list[list[object]]) -> str:
    return "\r\n".join(",".join(f'"{cell}"' for cell in row) for row in rows)


def test_accelerations_of_a_receiver_are_no_coordinates(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """As AiM's loggers write them, beside the inertial ones, which are named by the vehicle's axes."""
    at = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    columns: dict[str, tuple[str, np.ndarray]] = {
        "Time": ("s", drive.t),
        "GPS Nsat": ("#", 0.0 * drive.t + 9.0),
        "GPS LatAcc": ("g", 0.01 * np.sin(drive.t)),
        "GPS LonAcc": ("g", 0.01 * np.cos(drive.t)),
        "GPS Latitude": ("deg", drive.latitude[at]),
        "GPS Longitude": ("deg", drive.longitude[at]),
    }
    forces, rates = ("InlineAcc", "LateralAcc", "VerticalAcc"), ("RollRate", "PitchRate", "YawRate")
    columns |= {name: ("g", drive.accel[:, i] / 9.80665) for i, name in enumerate(forces)}
    columns |= {name: ("deg/s", np.degrees(drive.gyro[:, i])) for i, name in enumerate(rates)}
    rows = np.column_stack([values for _, values in columns.values()]).tolist()
    units = [unit for unit, _ in columns.values()]
    head = _quoted([["Format", "AiM CSV File"], ["Date", "Friday, May 1, 2026"], ["Sample Rate", "100"]])
    text = f"{head}\r\n\r\n{_quoted([list(columns), units])}\r\n\r\n{_quoted(rows)}\r\n"
    (tmp_path / "session.csv").write_text(text)

    recording = _recording(imported(tmp_path / "session.csv"))

    np.testing.assert_allclose(recording.accel, drive.accel, rtol=1e-9)
    np.testing.assert_allclose(recording.gyro, drive.gyro, rtol=1e-9)
    assert recording.gnss_origin is not None
    np.testing.assert_allclose(recording.gnss_origin[:2], [46.9, 7.4], atol=1e-6)


def test_cells_in_quotation_marks_may_have_decimal_commas_between_commas(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    table = _table(drive)
    rows = [[str(value).replace(".", ",") for value in row] for row in table.to_numpy().tolist()]
    (tmp_path / "log.csv").write_text(_quoted([list(table.columns), *rows]))
    recording = _recording(imported(tmp_path / "log.csv"))
    np.testing.assert_allclose(recording.gyro, drive.gyro, rtol=1e-12)


@pytest.mark.parametrize(("name", "is_wheels"), [("distance_traveled (m)", False), ("wheel distance (m)", True)])
def test_a_way_beside_positions_is_the_receiver_s_unless_its_name_says_a_wheel(
    name: str, is_wheels: bool, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    at = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    places = {"latitude": drive.latitude[at], "longitude": drive.longitude[at]}
    way = {name: np.cumsum(drive.speed) / 100.0}
    _table(drive).drop(columns="wheel_speed [m/s]").assign(**places, **way).to_csv(tmp_path / "log.csv", index=False)
    assert (_recording(imported(tmp_path / "log.csv")).tach is not None) == is_wheels


def test_turns_of_a_wheel_are_its_speed(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _table(drive).drop(columns="wheel_speed [m/s]")
    table["Raddrehzahl [1/min]"] = drive.speed / (np.pi * 0.92) * 60.0
    table["Motordrehzahl [1/min]"] = 900.0
    table.to_csv(tmp_path / "log.csv", index=False)
    tach = _recording(imported(tmp_path / "log.csv")).tach
    assert tach is not None
    np.testing.assert_allclose(np.gradient(tach["distance_m"], tach["t_s"])[5:-5], drive.speed[5:-5], atol=0.02)


def test_an_hour_that_local_time_skips_has_a_hint(drive: Drive, tmp_path: Path) -> None:
    local = pd.to_datetime(pd.Timestamp("2026-03-29T00:59:50Z").value + drive.ns - START_NS).tz_localize("UTC")
    clock = local.tz_convert("Europe/Berlin")
    table = _table(drive)
    table.insert(0, "Datum", clock.strftime("%d.%m.%Y %H:%M:%S.%f"))
    table.drop(columns="time [s]").to_csv(tmp_path / "log.csv", index=False)
    command = ["init", str(tmp_path / "log.csv"), "--yes", "-o"]
    assert CliRunner().invoke(app, [*command, str(tmp_path / "rec")]).exit_code == 2
    hints = [finding.hint or "" for finding in trackfg.check_recording(tmp_path / "rec").findings]
    assert any("where local times go over to summer time: import them with their time_zone" in hint for hint in hints)
    mapping = (tmp_path / "rec.mapping.toml").read_text().replace('time_zone = "UTC"', 'time_zone = "Europe/Berlin"')
    (tmp_path / "zone.toml").write_text(mapping)
    right = ["import", str(tmp_path / "log.csv"), "--mapping", str(tmp_path / "zone.toml"), "-o", str(tmp_path / "b")]
    assert CliRunner().invoke(app, right).exit_code == 0


def test_a_gyro_that_is_too_fast_in_degrees_is_in_a_smaller_unit(drive: Drive, tmp_path: Path) -> None:
    table = _table(drive).rename(columns=lambda name: name.replace("[rad/s]", "[deg/s]"))
    for axis, rate in zip("xyz", drive.gyro.T, strict=True):
        table[f"gyro_{axis} [deg/s]"] = 1e3 * np.degrees(rate + 0.1)
    table.to_csv(tmp_path / "log.csv", index=False)
    out = ["init", str(tmp_path / "log.csv"), "--yes", "-o", str(tmp_path / "rec")]
    assert CliRunner().invoke(app, out).exit_code == 2
    (finding,) = (one for one in trackfg.check_recording(tmp_path / "rec").findings if one.code == "gyro-unit")
    assert finding.hint is not None
    assert finding.hint.startswith("the data are in a smaller unit than deg/s")


def test_an_imu_of_a_ros_bag_that_lies_on_its_side_gets_its_axes_from_the_data(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    pytest.importorskip("rosbags")
    from interchange.foreign_forms import WRITERS

    turned = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # left, down, back
    source = WRITERS["ros"](drive._replace(gyro=drive.gyro @ turned.T, accel=drive.accel @ turned.T), tmp_path)
    recording = _recording(imported(source))
    assert recording.description.imu.axes == "LDB"
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-9)
