"""Stamps of a stream's fixes that are rounded."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.results.events import DOUBT
from trackfg.streaming.doubts.fix_delay_test import FixDelayTest

SD_M, SPEED_MPS = 0.2, 20.0


def put_in_pieces(step_s: float) -> FixDelayTest:
    """A place every 400 m, passed at one speed, with stamps rounded up to the step."""
    test, t = FixDelayTest(), np.arange(0.0, 400.0, 0.5)
    rows = pd.DataFrame({"t_s": t, "speed_mps": SPEED_MPS, "chainage_m_sd": SD_M})
    passed = 20.0 * np.arange(1.0, 20.0) + np.random.default_rng(1).uniform(0.0, 1.0, 19)
    stamps = np.ceil(passed / step_s) * step_s if step_s else passed
    fixes = pd.DataFrame({"t_s": stamps, "chainage_m": SPEED_MPS * passed, "chainage_sd_m": SD_M})
    for first in range(0, len(t), 20):
        test.put(rows[first : first + 20], fixes)
    return test


def innovations(level: float) -> np.ndarray:
    """Fixes that are predicted to 0.3 m, and err by so many of their sigmas."""
    draws = np.random.default_rng(2).standard_normal((2, 19))
    error = level * SD_M * draws[0] + 0.3 * draws[1]
    return np.column_stack([error, np.full(19, SD_M), np.full(19, 0.3**2)])


def test_stamps_in_whole_seconds_are_a_doubt_where_fixes_scatter() -> None:
    (event,) = put_in_pieces(1.0).events(innovations(20.0), 400.0)
    assert (event.kind, event.t_s) == (DOUBT, 400.0)
    assert event.detail.startswith("chainage: fixes are stamped to 1 s, and scatter more than declared: multiply")
    factor = float(event.detail.partition("sigmas by ")[2].partition(",")[0])
    assert factor == pytest.approx(SPEED_MPS / np.sqrt(6.0) / SD_M, rel=0.02)


@pytest.mark.parametrize(("step_s", "level"), [(1.0, 1.0), (0.0, 20.0)])
def test_stamps_as_they_were_and_fixes_that_are_where_they_say_are_none(step_s: float, level: float) -> None:
    assert put_in_pieces(step_s).events(innovations(level), 400.0) == ()


def test_without_fixes_nothing_is_late() -> None:
    assert FixDelayTest().events(np.zeros((0, 3)), 0.0) == ()
