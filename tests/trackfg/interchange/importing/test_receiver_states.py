"""Rows without a position are left out, and sigmas follow the dilution of precision, whatever format a log has."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.interchange.importing.columns.receiver_state import range_sd_m, without_position
from trackfg.interchange.importing.conversion import Imported, converted
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.mapping import FORMAT, mapping_of
from trackfg.interchange.importing.source_table import SourceTable

Import = Callable[..., Imported]
Tables = dict[str, pd.DataFrame]
NAMES = [f"{kind}_{axis}" for kind in ("gyro", "acc") for axis in "xyz"]
KNOWN = np.arange(20) % 5 > 0
WORDS = {0: "no fix", 6: "dead reckoning", 4: "RTK"}


def _tables(drive: Drive) -> Tables:
    """Return an IMU and a receiver, which loses its position in every fifth row, and estimates it in one of four."""
    imu = pd.DataFrame(np.column_stack([drive.gyro, drive.accel]), columns=NAMES)
    imu.insert(0, "time_s", drive.t)
    quality = np.where(KNOWN, 4, np.where(np.arange(20) == 5, 6, 0))
    gnss = {"time_s": drive.gnss_t, "lat": drive.latitude, "lon": drive.longitude, "alt": drive.height}
    return {"imu": imu, "gps": pd.DataFrame({**gnss, "hdop": np.where(KNOWN, 1.5, 99.9), "fix_quality": quality})}


def _cells(column: pd.Series) -> list:
    return [WORDS[value] for value in column] if column.name == "fix_quality" else column.tolist()


def _compound_hdf5(tables: Tables, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "log.h5", "w") as file:
        for name, table in tables.items():
            kinds = [(n, h5py.string_dtype() if n == "fix_quality" else "f8") for n in table]
            rows = list(zip(*(_cells(table[column]) for column in table), strict=True))
            file.create_dataset(name, data=np.array(rows, dtype=kinds))
    return folder / "log.h5"


def _hdf5_arrays(tables: Tables, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "log.h5", "w") as file:
        file["gps/names of channels"] = ["lat", "lon", "alt"]
        for name, table in tables.items():
            for column in table:
                file[f"{name}/{column}"] = _cells(table[column])
    return folder / "log.h5"


def _hdf5_flags(tables: Tables, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "log.h5", "w") as file:
        for name, table in tables.items():
            for column in table:
                flags = column == "fix_quality"
                file[f"{name}/{'valid' if flags else column}"] = KNOWN if flags else table[column].to_numpy()
    return folder / "log.h5"


def _matlab(tables: Tables, folder: Path) -> Path:
    from scipy.io import savemat

    structs = {
        name: {column: np.array(_cells(table[column]), dtype=object if column == "fix_quality" else "f8")
               for column in table}
        for name, table in tables.items()
    }  # fmt: skip
    savemat(folder / "log.mat", structs)
    return folder / "log.mat"


def _tdms(tables: Tables, folder: Path) -> Path:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(folder / "log.tdms") as writer:
        for name, table in tables.items():
            writer.write_segment([nptdms.ChannelObject(name, column, _cells(table[column])) for column in table])
    return folder / "log.tdms"


def _mdf_words(tables: Tables, folder: Path) -> Path:
    """Write codes with words for them."""
    asammdf = pytest.importorskip("asammdf")
    words = {f"val_{i}": code for i, code in enumerate(WORDS)} | {f"text_{i}": w for i, w in enumerate(WORDS.values())}
    with asammdf.MDF(version="4.10") as file:
        for name, table in tables.items():
            signals = [
                asammdf.Signal(
                    table[column].to_numpy(np.uint8 if column == "fix_quality" else np.float64),
                    table["time_s"].to_numpy(),
                    name=column,
                    conversion=words if column == "fix_quality" else None,
                )
                for column in table.columns[1:]
            ]
            file.append(signals, acq_name=name)
        file.save(folder / "log.mf4")
    return folder / "log.mf4"


def _mcap_json(tables: Tables, folder: Path) -> Path:
    writers = pytest.importorskip("mcap.writer")
    with (folder / "log.mcap").open("wb") as stream:
        writer = writers.Writer(stream)
        writer.start()
        for name, table in tables.items():
            schema = writer.register_schema(name=name, encoding="jsonschema", data=b'{"type": "object"}')
            channel = writer.register_channel(topic=f"/{name}", message_encoding="json", schema_id=schema)
            columns = {column: _cells(table[column]) for column in table.columns[1:]}
            for i, t in enumerate(table["time_s"]):
                ns = round(1e9 * (1.7e9 + t))
                message = {"frame_id": name, **{column: cells[i] for column, cells in columns.items()}}
                writer.add_message(channel, log_time=ns, publish_time=ns, data=json.dumps(message).encode())
        writer.finish()
    return folder / "log.mcap"


def _ros(tables: Tables, folder: Path) -> Path:
    """Write a bag with a receiver's own message, in whose status -1 is no position, as in ``NavSatStatus``."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    fields = "\n".join(f"float64 {name}" for name in NAMES)
    store.register(get_types_from_msg(fields, "acme_msgs/msg/Inertial"))
    store.register(get_types_from_msg("int16 status\nstring note", "acme_msgs/msg/Status"))
    fix = "acme_msgs/Status status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\nfloat64 hdop"
    store.register(get_types_from_msg(fix, "acme_msgs/msg/Fix"))
    kinds = {"imu": "acme_msgs/msg/Inertial", "gps": "acme_msgs/msg/Fix"}
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for name, table in tables.items():
            connection = writer.add_connection(f"/{name}", kinds[name], typestore=store)
            for row in table.to_dict("records"):
                t, cells = row.pop("time_s"), list(row.values())
                if name == "gps":
                    status = store.types["acme_msgs/msg/Status"](status=0 if cells.pop() == 4 else -1, note="")
                    cells = [status, *cells]
                message = store.types[kinds[name]](*cells)
                writer.write(connection, round(1e9 * (1.7e9 + t)), store.serialize_cdr(message, kinds[name]))
    return folder / "bag"


