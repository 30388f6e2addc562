"""Lines of ``ros2 topic echo --csv`` have no names: messages of three types are known by their cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.sources.ros_echo import with_columns_of_ros

Import = Callable[..., Imported]


def _covariance(rows: int, *diagonal: float) -> np.ndarray:
    return np.tile(np.diag(diagonal).ravel(), (rows, 1))


def _imu(path: Path, drive: Drive, quaternion: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> Path:
    rows = drive.t.size
    numbers = np.hstack(
        [
            np.tile(quaternion, (rows, 1)),
            *(_covariance(rows, -1.0, 0.0, 0.0), drive.gyro),
            *(_covariance(rows, 1e-6, 1e-6, 1e-6), drive.accel),
            _covariance(rows, 1e-4, 1e-4, 1e-4),
        ]
    )
    head = pd.DataFrame({"sec": drive.ns // 10**9, "nanosec": drive.ns % 10**9, "frame": "imu_link"})
    pd.concat([head, pd.DataFrame(numbers)], axis=1).to_csv(path, index=False, header=False)
    return path


def _fix(path: Path, drive: Drive, kind: int = 2) -> Path:
    rows = drive.gnss_t.size
    head = {"sec": drive.gnss_ns // 10**9, "nanosec": drive.gnss_ns % 10**9, "frame": "gps", "status": 0, "service": 15}
    place = {"latitude": drive.latitude, "longitude": drive.longitude, "altitude": drive.height}
    table = pd.DataFrame({**head, **place})
    table.loc[3, ["status", "latitude", "longitude", "altitude"]] = [-1, 0.0, 0.0, 0.0]
    covariance = pd.DataFrame(_covariance(rows, 0.04, 0.09, 0.25))
    pd.concat([table, covariance, pd.Series(kind, index=table.index)], axis=1).to_csv(path, index=False, header=False)
    return path


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.6, 0.8), (0.0, 0.0, 0.0, 0.0)])
def test_samples_of_an_imu(quaternion: tuple[float, ...], drive: Drive, tmp_path: Path, imported: Import) -> None:
    recording = imported(_imu(tmp_path / "imu.csv", drive, quaternion)).loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-12)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-12)
    assert recording.description.start is not None
    assert recording.description.start.timestamp() + recording.imu["t_s"].iloc[0] == pytest.approx(drive.ns[0] / 1e9)


@pytest.mark.parametrize(("kind", "sd"), [(2, [0.2, 0.3, 0.5]), (0, [3.0, 3.0, 6.0])])
def test_positions_have_the_sigmas_of_their_covariance(
    kind: int, sd: list[float], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _imu(source / "imu.csv", drive)
    _fix(source / "fix.csv", drive, kind)
    recording = imported(source).loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    assert len(recording.gnss) == drive.gnss_t.size - 1
    sigmas = recording.gnss[["east_sd_m", "north_sd_m", "up_sd_m"]]
    np.testing.assert_allclose(sigmas, np.tile(sd, (len(sigmas), 1)))


def _odometry(path: Path, drive: Drive, child: str = "base_link", across: float = 0.0) -> Path:
    rows = drive.t.size
    zeros = np.zeros((rows, 3))
    position = np.column_stack([np.cumsum(drive.speed) / 100.0, zeros[:, :2]])
    velocity = np.column_stack([drive.speed, across * drive.speed, zeros[:, 0]])
    covariance = np.tile(np.eye(6).ravel(), (rows, 1))
    numbers = np.hstack([position, np.tile((0.0, 0.0, 0.0, 1.0), (rows, 1)), covariance, velocity, zeros, covariance])
    head = {"sec": drive.ns // 10**9, "nanosec": drive.ns % 10**9, "frame": "odom", "child": child}
    pd.concat([pd.DataFrame(head), pd.DataFrame(numbers)], axis=1).to_csv(path, index=False, header=False)
    return path


@pytest.mark.parametrize(("child", "across"), [("base_link", 0.0), ("gps", 0.0), ("base_link", 0.5)])
def test_odometry_is_the_speed_unless_it_is_a_receiver_s(
    child: str, across: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    source = tmp_path / "log"
    source.mkdir()
    _imu(source / "imu.csv", drive)
    _odometry(source / "odom.csv", drive, child, across)
    recording = imported(source).loaded.recording
    assert recording is not None
    if child == "gps" or across:
        assert recording.tach is None
        return
    assert recording.tach is not None
    rolled = np.ptp(recording.tach["distance_m"])
    assert rolled == pytest.approx(np.trapezoid(drive.speed, drive.t), rel=1e-3)


def _plotted(path: Path, drive: Drive, fields: dict[str, np.ndarray]) -> None:
    """As ``rostopic echo -p`` prints messages: names of all fields, with the time of receipt before them."""
    head = {"%time": drive.ns + 4_000_000, "field.header.seq": np.arange(drive.t.size), "field.header.stamp": drive.ns}
    columns = {f"field.{name}": values for name, values in fields.items()}
    pd.DataFrame({**head, "field.header.frame_id": "odom", **columns}).to_csv(path, index=False)


def test_odometry_of_ros_1_is_the_speed(drive: Drive, tmp_path: Path, imported: Import) -> None:
    source = tmp_path / "log"
    source.mkdir()
    vectors = {"angular_velocity": drive.gyro, "linear_acceleration": drive.accel}
    fields = {f"{name}.{axis}": v[:, i] for name, v in vectors.items() for i, axis in enumerate("xyz")}
    _plotted(source / "imu.csv", drive, fields)
    still = 0.0 * drive.t
    pose = {"child_frame_id": np.full(still.size, "base"), "pose.pose.position.x": np.cumsum(drive.speed) / 100.0}
    pose |= {"pose.pose.position.y": still, "pose.pose.position.z": still}
    pose |= {f"pose.pose.orientation.{axis}": still + (axis == "w") for axis in "xyzw"}
    pose |= {f"pose.covariance{i}": still for i in range(36)}
    twist = {"twist.twist.linear.x": drive.speed, "twist.twist.linear.y": still, "twist.twist.linear.z": still}
    twist |= {f"twist.twist.angular.{axis}": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    _plotted(source / "odom.csv", drive, {**pose, **twist, **{f"twist.covariance{i}": still for i in range(36)}})
    recording = imported(source).loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-9)
    assert recording.tach is not None
    rolled = np.ptp(recording.tach["distance_m"])
    assert rolled == pytest.approx(np.trapezoid(drive.speed, drive.t), rel=1e-3)


def test_forty_numbers_with_no_quaternion_are_no_imu(drive: Drive, tmp_path: Path, imported: Import) -> None:
    path = _imu(tmp_path / "imu.csv", drive, (0.4, 0.1, 0.2, 0.1))
    table = read_text(path)
    assert with_columns_of_ros(table) is table
    with pytest.raises(BadInputError, match="no row of names of columns"):
        imported(path)
