"""A point that follows the track is where the whole run has it, or nowhere."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

sys.path.insert(0, str(Path(__file__).parents[3] / "tools"))

from robustness.low_cost import LowCostRun

TOTAL_S = 200.0


@cache
def simulation(ahead_m: float) -> Simulation:
    """A run whose sensor is so far ahead of the point that follows the track, which is not declared."""
    plan = scenario("shunting")
    return simulate(replace(plan, imu=replace(plan.imu, lever_arm_m=(ahead_m, 0.0, 0.0))), seed=2, duration_s=TOTAL_S)


def smoothed(imu: pd.DataFrame) -> SmoothedStates:
    recording: Recording = simulation(0.0).recording
    return smooth_states(replace(recording, imu=imu), SmoothConfig())


def doubted(result: SmoothedStates) -> list[str]:
    return [doubt.reason for doubt in result.doubts if "at the point that follows the track" in doubt.reason]


@pytest.mark.parametrize("ahead_m", [0.0, 1.5])
def test_a_point_that_stays_is_found(ahead_m: float) -> None:
    result = smoothed(simulation(ahead_m).recording.imu)
    assert result.solution.states.mount[0, 2] == pytest.approx(-ahead_m, abs=0.1)
    assert not doubted(result)


def test_a_point_that_moves_is_no_mounting() -> None:
    """The sensor seems to jump by 3 m half-way: what the data alone would have is not where it ever was."""
    first, then = (simulation(ahead_m).recording.imu for ahead_m in (3.0, 0.0))
    half = first["t_s"].to_numpy() < 0.5 * TOTAL_S
    result = smoothed(pd.DataFrame(np.where(half[:, None], first, then), columns=first.columns))
    assert abs(result.solution.states.mount[0, 2]) < 0.3
    assert "far-from-prior-mount" not in [finding.code for finding in result.findings]


def test_errors_that_last_and_pull_at_the_point_make_the_alignment_doubtful() -> None:
    """An engine's line that sampling folds into the forces of low-cost sensors: point and alignment erred by 20 sigmas
    and 3.4, and both were trusted.
    """
    run = LowCostRun(70).simulated()
    result = smooth_states(run.recording, SmoothConfig())
    assert abs(result.solution.states.mount[0, 2]) < 0.6
    assert doubted(result)
    (alignment,) = [one for one in result.verdicts if one.quantity == "alignment"]
    assert alignment.status == "widened"
    assert alignment.factor > 2.0
