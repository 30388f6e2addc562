"""Runs are written in the forms of other systems, each by the format's own library."""

from __future__ import annotations

import json
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.interchange.importing.proposal import GNSS_SD_M
from trackfg.interchange.importing.sources.phones import SIGMA_OF_RADIUS
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import enu_to_geodetic
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording

START_NS = 1_777_605_120_000_000_000  # 2026-05-01T03:12:00Z


class Drive(NamedTuple):
    """``t`` (n,) s, ``gyro`` (n, 3) rad/s, ``accel`` (n, 3) m/s^2, ``speed`` (n,) m/s; positions at ``gnss_t`` (m,)."""

    t: Array
    gyro: Array
    accel: Array
    speed: Array
    gnss_t: Array
    latitude: Array
    longitude: Array
    height: Array

    @classmethod
    def of(cls, recording: Recording) -> Drive:
        """Take a recording with a tachometer and GNSS apart."""
        imu, tach, gnss = recording.imu, recording.tach, recording.gnss
        assert tach is not None
        assert gnss is not None
        assert recording.gnss_origin is not None
        t = imu["t_s"].to_numpy()
        rolled = np.interp(t, tach["t_s"], np.gradient(tach["distance_m"], tach["t_s"]))
        speed = np.maximum(rolled, 0.0)
        origin = tuple(float(value) for value in recording.gnss_origin)
        places = enu_to_geodetic(gnss[["east_m", "north_m", "up_m"]].to_numpy(), (origin[0], origin[1], origin[2]))
        return cls(t, recording.gyro, recording.accel, speed, gnss["t_s"].to_numpy(), *places.T)

    @property
    def ns(self) -> np.ndarray:
        """Times of the IMU, ns since 1970."""
        return START_NS + np.round(self.t * 1e9).astype(np.int64)

    @property
    def gnss_ns(self) -> np.ndarray:
        """Times of the positions, ns since 1970."""
        return START_NS + np.round(self.gnss_t * 1e9).astype(np.int64)


def write_sensor_logger(drive: Drive, folder: Path) -> Path:
    """Write a zip of Sensor Logger and return its path."""
    path = folder / "walk.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in (("TotalAcceleration", drive.accel), ("Gyroscope", drive.gyro)):
            frame = pd.DataFrame({"time": drive.ns, "seconds_elapsed": drive.t})
            frame = frame.assign(z=values[:, 2], y=values[:, 1], x=values[:, 0])
            archive.writestr(f"{name}.csv", frame.to_csv(index=False))
        position = {"latitude": drive.latitude, "longitude": drive.longitude, "altitude": drive.height}
        accuracy = {"horizontalAccuracy": GNSS_SD_M[0] / SIGMA_OF_RADIUS, "verticalAccuracy": GNSS_SD_M[2]}
        frame = pd.DataFrame({"time": drive.gnss_ns, **position, **accuracy})
        archive.writestr("Location.csv", frame.to_csv(index=False))
        archive.writestr("Metadata.csv", "version,device name\n3,phone\n")
    return path


def write_sensor_json(drive: Drive, folder: Path) -> Path:
    """Write the JSON of Sensor Logger, whose numbers are text, and return its path."""
    path = folder / "walk.json"
    entries: list[dict[str, str]] = [{"sensor": "Metadata", "device name": "phone"}]
    for name, values in (("TotalAcceleration", drive.accel), ("Gyroscope", drive.gyro)):
        for ns, row in zip(drive.ns, values, strict=True):
            x, y, z = (repr(float(value)) for value in row)
            entries.append({"sensor": name, "time": str(ns), "z": z, "y": y, "x": x})
    sigmas = {"horizontalAccuracy": GNSS_SD_M[0] / SIGMA_OF_RADIUS, "verticalAccuracy": GNSS_SD_M[2]}
    accuracy = {name: repr(value) for name, value in sigmas.items()}
    places = zip(drive.gnss_ns, drive.latitude, drive.longitude, drive.height, strict=True)
    for ns, *place in places:
        position = dict(zip(("latitude", "longitude", "altitude"), (repr(float(v)) for v in place), strict=True))
        entries.append({"sensor": "Location", "time": str(ns), **position, **accuracy})
    path.write_text(json.dumps(entries))
    return path


