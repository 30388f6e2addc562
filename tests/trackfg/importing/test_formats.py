"""Each format's own library writes a fixture; what comes back equals what went in, and damaged files are refused."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.importing.registry import source_format

IMU = ["wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2"]
LIMIT_BYTES = 400_000


def _same_imu(made, drive, *, atol=1e-9):
    recording = made.loaded.recording
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-9)
    np.testing.assert_allclose(recording.imu[IMU[:3]], drive.gyro, atol=atol)
    np.testing.assert_allclose(recording.imu[IMU[3:]], drive.accel, atol=atol)


def _same_positions(made, drive):
    gnss = made.loaded.recording.gnss
    np.testing.assert_allclose(gnss["t_s"], drive.gnss_t, atol=1e-9)
    north = (drive.latitude - drive.latitude[0]) * np.pi / 180.0 * 6_367_800.0  # the meridian's radius at 46.9 deg
    np.testing.assert_allclose(gnss["north_m"], north, atol=0.02)


def write_sensor_logger(drive, folder: Path) -> Path:
    path = folder / "walk.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in (("TotalAcceleration", drive.accel), ("Gyroscope", drive.gyro)):
            frame = pd.DataFrame({"time": drive.ns, "seconds_elapsed": drive.t})
            frame = frame.assign(z=values[:, 2], y=values[:, 1], x=values[:, 0])
            archive.writestr(f"{name}.csv", frame.to_csv(index=False))
        position = {"latitude": drive.latitude, "longitude": drive.longitude, "altitude": drive.height}
        accuracy = {"horizontalAccuracy": 4.0, "verticalAccuracy": 6.0}
        frame = pd.DataFrame({"time": drive.gnss_ns, **position, **accuracy})
        archive.writestr("Location.csv", frame.to_csv(index=False))
        archive.writestr("Metadata.csv", "version,device name\n3,phone\n")
    return path


def write_phyphox(drive, folder: Path) -> Path:
    path = folder / "phyphox.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, quantity, unit, values in (
            ("Gyroscope", "Gyroscope", "rad/s", drive.gyro),
            ("Accelerometer", "Acceleration", "m/s^2", drive.accel),
        ):
            columns = {f"{quantity} {axis} ({unit})": values[:, i] for i, axis in enumerate("xyz")}
            archive.writestr(f"{name}.csv", pd.DataFrame({"Time (s)": drive.t, **columns}).to_csv(index=False))
        archive.writestr("meta/time.csv", '"event","experiment time"\n"START",0.0\n')
    return path


def write_ros2(drive, folder: Path, *, plugin: str = "SQLITE3") -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    imu, fix, status = (types[f"sensor_msgs/msg/{name}"] for name in ("Imu", "NavSatFix", "NavSatStatus"))
    twist, twist_stamped = types["geometry_msgs/msg/Twist"], types["geometry_msgs/msg/TwistStamped"]

    def head(ns):
        return header(stamp=time(sec=int(ns // 10**9), nanosec=int(ns % 10**9)), frame_id="imu")

    path = folder / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        topics = {
            name: writer.add_connection(topic, kind.__msgtype__, typestore=store)
            for name, topic, kind in (("imu", "/imu", imu), ("fix", "/fix", fix), ("speed", "/wheel", twist_stamped))
        }
        for i, ns in enumerate(drive.ns):
            message = imu(
                header=head(ns),
                orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
                orientation_covariance=np.zeros(9),
                angular_velocity=vector(*map(float, drive.gyro[i])),
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=vector(*map(float, drive.accel[i])),
                linear_acceleration_covariance=np.zeros(9),
            )
            writer.write(topics["imu"], int(ns), store.serialize_cdr(message, imu.__msgtype__))
            speed = twist(linear=vector(x=float(drive.speed[i]), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
            stamped = twist_stamped(header=head(ns), twist=speed)
            writer.write(topics["speed"], int(ns), store.serialize_cdr(stamped, twist_stamped.__msgtype__))
        for i, ns in enumerate(drive.gnss_ns):
            message = fix(
                header=head(ns),
                status=status(status=0, service=1),
                latitude=float(drive.latitude[i]),
                longitude=float(drive.longitude[i]),
                altitude=float(drive.height[i]),
                position_covariance=np.diag([4.0, 4.0, 9.0]).ravel(),
                position_covariance_type=2,
            )
            writer.write(topics["fix"], int(ns), store.serialize_cdr(message, fix.__msgtype__))
    return path


def write_mcap(drive, folder: Path) -> Path:
    return next(write_ros2(drive, folder, plugin="MCAP").glob("*.mcap"))


def write_rcm_dx(drive, folder: Path, *, prefix: str = "") -> Path:
    import h5py

    path = folder / "run.rcmdx"
    with h5py.File(path, "w") as file:
        root = file.create_group("RCMDX")
        root.attrs["Element"] = "Root"
        source = root.create_group(f"FILE/{prefix}PLATFORM/SESSION/{prefix}IMU/{prefix}INERTIAL")
        source[f"{prefix}timestamp"] = drive.ns.astype(np.uint64)
        for i, axis in enumerate("XYZ"):
            for name, values, unit in (("GYRO", drive.gyro, "rad/s"), ("ACCELERATION", drive.accel, "m/s^2")):
                channel = source.create_group(f"{prefix}{name}_{axis}")
                channel[f"{prefix}data"] = values[:, i]
                channel[f"{prefix}data"].attrs["Unit"] = unit
    return path


def write_prefixed_rcm_dx(drive, folder: Path) -> Path:
    return write_rcm_dx(drive, folder, prefix="[CAR].")


def write_onboard_eu(drive, folder: Path) -> Path:
    import h5py

    path = folder / "journeys.h5"
    columns = ["times", *(f"acc_{a}" for a in "xyz"), *(f"gyr_{a}" for a in "xyz")]
    imu = np.rec.fromarrays([drive.t, *drive.accel.T, *drive.gyro.T], names=columns)
    position = [drive.gnss_t, drive.latitude, drive.longitude, drive.height]
    gnss = np.rec.fromarrays(position, names=["times", "lat", "lon", "alt"])
    with h5py.File(path, "w") as file:
        for journey in ("journey_00", "journey_01"):
            file[f"{journey}/IMU"] = imu
            file[f"{journey}/GNSS"] = gnss
    return path


def write_mdf(drive, folder: Path) -> Path:
    from asammdf import MDF, Signal

    path = folder / "run.mf4"
    names = [*(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    values, units = [*drive.gyro.T, *drive.accel.T], ["rad/s"] * 3 + ["m/s^2"] * 3
    with MDF(version="4.10") as file:
        file.append([Signal(v, drive.t, unit=u, name=n) for v, u, n in zip(values, units, names, strict=True)])
        slower = drive.t[::5]
        file.append([Signal(3.6 * drive.speed[::5], slower, unit="km/h", name="wheel_speed")])
        file.save(path)
    return path


def write_tdms(drive, folder: Path) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "run.tdms"
    wave = {"wf_increment": 0.01, "wf_start_offset": 0.0}
    names = [*(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    units = ["rad/s"] * 3 + ["m/s^2"] * 3
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("imu", name, np.ascontiguousarray(values), properties={**wave, "unit_string": unit})
                for name, values, unit in zip(names, [*drive.gyro.T, *drive.accel.T], units, strict=True)
            ]
        )
    return path


WRITERS: dict[str, Callable[..., Path]] = {
    "sensor-logger": write_sensor_logger,
    "phyphox": write_phyphox,
    "ros": write_ros2,
    "mcap": write_mcap,
    "rcm-dx": write_rcm_dx,
    "rcm-dx with prefixes": write_prefixed_rcm_dx,
    "hdf5": write_onboard_eu,
    "mdf": write_mdf,
    "tdms": write_tdms,
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_a_format_s_library_writes_comes_back(name, drive, tmp_path, imported):
    source = WRITERS[name](drive, tmp_path)

    made = imported(source)

    assert source_format(source).key == {"mcap": "ros", "rcm-dx with prefixes": "rcm-dx"}.get(name, name)
    _same_imu(made, drive)
    recording = made.loaded.recording
    if recording.gnss is not None:
        _same_positions(made, drive)
    if name in ("ros", "mcap", "mdf"):
        rolled = recording.tach["distance_m"].to_numpy()
        distance = np.interp(recording.tach["t_s"], drive.t, np.cumsum(drive.speed) / 100.0)
        np.testing.assert_allclose(rolled - rolled[0], distance, atol=0.05)
    assert recording.gnss is not None or name not in ("ros", "mcap", "sensor-logger", "hdf5")


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "phyphox"])
def test_damaged_files_are_refused_with_a_reason(name, drive, tmp_path, imported):
    """Cut off, overwritten in the middle or at the start: never a traceback, and never a recording of other values."""
    source = WRITERS[name](drive, tmp_path)
    target = max(_files(source), key=lambda file: file.stat().st_size)
    whole = target.read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for i in range(20):
        if i < 10:
            damaged = whole[: int(len(whole) * (i + 0.5) / 11)]
        else:
            at = int(rng.integers(0, len(whole) - 2000))
            damaged = whole[:at] + rng.bytes(2000) + whole[at + 2000 :]
        target.write_bytes(damaged)
        try:
            made = imported(source, None if i % 2 else {"mcap": "ros"}.get(name, name.partition(" ")[0]))
        except BadInputError:
            refused += 1
        else:
            assert made.loaded.recording is not None
            shutil.rmtree(made.folder)
    assert refused >= 5


def test_acceleration_without_gravity_is_refused_by_name(drive, tmp_path, imported):
    path = write_sensor_logger(drive, tmp_path)
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    content["Accelerometer.csv"] = content.pop("TotalAcceleration.csv")
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)

    with pytest.raises(BadInputError, match=r"Accelerometer.csv is without gravity"):
        imported(path)


def test_ubx_and_nmea_positions_come_back(tmp_path):
    import pyubx2

    from trackfg.importing.sources.gnss_log import read_gnss_log

    message = pyubx2.UBXMessage(
        "NAV", "NAV-PVT", pyubx2.GET,
        year=2026, month=5, day=1, hour=3, min=12, second=0, nano=250_000_000, fixType=3, gnssFixOk=1,
        lat=46.9, lon=7.4, height=500_000, hAcc=1414, vAcc=2000,
    )  # fmt: skip
    ubx = tmp_path / "log.ubx"
    ubx.write_bytes(message.serialize())
    nmea = tmp_path / "log.nmea"
    nmea.write_text(
        _sentence("GNZDA,031200.00,01,05,2026,00,00")
        + _sentence("GNGST,031200.25,,,,,1.1,1.2,2.0")
        + _sentence("GNGGA,031200.25,4654.0000,N,00724.0000,E,1,10,0.9,450.0,M,50.0,M,,")
    )

    for path, sd in ((ubx, (1.0, 1.0, 2.0)), (nmea, (1.2, 1.1, 2.0))):
        frame = read_gnss_log(path).frame
        assert len(frame) == 1
        assert frame["time_ns"][0] == 1_777_605_120_250_000_000
        np.testing.assert_allclose(frame.loc[0, ["latitude", "longitude", "height"]], [46.9, 7.4, 500.0], atol=1e-7)
        np.testing.assert_allclose(frame.loc[0, ["sd_east_m", "sd_north_m", "sd_up_m"]], sd, atol=1e-3)


def _sentence(text: str) -> str:
    checksum = 0
    for character in text:
        checksum ^= ord(character)
    return f"${text}*{checksum:02X}\r\n"
