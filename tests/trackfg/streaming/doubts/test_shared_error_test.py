"""Positions that scatter by less than declared may share the rest, which no sigma of a stream holds."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.events import DOUBT
from trackfg.streaming.doubts.shared_error_test import SharedErrorTest
from trackfg.streaming.window.records.gnss_record import GnssRecord

DECLARED_M, SD_M = 2.0, 0.2
"""Sigmas of positions, and of what they place."""


def record(scatter: float) -> GnssRecord:
    """Positions once a second whose residuals scatter by that much of the declared sigma."""
    residual, ones = scatter * np.random.default_rng(0).standard_normal((300, 3)), np.ones((300, 3))
    t = np.arange(300) * 1.0
    return GnssRecord(t, residual, 1e-3 * ones, DECLARED_M * ones, ones, given=ones, level=ones)


def put_in_pieces(outage_sd_m: float = SD_M) -> SharedErrorTest:
    """Rows of 300 s in pieces of 10 s, without positions in the last hundred, where what they place is less known."""
    test, t = SharedErrorTest(), np.arange(300.0)
    rows = pd.DataFrame(SD_M, index=range(300), columns=list(TRAJECTORY_COLUMNS)).assign(t_s=t)
    rows.loc[200:, ["east_m_sd", "chainage_m_sd"]] = outage_sd_m
    gnss = pd.DataFrame({"t_s": t[:200]})
    for first in range(0, 300, 10):
        piece = rows[first : first + 10]
        near = gnss[(gnss["t_s"] > first - 1.0) & (gnss["t_s"] <= first + 9.0)]
        test.put(piece, near)
    return test


@pytest.mark.parametrize(("has_fixes", "quantities"), [(False, ["position", "chainage"]), (True, ["position"])])
def test_what_positions_may_share_is_a_doubt_of_what_they_place(*, has_fixes: bool, quantities: list[str]) -> None:
    events = put_in_pieces().events(record(0.6), 300.0, has_fixes=has_fixes)
    assert [event.detail.partition(":")[0] for event in events] == quantities
    assert all((event.kind, event.t_s) == (DOUBT, 300.0) for event in events)
    factor = np.hypot(1.0, DECLARED_M * np.sqrt(1.0 - 0.6**2) / SD_M)
    assert float(events[0].detail.partition("sigmas by ")[2].partition(",")[0]) == pytest.approx(factor, rel=0.1)


def test_an_outage_does_not_hide_it() -> None:
    assert put_in_pieces(outage_sd_m=50.0).events(record(0.6), 300.0, has_fixes=False)


def test_positions_that_scatter_as_declared_are_not_doubted() -> None:
    assert put_in_pieces().events(record(1.0), 300.0, has_fixes=False) == ()
    assert put_in_pieces().events(GnssRecord(), 300.0, has_fixes=False) == ()
    assert SharedErrorTest().events(record(0.6), 0.0, has_fixes=False) == ()