def write_phyphox(drive: Drive, folder: Path) -> Path:
    """Write a zip of phyphox and return its path."""
    path = folder / "phyphox.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, quantity, unit, values in (
            ("Gyroscope", "Gyroscope", "rad/s", drive.gyro),
            ("Accelerometer", "Acceleration", "m/s^2", drive.accel),
        ):
            columns = {f"{quantity} {axis} ({unit})": values[:, i] for i, axis in enumerate("xyz")}
            archive.writestr(f"{name}.csv", pd.DataFrame({"Time (s)": drive.t, **columns}).to_csv(index=False))
        place = {"Latitude (°)": drive.latitude, "Longitude (°)": drive.longitude, "Height (m)": drive.height}
        accuracy = {"Horizontal Accuracy (m)": GNSS_SD_M[0] / SIGMA_OF_RADIUS, "Vertical Accuracy (m)": GNSS_SD_M[2]}
        location = pd.DataFrame({"Time (s)": drive.gnss_t, **place, **accuracy})
        archive.writestr("Location.csv", location.to_csv(index=False))
        archive.writestr("meta/time.csv", '"event","experiment time"\n"START",0.0\n')
    return path


def write_ros2(drive: Drive, folder: Path, *, plugin: str = "SQLITE3") -> Path:
    """Write a ROS 2 bag and return its path."""
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
                position_covariance=np.diag(np.square(GNSS_SD_M)).ravel(),
                position_covariance_type=2,
            )
            writer.write(topics["fix"], int(ns), store.serialize_cdr(message, fix.__msgtype__))
    return path


def write_mcap(drive: Drive, folder: Path) -> Path:
    """Write an MCAP file with CDR messages and return its path."""
    return next(write_ros2(drive, folder, plugin="MCAP").glob("*.mcap"))


