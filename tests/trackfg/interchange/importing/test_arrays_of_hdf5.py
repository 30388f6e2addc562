"""Arrays in HDF5: those of netCDF-4 have units and a date from which times count, those of pandas names beside them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interchange.foreign_forms import Drive

from trackfg.interchange.importing.conversion import Imported
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
