"""Channels of several rates beside each other in one table have the times before them, not those of its rows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.shapes.side_by_side import parted
from trackfg.interchange.importing.source_table import SourceTable

Import = Callable[..., Imported]


def _blocks(drive: Drive, clock: Callable[[np.ndarray], object] = lambda t: t) -> pd.DataFrame:
    """Return the samples, the wheel's speed at a fifth of their rate and the positions, each behind a time."""
    imu = {"t_imu": clock(drive.t)}
    imu |= {f"g{axis} [rad/s]": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    imu |= {f"a{axis} [m/s2]": drive.accel[:, i] for i, axis in enumerate("xyz")}
    wheel = {"t_wheel": clock(drive.t[::5]), "wheel [m/s]": drive.speed[::5]}
    gnss = {"t_gps": clock(drive.gnss_t), "lat": drive.latitude, "lon": drive.longitude, "alt": drive.height}
    return pd.concat([pd.DataFrame(block) for block in (imu, wheel, gnss)], axis=1)


def _is_of(made: Imported, drive: Drive) -> None:
    recording = made.loaded.recording
    assert recording is not None
    assert recording.tach is not None
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-9)
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-9)
    zero = recording.imu["t_s"].iloc[0]
    np.testing.assert_allclose(recording.tach["t_s"] - zero, drive.t[::5], atol=1e-6)
    np.testing.assert_allclose(recording.gnss["t_s"] - zero, drive.gnss_t, atol=1e-6)


def test_csv(drive: Drive, tmp_path: Path, imported: Import) -> None:
    _blocks(drive).to_csv(tmp_path / "log.csv", index=False)
    _is_of(imported(tmp_path / "log.csv"), drive)


def test_dates(drive: Drive, tmp_path: Path, imported: Import) -> None:
    def dates(t: np.ndarray) -> pd.DatetimeIndex:
        return pd.Timestamp("2026-05-01T03:12:00Z") + pd.to_timedelta(np.round(t * 1e6), "us")

    _blocks(drive, dates).to_csv(tmp_path / "log.csv", index=False, sep=";")
    _is_of(imported(tmp_path / "log.csv"), drive)


def test_spreadsheet_with_equal_names_of_times(drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _blocks(drive)
    table.insert(7, "", None)
    book = openpyxl.Workbook()
    assert book.active is not None
    book.active.append(["Time [s]" if name.startswith("t_") else name for name in table.columns])
    for row in table.astype(object).where(table.notna(), None).itertuples(index=False):
        book.active.append(list(row))
    book.save(tmp_path / "log.xlsx")
    _is_of(imported(tmp_path / "log.xlsx"), drive)


@pytest.mark.parametrize("unit_s", [1.0, 1e-3])
def test_a_receiver_lost_in_a_tunnel_keeps_its_rows(drive: Drive, unit_s: float) -> None:
    """Its time ends with its positions, and advances as that of the rows does, in a unit of its own."""
    last = np.where(drive.t < 8.0, drive.t, np.nan)
    frame = pd.DataFrame({"time": drive.t, "gyro x": drive.gyro[:, 0], "gps time": last / unit_s, "lat": last + 46.0})
    table = SourceTable("log.csv", frame, {"gps time": "s" if unit_s == 1.0 else "ms"})
    assert parted(table) == [table]


def test_axes_in_words_and_in_letters_are_of_two_frames(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """An INS writes its samples along the sensor's axes, and without gravity along those of the vehicle."""
    table = pd.DataFrame({"Time (s)": drive.t})
    for words, turned, force in (
        ("XYZ", drive.gyro, drive.accel),
        (("forward", "lateral", "down"), 0.5 * drive.gyro, 0),
    ):
        table[[f"Acceleration {axis} (m/s²)" for axis in words]] = np.broadcast_to(force, drive.accel.shape)
        table[[f"Angular rate {axis} (rad/s)" for axis in words]] = turned
    table.to_csv(tmp_path / "ins.csv", index=False)
    recording = imported(tmp_path / "ins.csv").loaded.recording
    assert recording is not None
    np.testing.assert_allclose(recording.accel, drive.accel, atol=1e-9)
    np.testing.assert_allclose(recording.gyro, drive.gyro, atol=1e-9)
