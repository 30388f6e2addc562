from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.baselines.result import BaselineResult
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.numerics.arrays import Array
from trackfg.peers import vqf_offline

ErrorOf = Callable[[BaselineResult, Simulation, str], Array]

pytest.importorskip("vqf")


@pytest.fixture(scope="module")
def train() -> Simulation:
    """From rest through canted curves, with perfect sensors."""
    return simulate("mainline", seed=1, duration_s=200.0, noise=False)


@pytest.fixture(scope="module")
def result(train: Simulation) -> BaselineResult:
    return vqf_offline.run(train.recording)


def test_roll_and_pitch_come_back_with_their_signs(
    train: Simulation, result: BaselineResult, error_of: ErrorOf
) -> None:
    assert np.ptp(train.truth["roll_rad"]) > 0.05
    assert np.abs(error_of(result, train, "roll_rad")).max() < 5e-4
    assert np.abs(error_of(result, train, "pitch_rad")).max() < 1e-3


def test_cross_level_and_twist_are_those_of_the_track(train: Simulation, result: BaselineResult) -> None:
    geometry = result.geometry.assign(cross_level_mm_sd=1.0, twist_mm_sd=1.0)
    errors = geometry_errors(geometry, result.trajectory, train.truth, train.truth_geometry)
    assert errors["cross_level_mm"].abs().max() < 1.0
    assert errors["twist_mm"].abs().max() < 0.5


def test_without_the_wheel_a_curve_looks_like_tilt(train: Simulation, error_of: ErrorOf) -> None:
    as_it_comes = vqf_offline.run(train.recording, compensated=False)
    assert np.abs(error_of(as_it_comes, train, "roll_rad")).max() > 0.05


def test_gyro_bias_is_found_with_and_without_a_standstill(train: Simulation, error_of: ErrorOf) -> None:
    biased = train.recording.imu.assign(wx_radps=lambda table: table["wx_radps"] + 2e-3)
    recording = replace(train.recording, imu=biased)
    for remove in (True, False):
        found = vqf_offline.run(recording, remove_static_bias=remove)
        assert np.abs(error_of(found, train, "roll_rad")).max() < 2e-3


def test_says_nothing_of_what_it_does_not_know(result: BaselineResult) -> None:
    assert result.trajectory[["yaw_rad", "east_m", "roll_rad_sd"]].isna().all(axis=None)


def test_refuses_what_makes_no_filter(train: Simulation) -> None:
    with pytest.raises(BadInputError, match="tau_acc_s is 0"):
        vqf_offline.run(train.recording, tau_acc_s=0.0)
    with pytest.raises(BadInputError, match="no tachometer"):
        vqf_offline.run(replace(train.recording, tach=None))
