"""The speed that a receiver measures itself, as phones, receivers and loggers write it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive, write_phyphox, write_sensor_logger

from trackfg.datasets.scenarios import Simulation
from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.sources.phones import Phyphox
from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log
from trackfg.numerics.units import KMH, KNOT
from trackfg.recording.model import Recording

Import = Callable[..., Imported]


def recording_of(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def rewritten(folder: Path, name: str, **columns: object) -> Path:
    """Put further columns into a file of an unpacked zip in ``folder``."""
    import zipfile

    (path,) = folder.glob("*.zip")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder / "log")
    file = folder / "log" / name
    pd.read_csv(file).assign(**columns).to_csv(file, index=False)
    return folder / "log"


def test_a_phone_s_speed_comes_with_its_accuracy(drive: Drive, tmp_path: Path, imported: Import) -> None:
    write_sensor_logger(drive, tmp_path)
    speed = np.interp(drive.gnss_t, drive.t, drive.speed)
    speed[3] = -1.0  # as a phone writes where it knows none
    source = rewritten(tmp_path, "Location.csv", speed=speed, speedAccuracy=0.4, bearingAccuracy=20.0)

    table = recording_of(imported(source)).others["gnss_speed"]

    known = np.arange(len(speed)) != 3
    np.testing.assert_allclose(table["t_s"], drive.gnss_t[known])
    np.testing.assert_allclose(table["speed_mps"], speed[known])
    np.testing.assert_allclose(table["speed_sd_mps"], 0.4)


@pytest.mark.parametrize("written", [0.0, -1.0])
def test_a_phone_that_knows_no_accuracy_has_the_usual_one(
    written: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    write_sensor_logger(drive, tmp_path)
    source = rewritten(tmp_path, "Location.csv", speed=5.0, speedAccuracy=written)
    np.testing.assert_allclose(recording_of(imported(source)).others["gnss_speed"]["speed_sd_mps"], 0.1)


def test_a_phone_that_knows_no_speed_has_none(drive: Drive, tmp_path: Path, imported: Import) -> None:
    write_sensor_logger(drive, tmp_path)
    source = rewritten(tmp_path, "Location.csv", speed=-1.0, speedAccuracy=-1.0)
    recording = recording_of(imported(source))
    assert recording.description.gnss_speed is None
    assert recording.gnss is not None


def test_phyphox_calls_it_velocity(drive: Drive, tmp_path: Path, imported: Import) -> None:
    write_phyphox(drive, tmp_path)
    source = rewritten(tmp_path, "Location.csv", **{"Velocity (m/s)": 5.0, "Direction (°)": 90.0})
    assert Phyphox().recognises(source)
    np.testing.assert_allclose(recording_of(imported(source)).others["gnss_speed"]["speed_mps"], 5.0)


def test_a_receiver_s_messages_have_speeds(tmp_path: Path) -> None:
    import pyubx2

    message = pyubx2.UBXMessage(
        "NAV", "NAV-PVT", pyubx2.GET,
        year=2026, month=5, day=1, hour=3, min=12, second=0, fixType=3, gnssFixOk=1,
        lat=46.9, lon=7.4, height=500_000, hAcc=1414, vAcc=2000, gSpeed=12_345, sAcc=210,
    )  # fmt: skip
    (tmp_path / "log.ubx").write_bytes(message.serialize())
    ubx = read_gnss_log(tmp_path / "log.ubx").frame
    np.testing.assert_allclose(ubx.loc[0, ["speed_mps", "sd_speed_mps"]], [12.345, 0.21])

    sentences = "GNGGA,031200.00,4654.0000,N,00724.0000,E,1,10,0.9,450.0,M,50.0,M,,"
    timed = "GNRMC,031200.00,A,4654.0000,N,00724.0000,E,24.0,90.0,010526,,,A"
    (tmp_path / "log.nmea").write_text(sentence(timed) + sentence(sentences))
    nmea = read_gnss_log(tmp_path / "log.nmea").frame
    np.testing.assert_allclose(nmea["speed_mps"], 24.0 * KNOT)
    assert "sd_speed_mps" not in nmea


def sentence(text: str) -> str:
    checksum = 0
    for character in text:
        checksum ^= ord(character)
    return f"${text}*{checksum:02X}\r\n"


def with_vtg(path: Path, *, first: bool) -> np.ndarray:
    """Write a log of positions whose speeds are in sentences without a time, and return the true speeds."""
    t = np.arange(60)
    speed = 10.0 + 5.0 * np.sin(t / 6.0)
    minutes = 60.0 * np.cumsum(np.gradient(-30.0 * np.cos(t / 6.0) + 10.0 * t)) / 111_150.0
    text = sentence("GPZDA,031159.00,01,05,2026,00,00")
    for second in t:
        place = f"{4654.0 + minutes[second]:.6f},N,00724.000000,E,1,10,0.9,450.0,M,50.0,M,,"
        pair = [
            sentence(f"GPGGA,0312{second:02d}.00,{place}"),
            sentence(f"GPVTG,0.0,T,,M,{speed[second] / KNOT:.4f},N,{speed[second] / KMH:.4f},K,A"),
        ]
        text += "".join(reversed(pair) if first else pair)
    path.write_text(text)
    return speed


@pytest.mark.parametrize("first", [False, True])
def test_speeds_without_a_time_are_of_the_position_beside_them(first: bool, tmp_path: Path) -> None:
    speed = with_vtg(tmp_path / "log.nmea", first=first)
    frame = read_gnss_log(tmp_path / "log.nmea").frame
    np.testing.assert_allclose(frame["speed_mps"], speed, atol=1e-3)


def test_speeds_without_any_time_are_named(tmp_path: Path) -> None:
    (tmp_path / "log.nmea").write_text(3 * sentence("GPVTG,0.0,T,,M,20.0,N,37.0,K,A"))
    with pytest.raises(BadInputError, match=r"no position found in 3 VTG; .* whose dates GGA and VTG have not"):
        read_gnss_log(tmp_path / "log.nmea")


@pytest.fixture(scope="module")
def journey(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("mainline-gnss", seed=2, duration_s=120.0)


def logged(run: Simulation, folder: Path, **columns: np.ndarray) -> Path:
    """Write a logger's two tables, of which that of positions has further ``columns``, and return their folder."""
    drive = Drive.of(run.recording)
    folder.mkdir()
    inertial = {f"gyro_{axis} (rad/s)": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    inertial |= {f"acc_{axis} (m/s^2)": drive.accel[:, i] for i, axis in enumerate("xyz")}
    pd.DataFrame({"time (s)": drive.t, **inertial}).to_csv(folder / "imu.csv", index=False)
    places = {"latitude": drive.latitude, "longitude": drive.longitude, "altitude (m)": drive.height}
    pd.DataFrame({"time (s)": drive.gnss_t, **places, **columns}).to_csv(folder / "gps.csv", index=False)
    return folder


def true_speed(run: Simulation) -> np.ndarray:
    assert run.recording.gnss is not None
    return np.interp(run.recording.gnss["t_s"], run.truth["t_s"], run.truth["speed_mps"])


@pytest.mark.parametrize(
    ("name", "factor"),
    [("GPS Speed (km/h)", KMH), ("speed", KNOT), ("gSpeed", 1e-3), ("SOG_kn", KNOT)],
)
def test_the_unit_is_the_stated_one_or_that_in_which_the_positions_are_as_fast(
    name: str, factor: float, journey: Simulation, tmp_path: Path, imported: Import
) -> None:
    speed = true_speed(journey)
    source = logged(journey, tmp_path / "log", **{name: speed / factor, "sAcc": 0.2 / factor})
    table = recording_of(imported(source)).others["gnss_speed"]
    np.testing.assert_allclose(table["speed_mps"], speed, atol=1e-6)
    np.testing.assert_allclose(table["speed_sd_mps"], 0.2)


def test_a_speed_of_the_car_s_own_is_not_the_receiver_s(journey: Simulation, tmp_path: Path, imported: Import) -> None:
    speed = true_speed(journey)
    columns = {"Speed (OBD)(km/h)": 0.9 * speed / KMH, "Vertical speed (m/s)": 0.0 * speed, "GPS Speed (m/s)": speed}
    recording = recording_of(imported(logged(journey, tmp_path / "log", **columns)))
    np.testing.assert_allclose(recording.others["gnss_speed"]["speed_mps"], speed, atol=1e-6)


def test_speeds_that_a_faster_table_holds_count_once(journey: Simulation, tmp_path: Path, imported: Import) -> None:
    """A logger of 10 Hz repeats each speed of the receiver until the next one."""
    drive = Drive.of(journey.recording)
    speed = true_speed(journey)
    at = np.arange(0.0, drive.gnss_t[-1], 0.1)
    held = np.searchsorted(drive.gnss_t, at + 1e-9) - 1
    folder = logged(journey, tmp_path / "log")
    columns = {"time (s)": at, "latitude": drive.latitude[held], "longitude": drive.longitude[held]}
    pd.DataFrame(columns | {"altitude (m)": drive.height[held], "GPS Speed (m/s)": speed[held]}).to_csv(
        folder / "gps.csv", index=False
    )
    recording = recording_of(imported(folder))
    table, gnss = recording.others["gnss_speed"], recording.gnss
    moving = table[table["speed_mps"] > 1.0]
    np.testing.assert_allclose(moving["speed_mps"], np.interp(moving["t_s"], drive.gnss_t, speed), atol=1e-6)
    assert gnss is not None
    np.testing.assert_allclose(gnss["t_s"], drive.gnss_t[:-1], atol=1e-6)
    np.testing.assert_allclose(table["t_s"], gnss["t_s"])


def test_a_speed_in_whole_km_h_that_a_receiver_writes_as_it_measures_is_kept(
    journey: Simulation, tmp_path: Path, imported: Import
) -> None:
    speed = np.round(true_speed(journey) / KMH)
    assert np.mean(np.diff(speed) == 0.0) > 0.3
    recording = recording_of(imported(logged(journey, tmp_path / "log", **{"GPS Speed (km/h)": speed})))
    assert recording.gnss is not None
    assert len(recording.others["gnss_speed"]) == len(recording.gnss) == len(speed)
