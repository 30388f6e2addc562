"""The benchmark of the papers: its real entry point on one seed, its table, and the bound that it states."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.sensors.imu_grades import ADIS16480
from trackfg.numerics.units import STANDARD_GRAVITY

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("papers.table")


@pytest.mark.slow
def test_one_seed_of_one_paper(tmp_path: Path) -> None:
    out = tmp_path / "papers.csv"
    command = [sys.executable, TOOLS / "papers.py", "--paper", "001", "--seeds", "1", "--jobs", "1", "--out", out]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "001  IMM-EKF" in done.stdout
    assert "slip angle rms, mrad, 10 modes" in done.stdout
    table = pd.read_csv(out, dtype={"paper": str}).set_index("quantity")
    assert (table["paper"] == "001").all()
    assert table.loc["friction at mu 0.8, graph", "smoother_mean"] == pytest.approx(0.8, abs=0.05)
    assert set(table["met"].dropna()) <= {"yes", "NO"}


def test_an_unknown_paper_is_refused(refusal: Callable[..., str]) -> None:
    assert "invalid choice: '005'" in refusal("papers", "--paper", "005")


def test_a_line_holds_mean_interval_and_range(tool: ModuleType) -> None:
    paper = tool.Part("000", "a method", lambda seed: {}, lambda measured: [])
    lines = [
        tool.Comparison("error, mm", "<= 1.0", "baseline <= 1.0", [1.0, 2.0, 3.0], None, False),
        tool.Comparison("error, mm", "-", "smoother <= 0.5 of it", [2.0, 2.0], [1.0, 0.5], True),
        tool.Comparison("error, mm", "-", "-", [np.nan, 4.0]),
    ]
    table = tool.table_of(paper, lines)
    # Student's t for two degrees of freedom, 4.303, over the square root of 3.
    assert table["baseline_margin"][0] == pytest.approx(4.303 / np.sqrt(3.0), rel=1e-3)
    assert list(table["met"]) == ["NO", "yes", ""]
    assert table["ratio"][1] == pytest.approx(0.375)
    shown = tool.printed(table)
    assert "2 +- 2.5 [1 .. 3]" in shown
    assert "NO" in shown
    assert table["baseline_seeds"][2] == 1


def test_bound_of_the_twist_is_the_best_smoothers(tool: ModuleType) -> None:
    """Against the inverse of the information matrix of a discrete walk, seen by the accelerometer at every step."""
    attitude = importlib.import_module("papers.attitude")
    noise, speed, dt = ADIS16480.noise, 2.0, 0.05
    n, lag = 600, round(attitude.TWIST_BASE_M / speed / dt)
    walk = 1.0 / (noise.gyro_white**2 * dt)
    seen = dt / (np.hypot(noise.accel_white, speed * noise.gyro_white) / STANDARD_GRAVITY) ** 2
    information = np.diag(np.full(n, seen + 2.0 * walk)) - walk * (np.eye(n, k=1) + np.eye(n, k=-1))
    information[[0, -1], [0, -1]] -= walk
    covariance = np.linalg.inv(information)
    i, j = n // 2, n // 2 + lag
    expected = np.sqrt(covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j])
    assert attitude.least_twist_sd_rad(noise, np.array(speed)) == pytest.approx(expected, rel=0.01)
    gyro_alone = noise.model_copy(update={"accel_white": 1e3})
    expected = noise.gyro_white * np.sqrt(attitude.TWIST_BASE_M / speed)
    assert attitude.least_twist_sd_rad(gyro_alone, np.array(speed)) == pytest.approx(expected, rel=1e-3)
