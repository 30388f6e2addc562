"""Logs of phones, as their apps write them, and phones that lie as they happen to lie."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive, write_sensor_json, write_sensor_logger

from trackfg.datasets.scenarios import Simulation
from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.registry import source_format
from trackfg.numerics.rotations import axes_matrix, matrix_from_rpy
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
PHYPHOX_POSITION = ["Latitude (°)", "Longitude (°)", "Height (m)"]


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def _sensor_logger(drive: Drive, folder: Path, **content: str | None) -> Path:
    """Write a folder of Sensor Logger; files of ``content`` instead of its own, or none where that is None."""
    with zipfile.ZipFile(write_sensor_logger(drive, folder)) as archive:
        archive.extractall(folder / "log")
    for name, text in content.items():
        file = folder / "log" / f"{name}.csv"
        file.unlink(missing_ok=True)
        if text is not None:
            file.write_text(text)
    return folder / "log"


def _phyphox(drive: Drive, folder: Path) -> Path:
    """Write phyphox's tables alone, without ``meta/time.csv``, and return their folder."""
    folder = folder / "phone"
    folder.mkdir()
    for name, unit, values in (("Gyroscope", "rad/s", drive.gyro), ("Accelerometer", "m/s^2", drive.accel)):
        frame = pd.DataFrame(values, columns=[f"{axis} ({unit})" for axis in "XYZ"])
        frame.insert(0, "Time (s)", drive.t)
        frame.to_csv(folder / f"{name}.csv", index=False)
    places = np.column_stack([drive.gnss_t, drive.latitude, drive.longitude, drive.height])
    frame = pd.DataFrame(places, columns=["Time (s)", *PHYPHOX_POSITION])
    frame.assign(**{"Horizontal Accuracy (m)": 3.0, "Vertical Accuracy (°)": 5.0}).to_csv(
        folder / "Location.csv", index=False
    )
    return folder


@pytest.mark.parametrize(
    ("metadata", "sign"),
    [
        ("version,device name,platform,standardisation\n3,iPhone 12,ios,false\n", -1.0),
        ("version,device name,recording time,platform\n2,iPhone,2021-01-12_21-15-35,ios\n", -1.0),
        ("version,device name,platform,standardisation\n3,iPhone 12,ios,true\n", 1.0),
        ("version,device name,platform\n3,SM-N986B,android\n", 1.0),
    ],
)
def test_an_iphone_s_acceleration_has_apple_s_sign(
    metadata: str, sign: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    logged = drive._replace(accel=sign * drive.accel)

    back = _recording(imported(_sensor_logger(logged, tmp_path, Metadata=metadata)))

    assert back.description.imu.axes == "FLU"
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)
    np.testing.assert_allclose(back.gyro, drive.gyro, atol=1e-9)


def test_an_iphone_s_json_has_apple_s_sign(drive: Drive, tmp_path: Path, imported: Import) -> None:
    path = write_sensor_json(drive._replace(accel=-drive.accel), tmp_path)
    entries = json.loads(path.read_text())
    path.write_text(json.dumps([{**entries[0], "platform": "ios", "standardisation": "false"}, *entries[1:]]))

    np.testing.assert_allclose(_recording(imported(path)).accel, drive.accel, atol=1e-9)


def test_sensor_log_s_acceleration_has_apple_s_sign(drive: Drive, tmp_path: Path, imported: Import) -> None:
    columns = {"loggingTime(txt)": pd.to_datetime(drive.ns).strftime("%Y-%m-%dT%H:%M:%S.%fZ")}
    for i, axis in enumerate("XYZ"):
        columns[f"accelerometerAcceleration{axis}(G)"] = -drive.accel[:, i] / 9.80665
        columns[f"gyroRotation{axis}(rad/s)"] = drive.gyro[:, i]
    columns["pedometerDistance(m)"] = np.zeros(len(drive.t))
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)

    back = _recording(imported(tmp_path / "log.csv"))

    assert back.tach is None
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)


@pytest.mark.parametrize("location", ["", "time,seconds_elapsed,latitude,longitude\n"])
def test_a_phone_without_positions_is_read(location: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    back = _recording(imported(_sensor_logger(drive, tmp_path, Location=location)))

    assert back.gnss is None
    np.testing.assert_allclose(back.accel, drive.accel, atol=1e-9)


def test_a_log_without_gyro_is_refused_by_name(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with pytest.raises(BadInputError, match=r"no Gyroscope\.csv; expected it"):
        imported(_sensor_logger(drive, tmp_path, Gyroscope=None))


def test_of_positions_at_one_time_the_last_counts(drive: Drive, tmp_path: Path, imported: Import) -> None:
    folder = _sensor_logger(drive, tmp_path)
    location = pd.read_csv(folder / "Location.csv")
    first = location.iloc[[4]].assign(latitude=location["latitude"].iloc[4] - 1e-3)
    pd.concat([location[:4], first, location[4:]]).to_csv(folder / "Location.csv", index=False)

    gnss = _recording(imported(folder)).gnss

    assert gnss is not None
    assert len(gnss) == len(location)
    assert np.abs(np.diff(gnss["north_m"])).max() < 20.0


def test_phyphox_is_known_by_its_columns_without_its_file_of_times(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    path = _phyphox(drive, tmp_path)

    assert source_format(path).key == "phyphox"
    np.testing.assert_allclose(_recording(imported(path)).accel, drive.accel, atol=1e-9)


def test_a_phone_that_lies_askew_gets_its_axes_from_gravity_and_positions(
    simulated_in_full: Callable[..., Simulation], tmp_path: Path, imported: Import
) -> None:
    """It leans back by 36 deg in a cup holder, its y axis up and its screen to the rear."""
    drive = Drive.of(simulated_in_full("mainline-field", seed=1, duration_s=300.0).recording)
    mount = matrix_from_rpy(*np.radians([0.0, 36.0, 0.0]))
    sensor = axes_matrix("RUB").T @ mount.T
    askew = drive._replace(gyro=drive.gyro @ sensor.T, accel=drive.accel @ sensor.T)

    back = _recording(imported(_phyphox(askew, tmp_path)))

    assert back.description.imu.axes == "RUB"
    assert back.description.imu.mount_rpy_deg == pytest.approx((0.0, 36.0, 0.0), abs=3.0)
    off = np.abs(np.median(back.accel - drive.accel, axis=0))
    assert (off < 0.5).all()
