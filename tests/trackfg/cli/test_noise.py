"""``trackfg noise`` through its entry point: recordings and foreign logs, with and without a temperature."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

RATE_HZ = 20.0
RECORDING = """format = "trackfg-recording/1"
id = "parked"
[imu]
file = "imu.parquet"
gyro = ["wx", "wy", "wz"]
gyro_unit = "deg/s"
accel = ["fx", "fy", "fz"]
accel_unit = "g"
"""


Command = Callable[..., Any]


@pytest.fixture
def trackfg_noise(trackfg: Command) -> Command:
    return partial(trackfg, "noise")


@pytest.fixture(scope="module")
def log() -> pd.DataFrame:
    """Half an hour: gyro 1e-4 rad/s/sqrt(Hz) and 3e-5 rad/s/K, accelerometer 2e-3 m/s^2/sqrt(Hz)."""
    rng, count = np.random.default_rng(3), round(1800 * RATE_HZ)
    t = np.arange(count) / RATE_HZ
    heat = 30.0 + 3.0 * np.sin(t / 100.0)
    columns = {"t": t, "temperature": heat}
    for axis, gravity in zip("xyz", (0.0, 0.0, 9.8), strict=True):
        columns[f"gyro_{axis}_radps"] = 1e-4 * np.sqrt(RATE_HZ) * rng.standard_normal(count) + 3e-5 * heat
        columns[f"acc_{axis}_mps2"] = gravity + 2e-3 * np.sqrt(RATE_HZ) * rng.standard_normal(count)
    return pd.DataFrame(columns)


def test_a_table_to_import(log: pd.DataFrame, trackfg_noise: Command, tmp_path: Path) -> None:
    log.to_csv(tmp_path / "log.csv", index=False)
    done = trackfg_noise(tmp_path / "log.csv", "-o", tmp_path / "allan.csv")
    assert (done.returncode, done.stderr) == (0, "")
    block = tomllib.loads(done.stdout[done.stdout.index("[imu.noise]") : done.stdout.index("allan: ")])["imu"]["noise"]
    assert block["gyro_white"] == pytest.approx(1e-4, rel=0.02)
    assert block["accel_white"] == pytest.approx(2e-3, rel=0.02)
    assert 0.0 < block["gyro_bias_walk"] < 1e-6
    assert "no walk was seen" in done.stdout
    table = pd.read_csv(tmp_path / "allan.csv")
    assert set(table["axis"]) == {"x", "y", "z"}
    assert table["tau_s"].max() == pytest.approx(900.0, rel=0.01)
    assert (table["low"] < table["deviation"]).all()


def test_pulses_beside_a_rest_log_need_no_answer(log: pd.DataFrame, trackfg_noise: Command, tmp_path: Path) -> None:
    log.iloc[: round(100 * RATE_HZ)].assign(pulses=17).to_csv(tmp_path / "log.csv", index=False)
    done = trackfg_noise(tmp_path / "log.csv")
    assert done.returncode == 0, done.stderr


def test_a_recording_in_other_units(log: pd.DataFrame, trackfg_noise: Command, tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text(RECORDING, encoding="utf-8")
    table = log[["t", "temperature"]].rename(columns={"temperature": "chip_temp"})
    for axis in "xyz":
        table[f"w{axis}"] = np.rad2deg(log[f"gyro_{axis}_radps"])
        table[f"f{axis}"] = log[f"acc_{axis}_mps2"] / 9.80665
    table.loc[table["t"].between(200.0, 203.0), "fx"] += 0.2
    table.to_parquet(tmp_path / "imu.parquet")
    done = trackfg_noise(tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    assert "its longest rest is used, t = 20" in done.stderr
    noise = json.loads(done.stdout)
    assert noise["imu.noise"]["gyro_white"] == pytest.approx(1e-4, rel=0.02)
    assert noise["imu.noise"]["accel_white"] == pytest.approx(2e-3, rel=0.02)
    assert noise["temperature"] == "chip_temp"
    slopes = [row["per_kelvin"] for row in noise["axes"] if row["sensor"] == "gyro" and row["axis"] != "all"]
    assert slopes == pytest.approx([3e-5] * 3, rel=0.1)
    done = trackfg_noise(tmp_path, "--temperature", "chip_tmp")
    assert done.returncode == 2
    assert "imu.parquet: no column 'chip_tmp'; expected one of t, chip_temp" in done.stderr


@pytest.mark.parametrize("suffix", [".png", ".svg", ".html"])
def test_pictures(suffix: str, log: pd.DataFrame, trackfg_noise: Command, tmp_path: Path) -> None:
    log[: round(120 * RATE_HZ)].to_csv(tmp_path / "log.csv", index=False)
    done = trackfg_noise(tmp_path / "log.csv", "-o", tmp_path / f"allan{suffix}", "-q")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / f"allan{suffix}").stat().st_size > 10_000


def test_what_is_no_rest_is_refused(log: pd.DataFrame, trackfg_noise: Command, tmp_path: Path) -> None:
    log[: round(40 * RATE_HZ)].to_csv(tmp_path / "log.csv", index=False)
    for arguments, message in (
        ([tmp_path / "log.csv"], "the longest rest lasts 39 s; expected 60 s or more"),
        ([tmp_path / "nothing.csv"], "no such file or folder"),
        ([tmp_path / "log.csv", "-o", tmp_path / "a.pdf"], "expected a file that ends in .csv, .png, .svg or .html"),
    ):
        done = trackfg_noise(*arguments)
        assert done.returncode == 2
        assert message in done.stderr
        assert len(done.stderr.splitlines()) == 1
