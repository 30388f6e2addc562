"""Arrays in HDF5: those of netCDF-4 have units and a date from which times count, those of pandas names beside them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interchange.foreign_forms import Drive
from scipy.io import netcdf_file

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.shapes.packed_values import scale_in
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
h5py = pytest.importorskip("h5py")
GYRO, ACCEL = ("gyro_x", "gyro_y", "gyro_z"), ("acc_x", "acc_y", "acc_z")


def _is_of(made: Imported, drive: Drive) -> Recording:
    recording = made.loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-12)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-12)
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-6)
    assert recording.description.start == datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    assert recording.tach is not None
    rolled = np.ptp(recording.tach["distance_m"])
    assert rolled == pytest.approx(np.trapezoid(drive.speed, drive.t), rel=1e-3)
    return recording


@pytest.mark.parametrize(
    ("unit", "ticks"),
    [
        ("nanoseconds since 2026-05-01 03:12:00", 1_000_000_000),
        ("seconds since 2026-05-01T03:12:00Z", 1.0),
        ("milliseconds since 2026-05-01 03:12", 1000.0),
        ("days since 2026-05-01 03:12:00.000 +00:00", 1.0 / 86400.0),
    ],
)
def test_netcdf_states_units_and_the_date_of_its_times(
    unit: str, ticks: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    times = drive.t * ticks
    columns = {
        "time": (np.round(times).astype(np.int64) if ticks > 1e6 else times, unit),
        **{name: (np.degrees(values), "deg s-1") for name, values in zip(GYRO, drive.gyro.T, strict=True)},
        **{name: (values, "m s-2") for name, values in zip(ACCEL, drive.accel.T, strict=True)},
        "wheel_speed": (drive.speed * 3.6, "km/h"),
    }
    with h5py.File(tmp_path / "run.nc", "w") as file:
        for name, (values, stated) in columns.items():
            file.create_dataset(name, data=values).attrs["units"] = stated
    recording = _is_of(imported(tmp_path / "run.nc"), drive)
    assert recording.description.imu.gyro_unit == "deg/s"


def _fixed(file: Any, key: str, drive: Drive, columns: dict[str, np.ndarray]) -> None:
    """As ``DataFrame.to_hdf`` writes a table of numbers with an index of dates."""
    group = file.create_group(key)
    group.attrs["pandas_type"], group.attrs["nblocks"] = np.bytes_(b"frame"), 2
    index = group.create_dataset("axis1", data=drive.ns)
    index.attrs["kind"], index.attrs["name"] = np.bytes_(b"datetime64[ns]"), np.bytes_(b"N.")
    group["block0_items"] = np.array([name.encode() for name in columns])
    group["block0_values"] = np.stack(list(columns.values()), axis=1)
    group["block1_items"] = np.array([b"driver"])
    texts = group.create_dataset("block1_values", shape=(1,), dtype=h5py.vlen_dtype(np.uint8))
    texts[0] = np.frombuffer(b"a pickle of texts", dtype=np.uint8)


def _table(file: Any, key: str, drive: Drive, columns: dict[str, np.ndarray]) -> None:
    """As ``DataFrame.to_hdf(format="table")`` does."""
    group = file.create_group(key)
    group.attrs["pandas_type"] = np.bytes_(b"frame_table")
    rows = np.empty(len(drive.ns), dtype=[("index", "i8"), ("values_block_0", "f8", (len(columns),))])
    rows["index"], rows["values_block_0"] = drive.ns, np.stack(list(columns.values()), axis=1)
    table = group.create_dataset("table", data=rows)
    table.attrs["index_kind"] = np.bytes_(b"datetime64[ns]")
    names = b"a".join(b"V%s\np%d\n" % (name.encode(), i) for i, name in enumerate(columns, start=1))
    table.attrs["values_block_0_kind"] = np.bytes_(b"(lp0\n" + names + b"a.")


@pytest.mark.parametrize("write", [_fixed, _table])
def test_tables_of_pandas_have_their_names(
    write: Callable[..., None], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    inertial = dict(zip((*GYRO, *ACCEL), (*drive.gyro.T, *drive.accel.T), strict=True))
    with h5py.File(tmp_path / "run.h5", "w") as file:
        write(file, "imu", drive, inertial)
        write(file, "wheel", drive, {"wheel_speed_mps": drive.speed})
    _is_of(imported(tmp_path / "run.h5"), drive)


@pytest.mark.parametrize(
    ("scale", "offset", "unit"),
    [("scale", "offset", "unit"), ("scale_factor", "add_offset", "units"), ("gain", "offset", "Unit")],
)
def test_counts_are_multiplied_by_what_attributes_say_of_one(
    scale: str, offset: str, unit: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.create_dataset("time", data=drive.t).attrs[unit] = "s"
        for names, values, count, stated in ((GYRO, drive.gyro, 1e-6, "rad/s"), (ACCEL, drive.accel, 5e-4, "m/s^2")):
            for name, column in zip(names, values.T, strict=True):
                dataset = file.create_dataset(name, data=np.round((column - 0.01) / count).astype(np.int32))
                dataset.attrs[scale], dataset.attrs[offset], dataset.attrs[unit] = count, 0.01, stated
    recording = imported(tmp_path / "run.h5").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-6)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=5e-4)


def test_a_scale_may_be_of_a_group_and_be_written_with_its_unit(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.create_dataset("time", data=drive.t).attrs["units"] = "s"
        for name, values, count, unit in (("gyro", drive.gyro, 1e-6, "rad/s"), ("acc", drive.accel, 5e-4, "m/s^2")):
            group = file.create_group(name)
            group.attrs["scale"] = f"{count:g} {unit}"
            for axis, column in zip("xyz", values.T, strict=True):
                group[axis] = np.round(column / count).astype(np.int32)
    recording = imported(tmp_path / "run.h5").loaded.recording
    assert recording is not None
    assert recording.description.imu.gyro_unit == "rad/s"
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-6)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=5e-4)


def test_a_unit_may_be_an_array_of_one_text(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, values, unit in (
            ("time", 1e3 * drive.t, b"ms"),
            ("gyro", 1e3 * drive.gyro, b"mrad/s"),
            ("accel", drive.accel, b"m/s^2"),
        ):
            file.create_dataset(name, data=values).attrs["units"] = np.array([unit])
    recording = imported(tmp_path / "run.h5").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-12)
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-9)


def test_a_scale_beside_values_is_not_applied_and_named(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time_s"] = drive.t
        for name, column in zip((*GYRO, *ACCEL), np.hstack([drive.gyro, drive.accel]).T, strict=True):
            file.create_dataset(name, data=column).attrs["scale"] = 0.25
    recording = imported(tmp_path / "run.h5").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-12)
    tables = source_format(tmp_path / "run.h5").tables(tmp_path / "run.h5", lambda _: None)
    assert "attribute scale is not applied" in tables[0].notes[0]


def test_the_gain_of_an_amplifier_is_no_scale() -> None:
    assert scale_in({"gain": 10.0}, np.dtype(np.int16)) is None
    assert scale_in({"gain": 0.25}, np.dtype(np.int16)) == "gain"
    assert scale_in({"scale": 0.25}, np.dtype(np.float64)) is None


@pytest.mark.parametrize("packed", [False, True])
def test_classic_netcdf_has_units_dates_and_packed_values(
    packed: bool, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    columns = {
        **{name: (values, "rad/s") for name, values in zip(GYRO, drive.gyro.T, strict=True)},
        **{name: (values, "m s-2") for name, values in zip(ACCEL, drive.accel.T, strict=True)},
        "wheel_speed": (drive.speed * 3.6, "km/h"),
    }
    with netcdf_file(tmp_path / "run.nc", "w", version=2 if packed else 1) as file:
        file.createDimension("time", None if packed else drive.t.size)
        times = file.createVariable("time", "d", ("time",))
        times[:], times.units = drive.t, "seconds since 2026-05-01 03:12:00"
        for name, (values, unit) in columns.items():
            variable = file.createVariable(name, "i" if packed else "d", ("time",))
            variable.units = unit
            if packed:
                variable.scale_factor, variable.add_offset = np.float64(1e-8), np.float64(5.0)
                variable[:] = np.round((values - 5.0) / 1e-8)
            else:
                variable[:] = values
    recording = imported(tmp_path / "run.nc").loaded.recording
    assert recording is not None
    assert recording.description.start == datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-8)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-8)
    assert recording.tach is not None
    rolled = np.ptp(recording.tach["distance_m"])
    assert rolled == pytest.approx(np.trapezoid(drive.speed, drive.t), rel=1e-3)


def test_netcdf_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.nc").write_bytes(b"CDF\x01" + bytes(200))
    form = source_format(tmp_path / "run.nc")
    with pytest.raises(BadInputError, match=r"run\.nc: .*expected"):
        form.tables(tmp_path / "run.nc", lambda _: None)


@pytest.mark.parametrize(
    ("place", "name", "value"),
    [
        ("array", "dt", 0.01),
        ("group", "sample_rate", 100.0),
        ("data set", "dt", np.array([0.01])),
        ("data set", "fs", 100),
        ("compound", "fs", 100),
    ],
)
def test_arrays_without_times_have_the_rate_that_is_stated_beside_them(
    place: str, name: str, value: Any, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        if place == "compound":
            columns = {**dict(zip(GYRO, drive.gyro.T, strict=True)), **dict(zip(ACCEL, drive.accel.T, strict=True))}
            rows = np.rec.fromarrays(list(columns.values()), names=list(columns))
            file.create_dataset("imu", data=rows).attrs[name] = value
        else:
            group = file.create_group("imu")
            arrays = [group.create_dataset(key, data=v) for key, v in (("gyro", drive.gyro), ("acc", drive.accel))]
            wheel = file.create_group("wheel")
            wheel.create_dataset("wheel_speed", data=drive.speed[::10])
            wheel.attrs["fs"] = 10.0
            if place == "data set":
                group[name] = value
            for item in arrays if place == "array" else [group] if place == "group" else []:
                item.attrs[name] = value
    recording = imported(tmp_path / "run.h5").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-9)
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-12)


def test_an_interval_of_no_sensor_is_none(drive: Drive, tmp_path: Path, imported: Import) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["gyro"], file["acc"], file["dt"] = drive.gyro, drive.accel, 10  # ms, which nothing states
    with pytest.raises(BadInputError, match="Samples per second"):
        imported(tmp_path / "run.h5")
