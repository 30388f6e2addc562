"""Rows after a hole show whether the IMU's clock was set over it, and a rest shows nothing."""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd
import pytest

from trackfg.checks.clock_change import offset_before, was_set
from trackfg.datasets.scenarios import Simulation

WHEN_S = 150.0


@pytest.fixture(scope="module")
def tables(simulated: Callable[..., Simulation]) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The IMU before and after, and the tach."""
    recording = simulated("mainline", seed=3, duration_s=300.0).recording
    early = recording.imu["t_s"] <= WHEN_S
    return recording.imu[early], recording.imu[~early], recording.tables["tach"]


@pytest.mark.parametrize("by_s", [0.6, 1.0, 5.0, 20.0])
def test_a_set_clock_is_distinguished_from_a_gap(by_s: float, tables: tuple[pd.DataFrame, ...]) -> None:
    earlier, later, tach = tables
    offset = offset_before(earlier, tach)
    assert offset is not None
    assert was_set(later.assign(t_s=later["t_s"] + by_s), tach, offset, by_s)
    assert not was_set(later[later["t_s"] > WHEN_S + by_s], tach, offset, by_s)


def test_too_few_rows_show_nothing(tables: tuple[pd.DataFrame, ...]) -> None:
    earlier, later, tach = tables
    assert offset_before(earlier[:1], tach) is None
    assert offset_before(earlier, tach[:1]) is None
    offset = offset_before(earlier, tach)
    assert offset is not None
    soon = later[later["t_s"] < WHEN_S + 10.0]
    assert not was_set(soon.assign(t_s=soon["t_s"] + 5.0), tach, offset, 5.0)
    assert not was_set(soon[:1], tach, offset, 5.0)


def test_a_rest_shows_nothing(tables: tuple[pd.DataFrame, ...]) -> None:
    earlier, later, tach = tables
    offset = offset_before(earlier, tach)
    assert offset is not None
    at_rest = later.assign(t_s=later["t_s"] + 5.0, fx_mps2=0.0)
    assert not was_set(at_rest, tach.assign(distance_m=0.0), offset, 5.0)
