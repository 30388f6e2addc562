"""Slips against true slips: what matches what, and what is counted as found, missed and false."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.evaluation.slip_scores import score_slips, together
from trackfg.results.columns import EVENT_COLUMNS

TRUTH = pd.DataFrame({"t_s": np.arange(0.0, 1000.5, 0.5)})


def true(*rows: tuple[float, float, float, float]) -> pd.DataFrame:
    """Start, end, distance error, peak creep."""
    table = pd.DataFrame(rows, columns=["start_s", "end_s", "distance_error_m", "peak_creep"])
    return table.assign(kind=np.where(table["peak_creep"] > 0, "slip", "slide"))


def reported(*rows: tuple[str, float, float, float, float]) -> pd.DataFrame:
    """Kind, start, end, distance removed and its sigma, among other events."""
    table = pd.DataFrame(rows, columns=["kind", "start_s", "end_s", "distance_removed_m", "distance_removed_m_sd"])
    rest = pd.DataFrame({"kind": ["standstill"], "start_s": [0.0], "end_s": [1000.0]})
    return pd.concat([rest, table]).reindex(columns=list(EVENT_COLUMNS))


def test_a_slip_is_found_where_an_event_of_its_kind_shares_half_of_the_shorter() -> None:
    slips = true((10.0, 14.0, 2.0, 0.1), (30.0, 34.0, -2.0, -0.1), (50.0, 54.0, 2.0, 0.1), (70.0, 80.0, 5.0, 0.1))
    events = reported(
        ("slip", 11.0, 15.0, 2.2, 0.1),
        ("slip", 30.0, 34.0, 2.0, 0.1),  # the wrong way
        ("slip", 53.0, 57.0, 2.0, 0.1),  # shares a quarter
        ("slip", 76.0, 78.0, 1.0, 0.1),  # lies within
    )
    score = score_slips(events, slips, TRUTH)
    assert score.found["start_s"].tolist() == [10.0, 70.0]
    assert score.found["start_error_s"].tolist() == [1.0, 6.0]
    assert score.found["end_error_s"].tolist() == [1.0, -2.0]
    assert score.missed["start_s"].tolist() == [30.0, 50.0]
    assert score.false["start_s"].tolist() == [30.0, 53.0]
    assert (score.recall, score.precision, score.events) == (0.5, 0.5, 4)


def test_small_and_short_slips_need_not_be_found_but_may_be() -> None:
    slips = true((10.0, 14.0, 2.0, 0.029), (30.0, 30.9, 2.0, 0.5), (50.0, 51.0, 0.5, 0.03), (999.5, 1003.0, 9.0, 0.5))
    events = reported(("slip", 10.0, 14.0, 2.0, 0.1), ("slip", 30.0, 31.0, 2.0, 0.1))
    score = score_slips(events, slips, TRUTH)
    assert score.missed["start_s"].tolist() == [50.0]  # the last one has half a second until the end of the truth
    assert (len(score.found), score.precision) == (0, 1.0)


def test_pieces_and_joined_slips_are_compared_as_groups() -> None:
    slips = true((10.0, 20.0, 4.0, 0.1), (40.0, 45.0, 1.0, 0.1), (46.0, 50.0, 2.0, 0.1))
    events = reported(("slip", 10.0, 13.0, 1.0, 0.3), ("slip", 15.0, 20.5, 2.5, 0.4), ("slip", 40.0, 51.0, 3.5, 0.2))
    score = score_slips(events, slips, TRUTH)
    assert len(score.found) == 3
    assert score.found["end_error_s"].tolist() == [0.5, 6.0, 1.0]
    assert score.distances["true_m"].tolist() == [4.0, 3.0]
    assert score.distances["removed_m"].tolist() == [3.5, 3.5]
    assert score.distances["removed_m_sd"].tolist() == pytest.approx([0.5, 0.2])


def test_nothing_to_find_and_nothing_found() -> None:
    score = score_slips(reported(), true(), TRUTH)
    assert (len(score.found), len(score.missed), len(score.false), len(score.distances)) == (0, 0, 0, 0)
    assert np.isnan(score.recall)
    assert np.isnan(score.precision)


def test_runs_together_weigh_every_slip_alike() -> None:
    slips = true((10.0, 14.0, 2.0, 0.1), (30.0, 34.0, 2.0, 0.1))
    one = score_slips(reported(("slip", 10.0, 14.0, 2.0, 0.1)), slips, TRUTH)
    other = score_slips(reported(("slip", 10.0, 14.0, 2.0, 0.1), ("slide", 500.0, 501.0, -1.0, 0.1)), slips[:1], TRUTH)
    both = together([one, other])
    assert (both.recall, both.precision) == pytest.approx((2 / 3, 2 / 3))
    assert len(both.distances) == 2