@pytest.mark.parametrize(
    ("write", "range_sd_m"),
    [(write, 0.05) for write in (_compound_hdf5, _hdf5_arrays, _matlab, _tdms, _mdf_words, _mcap_json)]
    + [(write, 3.0) for write in (_hdf5_flags, _ros)],  # without a quality
)
def test_states_of_a_receiver_are_read_from_every_format(
    write: Callable[[Tables, Path], Path], range_sd_m: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    recording = imported(write(_tables(drive), tmp_path)).loaded.recording

    assert recording is not None
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["t_s"] - recording.imu["t_s"].iloc[0], drive.gnss_t[KNOWN], atol=1e-6)
    np.testing.assert_allclose(recording.gnss["east_sd_m"], 1.5 * range_sd_m)
    np.testing.assert_allclose(recording.gnss["up_sd_m"], 3.0 * range_sd_m)


@pytest.mark.parametrize(
    ("name", "states", "lost"),
    [
        ("fix_quality", [0, 1, 4, 6, 8], [True, False, False, True, False]),
        ("quality", [0, 6, 60, 99], [True, False, False, False]),  # per cent
        ("fixType", [0, 1, 3, 6], [True, True, False, False]),  # 6: ambiguities are fixed (MAVLink)
        ("fix type", [0, 1, 2], [True, False, False]),  # with corrections or without
        ("status.status", [0, 1, 2], [False, False, False]),
        ("status.status", [-1, 0, 1], [True, False, False]),
        ("gps_status", ["NO_FIX", "3D", "", None], [True, False, True, True]),
    ],
)
def test_states_without_a_measured_position(name: str, states: list, lost: list[bool]) -> None:
    assert without_position(pd.Series(states, name=name)).tolist() == lost


