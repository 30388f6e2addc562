"""Drives of the Wheel Inertial Dataset, in files as it has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackfg.datasets.real import wid
from trackfg.errors import BadInputError

RATE_HZ, DURATION_S, LATE_S = 120.0, 12.0, 0.5
SPEED_MPS = 3.0


def write_sensor(path: Path, t: np.ndarray, accel: np.ndarray, gyro_dps: np.ndarray) -> None:
    """The clock counts microseconds, and starts again at 2^32; the first row is empty."""
    ticks = (2**32 - 3_000_000 + np.round(1e6 * t).astype(np.int64)) % 2**32
    rows = np.column_stack([accel, gyro_dps])
    rows[0] = 0.0
    kinds = ",".join(f"{kind}_{axis}" for kind in ("Euler", "Acc", "Gyr") for axis in "XYZ")
    lines = ["sep=,", f"PacketCounter,SampleTimeFine,{kinds},"]
    lines += [
        f"{i}, {tick}, 0, 0, 0, {', '.join(map(str, row))}, "
        for i, (tick, row) in enumerate(zip(ticks.tolist(), rows.tolist(), strict=True))
    ]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """At rest for 4 s, then northwards at a speed that changes; one wheel's record begins half a second later."""
    t = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    accel = np.tile([0.3, 0.1, 9.8], (len(t), 1))
    write_sensor(tmp_path / "CAR.csv", t, accel, np.tile([1.0, 2.0, 3.0], (len(t), 1)))
    for name, late_s, sign in (("IMU2", 0.0, -1.0), ("IMU4", LATE_S, 1.0)):
        turning = np.degrees(speed(t + late_s)) / wid.WHEEL_RADIUS_M
        write_sensor(tmp_path / f"{name}.csv", t, accel, sign * np.outer(turning, [0.0, 0.0, 1.0]))
    rows = np.arange(0.0, DURATION_S, 0.01)
    latitude = 32.0 + np.floor(rows / 0.2 + 1e-6) * 0.2 * 1e-5
    lines = [f"{10.0 * at},{lat!r},35.0,40.0" for at, lat in zip(rows.tolist(), latitude.tolist(), strict=True)]
    (tmp_path / "GNSS.csv").write_text("\n".join(["Timestamp,Lat_GNSS,Long_GNSS,Height_GNSS", *lines]) + "\n")
    return tmp_path


def speed(t: np.ndarray) -> np.ndarray:
    return np.where(t > 4.0, SPEED_MPS * np.sin(0.4 * (t - 4.0)) ** 2, 0.0)


def test_axes_clocks_and_units(folder: Path) -> None:
    run = wid.load(folder)
    imu, tach, reference = run.recording.imu, run.recording.tach, run.reference
    assert len(imu) == DURATION_S * RATE_HZ - 1
    np.testing.assert_allclose(imu[["fx_mps2", "fy_mps2", "fz_mps2"]].iloc[0], [0.1, -0.3, 9.8])
    np.testing.assert_allclose(imu[["wx_radps", "wy_radps", "wz_radps"]].iloc[0], np.radians([2.0, -1.0, 3.0]))
    assert imu["t_s"].iloc[-1] == pytest.approx(DURATION_S - 1.0 / RATE_HZ)
    assert tach is not None
    t = tach["t_s"].to_numpy()
    within = t < DURATION_S - 2.0 * LATE_S
    np.testing.assert_allclose(np.gradient(tach["distance_m"], t)[within], speed(t)[within], atol=0.05)
    assert np.diff(reference["t_s"]) == pytest.approx(0.2)
    np.testing.assert_allclose(np.diff(reference["north_m"]) / 0.2, 1.109, atol=0.01)


def test_garbled_rows_are_left_out(folder: Path) -> None:
    lines = (folder / "CAR.csv").read_text().splitlines()
    lines[100] = lines[100].replace("9.8", "1e19")
    lines[200] = lines[200].replace("9.8", "x")
    (folder / "CAR.csv").write_text("\n".join(lines))
    assert len(wid.load(folder).recording.imu) == DURATION_S * RATE_HZ - 3


def test_other_files_are_refused_by_name(folder: Path) -> None:
    (folder / "IMU4.csv").write_text("sep=,\nt,x\n0,1\n")
    with pytest.raises(BadInputError, match=r"IMU4\.csv: expected the columns SampleTimeFine"):
        wid.load(folder)
    (folder / "IMU4.csv").unlink()
    with pytest.raises(BadInputError, match=r"Wheel Inertial Dataset; missing: IMU4\.csv"):
        wid.load(folder)
