"""The wheel's column is found among others, however a log writes what a wheel does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.interchange.importing.conversion import Imported
from trackfg.recording.model import Recording

Import = Callable[..., Imported]
PULSES_PER_M = 10.0
WHEEL = {"tach_pulses_per_rev": "10", "tach_wheel_diameter_m": str(1.0 / np.pi)}


def _table(drive: Drive) -> pd.DataFrame:
    names = [f"gyro_{axis} [rad/s]" for axis in "xyz"] + [f"acc_{axis} [m/s^2]" for axis in "xyz"]
    table = pd.DataFrame(np.hstack([drive.gyro, drive.accel]), columns=names)
    table.insert(0, "time [s]", drive.t)
    return table


def _distance(drive: Drive) -> np.ndarray:
    return np.cumsum(drive.speed) / 100.0


def _rolled(recording: Recording, drive: Drive) -> None:
    """Assert that the tach has rolled as far as the drive between any two of its rows, but for a pulse."""
    assert recording.tach is not None
    distance = np.interp(recording.tach["t_s"], drive.t, _distance(drive))
    measured = recording.tach["distance_m"].to_numpy()
    np.testing.assert_allclose(measured - measured[0], distance - distance[0], atol=1.1 / PULSES_PER_M)
    assert np.ptp(measured) > 0.9 * np.ptp(_distance(drive))


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("Tacho frequency [Hz]", PULSES_PER_M),
        ("Tacho [km/h]", 3.6),
        ("Tacho [rpm]", 60.0),
    ],
)
def test_a_tacho_is_a_counter_unless_its_unit_says_otherwise(
    name: str, factor: float, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _table(drive).assign(**{name: drive.speed * factor}).to_csv(tmp_path / "log.csv", index=False)
    _rolled(_recording(imported(tmp_path / "log.csv", **WHEEL)), drive)


def test_a_voltage_is_no_count(drive: Drive, tmp_path: Path, imported: Import) -> None:
    voltage = 2.5 + np.sin(2.0 * np.pi * PULSES_PER_M * _distance(drive))
    _table(drive).assign(**{"Tacho [V]": voltage}).to_csv(tmp_path / "log.csv", index=False)
    assert _recording(imported(tmp_path / "log.csv", **WHEEL)).tach is None


def test_the_rises_of_a_level_are_pulses(drive: Drive, tmp_path: Path, imported: Import) -> None:
    level = (PULSES_PER_M * _distance(drive) % 1.0 >= 0.5).astype(int)
    _table(drive).assign(Tacho=level).to_csv(tmp_path / "log.csv", index=False)
    _rolled(_recording(imported(tmp_path / "log.csv", **WHEEL)), drive)


def test_ones_of_pulses_in_each_row_are_no_levels(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """At 100 Hz the wheel gives up to 0.3 pulses a row, so that ones stand alone."""
    pulses = np.diff(np.floor(PULSES_PER_M * _distance(drive)), prepend=0.0).astype(int)
    assert pulses.max() == 1
    _table(drive).assign(Tacho=pulses).to_csv(tmp_path / "log.csv", index=False)
    _rolled(_recording(imported(tmp_path / "log.csv", **WHEEL)), drive)


@pytest.mark.parametrize("head", ["timestamp_us,edge", "timestamp_us", None])
def test_times_alone_are_those_of_pulses(head: str | None, drive: Drive, tmp_path: Path, imported: Import) -> None:
    table = _table(drive)
    table["time [s]"] = drive.ns // 1000
    table.rename(columns={"time [s]": "timestamp_us"}).to_csv(tmp_path / "imu.csv", index=False)
    distance = _distance(drive)
    moving = distance > 0.0
    at = np.interp(np.arange(0.1, distance[-1], 1.0 / PULSES_PER_M), distance[moving], drive.ns[moving] // 1000)
    rows = [f"{t:.0f}{',rising' if head and 'edge' in head else ''}" for t in at]
    (tmp_path / "pulses.csv").write_text("\n".join([*([head] if head else []), *rows]) + "\n", encoding="utf-8")
    _rolled(_recording(imported(tmp_path, **WHEEL)), drive)


def test_turns_of_an_engine_are_no_wheel_s(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """In a trace of signals, each of which is a table of its own, the engine's comes first by its name."""
    values = _table(drive).set_index("time [s]").rename(columns=lambda name: name.partition(" ")[0])
    values["AEC1.EngineSpeed"] = 800.0 + drive.t
    values["CCVS1.WheelBasedVehicleSpeed"] = 3.6 * drive.speed
    units = dict.fromkeys(values, "m/s^2") | {f"gyro_{axis}": "rad/s" for axis in "xyz"}
    units |= {"AEC1.EngineSpeed": "rpm", "CCVS1.WheelBasedVehicleSpeed": "km/h"}
    long = values.rename_axis("Time").reset_index().melt("Time", var_name="Signal", value_name="Value")
    long["Unit"] = long["Signal"].map(units)
    long.sort_values("Time", kind="stable").to_csv(tmp_path / "can.csv", index=False)
    _rolled(_recording(imported(tmp_path / "can.csv")), drive)


def test_of_two_speeds_beside_positions_the_one_that_changes_between_them_is_asked_for(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    last = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    table = _table(drive).assign(latitude=drive.latitude[last], longitude=drive.longitude[last])
    table["speed"] = np.interp(drive.gnss_t, drive.t, drive.speed)[last]
    table["vehicle_speed_kmh"] = 3.6 * drive.speed
    table.to_csv(tmp_path / "log.csv", index=False)
    recording = _recording(imported(tmp_path / "log.csv"))
    _rolled(recording, drive)
    assert recording.others["gnss_speed"]["speed_mps"].max() == pytest.approx(drive.speed.max(), rel=0.02)