@pytest.mark.parametrize(
    ("name", "states", "expected"),
    [
        ("GPS Quality", [1, 2, 4, 5], [3.0, 1.0, 0.05, 0.5]),
        ("quality", [4, 60, 99], [3.0, 3.0, 3.0]),  # per cent
        ("fixType", [2, 3, 4], [3.0, 3.0, 3.0]),  # 4 of UBX: with dead reckoning
        ("pos_type", ["NARROW_INT", "L1_FLOAT", "PSRDIFF", "SINGLE"], [0.05, 0.5, 1.0, 3.0]),
        ("fix_status", ["RTK fixed", "RTK Float", "DGPS", "fixed", None], [0.05, 0.5, 1.0, 3.0, 3.0]),
    ],
)
def test_qualities_show_how_good_positions_are(name: str, states: list, expected: list[float]) -> None:
    assert range_sd_m(pd.Series(states, name=name)).tolist() == expected


def test_positions_of_a_table_are_as_good_as_those_of_a_receiver_s_log(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    tables = _tables(drive)
    fixed = np.arange(20) < 10
    tables["gps"] = tables["gps"].assign(hdop=0.8, fix_quality=np.where(fixed, 4, 1)).drop(columns="alt")
    folder = tmp_path / "log"
    folder.mkdir()
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)

    recording = imported(folder).loaded.recording

    assert recording is not None
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["east_sd_m"], np.where(fixed, 0.04, 2.4))
    np.testing.assert_allclose(recording.gnss["up_sd_m"], 1000.0)  # no quality says how high the line is


def test_a_height_that_a_mapping_states_is_not_diluted(drive: Drive, tmp_path: Path) -> None:
    _tables(drive)["gps"].drop(columns="alt").assign(fix_quality=4).to_csv(tmp_path / "gps.csv", index=False)
    table = read_text(tmp_path / "gps.csv", None)
    imu = SourceTable("imu.csv", _tables(drive)["imu"])
    place = {"position": ["lat", "lon", 412.0], "sd": [3.0, 3.0, 5.0], "dop": "hdop", "quality": "fix_quality"}
    axes = {"gyro": NAMES[:3], "gyro_unit": "rad/s", "accel": NAMES[3:], "accel_unit": "m/s^2", "axes": "FLU"}
    sections = {"imu": {"file": "imu.csv", "time": "time_s", **axes, "rigid": False}}
    mapping = {"format": FORMAT, **sections, "gnss": {"file": "gps.csv", "time": "time_s", **place}}

    recorded = converted([imu, table], mapping_of(mapping, "mapping"), run_id="run").files["gnss.parquet"]

    assert (recorded["constant_3"] == 412.0).all()
    np.testing.assert_allclose(recorded["constant_4"][KNOWN], 0.05 * 1.5)
    assert (recorded["constant_6"] == 5.0).all()


def test_positions_that_a_logger_has_interpolated_are_left_out_with_a_note(tmp_path: Path) -> None:
    t, at = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 61.0)
    measured = [46.9 + 1e-4 * at, 7.4 + 1e-6 * np.random.default_rng(1).standard_normal(at.size)]
    lat, lon = (np.round(np.interp(t, at, place), 9) for place in measured)
    gps = SourceTable("gps.csv", pd.DataFrame({"t": t, "lat": lat, "lon": lon}))
    imu = pd.DataFrame({"t": t, **dict.fromkeys("abcde", 0.0), "f": 9.81})
    sections = {
        "format": "trackfg-mapping/1",
        "imu": {"file": "imu.csv", "gyro": ["a", "b", "c"], "accel": ["d", "e", "f"]},
        "gnss": {"file": "gps.csv", "position": ["lat", "lon", 500.0], "sd": [1.0, 1.0, 2.0]},
    }

    made = converted([gps, SourceTable("imu.csv", imu)], mapping_of(sections, "m"), run_id="log")

    np.testing.assert_allclose(made.files["gnss.parquet"]["t"], [*at[:-1], t[-1]])
    assert made.notes == ("gps.csv: 539 of 600 rows are interpolated, and are left out of [gnss]",)