def write_mcap_json(drive: Drive, folder: Path) -> Path:
    """Write an MCAP file with messages in JSON and return its path."""
    from mcap.writer import Writer

    path = folder / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()

        def channel(topic: str) -> int:
            schema = writer.register_schema(name=topic, encoding="jsonschema", data=b'{"type": "object"}')
            return writer.register_channel(topic=topic, message_encoding="json", schema_id=schema)

        imu, wheel, gnss = channel("/imu"), channel("/wheel"), channel("/gnss")

        def add(topic: int, ns: int, message: dict) -> None:
            data = json.dumps(message).encode()
            writer.add_message(topic, log_time=int(ns), publish_time=int(ns), data=data)

        for i, ns in enumerate(drive.ns):
            rates, forces = (dict(zip("xyz", values[i].tolist(), strict=True)) for values in (drive.gyro, drive.accel))
            add(imu, ns, {"angular_velocity": rates, "linear_acceleration": forces})
            add(wheel, ns, {"wheel_speed_mps": float(drive.speed[i])})
        for i, ns in enumerate(drive.gnss_ns):
            stamp = {"sec": int(ns // 10**9), "nsec": int(ns % 10**9)}
            place = {"latitude": drive.latitude[i], "longitude": drive.longitude[i], "altitude": drive.height[i]}
            add(gnss, ns + 70_000_000, {"timestamp": stamp, **place})  # received later than measured
        writer.finish()
    return path


def write_rcm_dx(drive: Drive, folder: Path, *, prefix: str = "") -> Path:
    """Write an RCM-DX file with plain names and return its path."""
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
        speed = source.create_group(f"{prefix}WHEEL_SPEED")
        speed[f"{prefix}data"] = drive.speed
        speed[f"{prefix}data"].attrs["Unit"] = "m/s"
    return path


def write_prefixed_rcm_dx(drive: Drive, folder: Path) -> Path:
    """Write an RCM-DX file with the names of a car and return its path."""
    return write_rcm_dx(drive, folder, prefix="[CAR].")


def write_onboard_eu(drive: Drive, folder: Path) -> Path:
    """Write an HDF5 file like OnboardEU's and return its path."""
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


def write_mdf(drive: Drive, folder: Path) -> Path:
    """Write an MDF4 file and return its path."""
    from asammdf import MDF, Signal

    path = folder / "run.mf4"
    names = [*(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    values, units = [*drive.gyro.T, *drive.accel.T], ["rad/s"] * 3 + ["m/s^2"] * 3
    with MDF(version="4.10") as file:
        file.append([Signal(v, drive.t, unit=u, name=n) for v, u, n in zip(values, units, names, strict=True)])
        file.append([Signal(3.6 * drive.speed, drive.t, unit="km/h", name="wheel_speed")])
        file.save(path)
    return path


def write_tdms(drive: Drive, folder: Path) -> Path:
    """Write a TDMS file and return its path."""
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "run.tdms"
    wave = {"wf_increment": float(np.median(np.diff(drive.t))), "wf_start_offset": float(drive.t[0])}
    names = [*(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz"), "wheel_speed"]
    units = ["rad/s"] * 3 + ["m/s^2"] * 3 + ["m/s"]
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("imu", name, np.ascontiguousarray(values), properties={**wave, "unit_string": unit})
                for name, values, unit in zip(names, [*drive.gyro.T, *drive.accel.T, drive.speed], units, strict=True)
            ]
        )
    return path


def write_vbo(drive: Drive, folder: Path) -> Path:
    """Write a VBO file as Racelogic's specification has it and return its path; no library writes them."""
    path = folder / "run.vbo"
    names = ["X_Accel", "Y_Accel", "Z_Accel", "RollRate", "PitchRate", "YawRate", "Wheel_Speed"]
    values = [*drive.accel.T / STANDARD_GRAVITY, *np.degrees(drive.gyro).T, 3.6 * drive.speed]
    # The receiver is slower than the rows, which repeat its position until the next one.
    held = np.clip(np.searchsorted(drive.gnss_t, drive.t, side="right") - 1, 0, None)
    date = pd.to_datetime(drive.ns[0]).strftime("%d/%m/%Y")
    stamps = pd.Series(pd.to_datetime(drive.ns)).dt.strftime("%H%M%S.%f")
    with path.open("w", newline="\r\n") as file:
        print(f"File created on {date} at 03:12:00\n", file=file)
        print("[header]", "satellites", "time", "latitude", "longitude", "height", *names, "", sep="\n", file=file)
        print("[channel units]", "g", "g", "g", "deg/s", "deg/s", "deg/s", "km/h", "", sep="\n", file=file)
        print("[column names]", " ".join(["sats", "time", "lat", "long", "height", *names]), "", sep="\n", file=file)
        print("[data]", file=file)
        for i, row in enumerate(zip(*values, strict=True)):
            place = drive.latitude[held[i]] * 60.0, -drive.longitude[held[i]] * 60.0, drive.height[held[i]]
            cells = [f"{place[0]:+.9f}", f"{place[1]:+.9f}", f"{place[2]:+.4f}", *(f"{x:+.15E}" for x in row)]
            print("009", stamps[i], *cells, file=file)
    return path


def write_text(drive: Drive, folder: Path) -> Path:
    """Write a logger's text, with a block above the header, a row of units and decimal commas; return its path."""
    path = folder / "log.csv"
    names = ["Zeit", *(f"Drehrate {a}" for a in "XYZ"), *(f"Beschl. {a}" for a in "XYZ"), "Raddrehzahl Geschw."]
    units = ["", "°/s", "°/s", "°/s", "g", "g", "g", "km/h"]
    values = [*np.degrees(drive.gyro).T, *drive.accel.T / STANDARD_GRAVITY, 3.6 * drive.speed]
    stamps = pd.Series(pd.to_datetime(drive.ns)).dt.strftime("%Y-%m-%dT%H:%M:%S.%f")
    with path.open("w", encoding="cp1252", newline="\r\n") as file:
        print("Gerät;DataLog 3000", "Kanäle;7", "", ";".join(names), ";".join(units), sep="\n", file=file)
        for stamp, *row in zip(stamps, *values, strict=True):
            print(stamp, *(repr(float(x)).replace(".", ",") for x in row), sep=";", file=file)
    return path


def write_can_trace(drive: Drive, folder: Path) -> Path:
    """Write a decoded CAN trace, a row for each value, and return its path."""
    path = folder / "trace.csv"
    signals = [(f"Gyro{a}", "rad/s", drive.gyro[:, i]) for i, a in enumerate("XYZ")]
    signals += [(f"Acc{a}", "m/s^2", drive.accel[:, i]) for i, a in enumerate("XYZ")]
    signals += [("WheelSpeed", "km/h", 3.6 * drive.speed)]
    columns = ["Signal", "Value", "Unit"]
    parts = [pd.DataFrame({"Timestamp": drive.t, **dict(zip(columns, (n, v, u), strict=True))}) for n, u, v in signals]
    pd.concat(parts).sort_values("Timestamp", kind="stable").to_csv(path, index=False)
    return path


def _named(drive: Drive) -> dict[str, Array]:
    """Return the inertial channels and the wheel's speed by name."""
    values = {f"gyro_{axis}_radps": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    values |= {f"acc_{axis}_mps2": drive.accel[:, i] for i, axis in enumerate("xyz")}
    return {**values, "wheel_speed_mps": drive.speed}


def _positions(drive: Drive) -> dict[str, Array]:
    return {"lat": drive.latitude, "lon": drive.longitude, "alt": drive.height}


def write_parquet(drive: Drive, folder: Path) -> Path:
    """Write a Parquet file with dates and return its path."""
    path = folder / "log.parquet"
    pd.DataFrame({"timestamp": pd.to_datetime(drive.ns, utc=True), **_named(drive)}).to_parquet(path)
    return path


def write_sqlite(drive: Drive, folder: Path) -> Path:
    """Write a SQLite database with a table for each sensor and return its path."""
    path = folder / "log.db"
    with closing(sqlite3.connect(path)) as connection:
        pd.DataFrame({"ts_ns": drive.ns, **_named(drive)}).to_sql("imu", connection, index=False)
        pd.DataFrame({"ts_ns": drive.gnss_ns, **_positions(drive)}).to_sql("gps", connection, index=False)
    return path


def write_matlab(drive: Drive, folder: Path) -> Path:
    """Write a MATLAB file with a struct for each sensor and return its path."""
    from scipy.io import savemat

    path = folder / "log.mat"
    imu = {"time": drive.t, "gyro_radps": drive.gyro, "acc_mps2": drive.accel}
    odo = {"time": drive.t, "wheel_speed_mps": drive.speed}
    savemat(path, {"imu": imu, "odo": odo, "gps": {"time": drive.gnss_t, **_positions(drive)}})
    return path


def write_numpy(drive: Drive, folder: Path) -> Path:
    """Write an archive of NumPy and return its path."""
    path = folder / "log.npz"
    np.savez(path, time_ns=drive.ns, gyro_radps=drive.gyro, acc_mps2=drive.accel, wheel_speed_mps=drive.speed)
    return path


def write_json_lines(drive: Drive, folder: Path) -> Path:
    """Write a record in each line, of one sensor or another, and return its path."""
    path = folder / "log.jsonl"
    records = [
        {"type": "imu", "ts_ns": ns, **dict(zip(_named(drive), map(float, row), strict=True))}
        for ns, row in zip(drive.ns.tolist(), np.column_stack([*_named(drive).values()]), strict=True)
    ]
    records += [
        {"type": "gps", "ts_ns": ns, **dict(zip(_positions(drive), map(float, row), strict=True))}
        for ns, row in zip(drive.gnss_ns.tolist(), np.column_stack([*_positions(drive).values()]), strict=True)
    ]
    path.write_text("\n".join(json.dumps(record) for record in sorted(records, key=lambda record: record["ts_ns"])))
    return path


WRITERS: dict[str, Callable[..., Path]] = {
    "text": write_text,
    "text, a row a value": write_can_trace,
    "text, Parquet": write_parquet,
    "text, SQLite": write_sqlite,
    "text, MATLAB": write_matlab,
    "text, NumPy": write_numpy,
    "text, JSON lines": write_json_lines,
    "vbo": write_vbo,
    "sensor-logger": write_sensor_logger,
    "sensor-logger, JSON": write_sensor_json,
    "phyphox": write_phyphox,
    "ros": write_ros2,
    "mcap": write_mcap,
    "mcap, JSON": write_mcap_json,
    "rcm-dx": write_rcm_dx,
    "rcm-dx, prefixed": write_prefixed_rcm_dx,
    "hdf5": write_onboard_eu,
    "mdf": write_mdf,
    "tdms": write_tdms,
}


def format_key(name: str) -> str:
    """Return the importer's name of a form in :data:`WRITERS`."""
    return "ros" if name == "mcap" else name.partition(",")[0]
