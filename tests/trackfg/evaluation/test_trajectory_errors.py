"""Errors of a trajectory: in the units of their names, at the truth's instants, per kilometre."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines.result import filled
from trackfg.evaluation.trajectory_errors import distance_errors, from_the_true_start, trajectory_errors
from trackfg.results.columns import TRAJECTORY_COLUMNS


@pytest.fixture
def truth() -> pd.DataFrame:
    """20 m/s for 200 s."""
    t = np.arange(0.0, 200.0, 0.05)
    return pd.DataFrame({"t_s": t, "chainage_m": 500.0 + 20.0 * t, "speed_mps": 20.0, "roll_rad": 0.01 * np.sin(t)})


def said(truth: pd.DataFrame, **known: np.ndarray | float) -> pd.DataFrame:
    t = np.arange(-1.0, 210.0, 0.1)
    columns = {name: np.interp(t, truth["t_s"], truth[name]) for name in truth if name != "t_s"}
    columns["chainage_m"] = 500.0 + 20.0 * t
    return filled(
        TRAJECTORY_COLUMNS, {"t_s": t, **columns, **{k: np.broadcast_to(v, t.shape) for k, v in known.items()}}
    )


def test_errors_are_in_the_units_of_their_names(truth: pd.DataFrame) -> None:
    estimate = said(truth, speed_mps=21.0, roll_rad_sd=0.002)
    errors = trajectory_errors(estimate, truth)
    assert errors["t_s"].between(0.0, truth["t_s"].iloc[-1]).all()
    np.testing.assert_allclose(errors["speed_kmh"], 3.6)
    np.testing.assert_allclose(errors["roll_mrad"], 0.0, atol=1e-3)  # between the truth's instants it is interpolated
    np.testing.assert_allclose(errors["roll_mrad_sd"], 2.0)
    np.testing.assert_allclose(errors["along_track_m"], 0.0, atol=1e-9)
    assert errors["along_track_m_sd"].isna().all()
    assert "pitch_mrad" not in errors  # the truth has none


def test_what_only_counts_starts_at_the_true_place(truth: pd.DataFrame) -> None:
    estimate = said(truth)
    estimate["chainage_m"] -= 300.0
    shifted = from_the_true_start(estimate.iloc[10:], truth)
    np.testing.assert_allclose(trajectory_errors(shifted, truth)["along_track_m"], 0.0, atol=1e-9)


def test_the_distance_of_each_kilometre(truth: pd.DataFrame) -> None:
    estimate = said(truth)
    estimate["chainage_m"] *= 1.002
    errors = distance_errors(estimate, truth)
    assert len(errors) == 3  # 3999 m
    np.testing.assert_allclose(errors["distance_percent"], 0.2)
    np.testing.assert_allclose(errors["speed_mps"], 20.0)


def test_kilometres_on_which_it_turned_back_do_not_count(truth: pd.DataFrame) -> None:
    there_and_back = truth.assign(chainage_m=2250.0 - 20.0 * np.abs(truth["t_s"] - 100.0))
    estimate = said(truth)
    estimate["chainage_m"] = 2250.0 - 20.0 * np.abs(estimate["t_s"] - 100.0)
    errors = distance_errors(estimate, there_and_back)
    np.testing.assert_allclose(errors["distance_percent"], 0.0, atol=1e-6)
    assert len(errors) == 3  # the turn is at 2 km, where one of them ends
    turning = there_and_back.assign(chainage_m=2250.0 - 20.0 * np.abs(truth["t_s"] - 80.0))
    assert len(distance_errors(estimate, turning)) == 2
