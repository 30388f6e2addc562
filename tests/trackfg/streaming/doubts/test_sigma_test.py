"""Differences of filtered and smoothed rows over the sigmas that they should have."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.events import DOUBT
from trackfg.streaming.doubts.sigma_test import SigmaTest, fix_doubts

FILTERED_SD, SMOOTHED_SD = 0.5, 0.3
"""Their difference has the sigma 0.4."""


def rows(t: np.ndarray, sd: float, **columns: np.ndarray) -> pd.DataFrame:
    table = pd.DataFrame(sd, index=range(len(t)), columns=list(TRAJECTORY_COLUMNS))
    values = [name for name in TRAJECTORY_COLUMNS if not name.endswith("_sd")]
    return table.assign(**dict.fromkeys(values, 0.0)).assign(t_s=t, **columns)


def put(test: SigmaTest, filtered: pd.DataFrame, smoothed: pd.DataFrame) -> None:
    for row in filtered.to_numpy():
        test.expect(row)
    test.put(smoothed)


def put_through(difference_sd: float, *, lasting: int = 1, yaw: float = 0.0) -> SigmaTest:
    """Put rows of 400 s in pieces of 10 s, the smoothed ones later, as a stream does."""
    test, t = SigmaTest(), np.arange(400.0)
    draws = np.random.default_rng(1).standard_normal(400 // lasting)
    off = difference_sd * np.repeat(draws, lasting)
    turned = np.full(400, np.pi - 1e-3)
    filtered = rows(t, FILTERED_SD, chainage_m=10.0 * t + off, yaw_rad=-turned if yaw else turned)
    smoothed = rows(t, SMOOTHED_SD, chainage_m=10.0 * t, yaw_rad=turned)
    for first in range(0, 400, 10):
        put(test, filtered[first : first + 10], smoothed[max(first - 20, 0) : max(first - 10, 0)])
    test.put(smoothed[370:])
    return test


def test_right_sigmas_are_not_doubted() -> None:
    assert put_through(0.4).events(400.0, positions=True) == ()


def test_every_row_is_held_against_its_own_once() -> None:
    test = put_through(0.4)
    assert test.sums[:, 0].tolist() == [400.0] * 8
    draws = np.random.default_rng(1).standard_normal(400)
    assert test.sums[0, 1] == pytest.approx(np.sum(draws**2))
    assert test.sums[0, 2] == pytest.approx(np.sum(draws[1:] * draws[:-1]))
    assert len(test.waiting) == 0


def test_sigmas_three_times_too_small() -> None:
    (event,) = put_through(1.2).events(400.0, positions=True)
    assert (event.kind, event.t_s) == (DOUBT, 400.0)
    assert event.detail.startswith("chainage: smoothed and filtered estimates differ by 2.7")
    assert put_through(1.2).doubts("chainage_m")
    assert not put_through(1.2).doubts("speed_mps")


@pytest.mark.parametrize(
    ("column", "positions", "names"),
    [
        ("speed_mps", False, "speed, chainage: "),
        ("speed_mps", True, "speed: "),
        ("east_m", True, "position, chainage: "),
        ("east_m", False, "position: "),
    ],
)
def test_a_chainage_is_doubted_with_what_it_follows(column: str, positions: bool, names: str) -> None:
    test, t = SigmaTest(), np.arange(400.0)
    off = 1.2 * np.random.default_rng(1).standard_normal(400)
    put(test, rows(t, FILTERED_SD, **{column: off}), rows(t, SMOOTHED_SD))
    (event,) = test.events(400.0, positions=positions)
    assert event.detail.startswith(names)


def test_few_differences_that_last_may_be_chance() -> None:
    """Four errors of 100 s each, of 1.6 sigmas: as many independent ones would be far off."""
    assert put_through(0.8, lasting=100).events(400.0, positions=True) == ()
    assert len(put_through(0.8).events(400.0, positions=True)) == 1


def test_rows_of_a_lost_window_are_not_held_against_the_next_one() -> None:
    """From 100 s on the frame is another one; filtered rows up to 110 s are of the old one still."""
    test, t = SigmaTest(), np.arange(200.0)
    test.lost = 100.0, 110.0
    east, away = 0.4 * np.random.default_rng(1).standard_normal(200), 50.0 * (t > 100.0)
    filtered = rows(t, FILTERED_SD, east_m=east + np.where(t < 110.0, 0.0, away))
    put(test, filtered, rows(t, SMOOTHED_SD, east_m=away))
    assert test.events(200.0, positions=True) == ()


def test_directions_on_both_sides_of_the_cut_are_near() -> None:
    assert put_through(0.4, yaw=1.0).events(400.0, positions=True) == ()


@pytest.mark.parametrize("offset_s", [0.0, 0.05])
def test_what_is_rough_between_rows_is_no_doubt(offset_s: float) -> None:
    """At speed a sensor on an axle box pitches from row to row: filtered rows in between say nothing of its sigmas."""
    draws = np.random.default_rng(2)
    fine, test = np.arange(0.0, 400.0, 0.05), SigmaTest()
    pitch = 20.0 * draws.standard_normal(len(fine))
    at = np.arange(100, len(fine) - 2, 20) + round(offset_s / 0.05)
    off = 0.4 * draws.standard_normal(len(at))
    filtered = rows(fine[at], FILTERED_SD, pitch_rad=np.radians(pitch[at]) + off)
    put(test, filtered, rows(fine[::2], SMOOTHED_SD, pitch_rad=np.radians(pitch[::2])))
    assert test.events(400.0, positions=True) == ()
    assert test.sums[6, 1] / test.sums[6, 0] == pytest.approx(1.0, rel=0.15)


def test_fixes_further_off_than_predicted_are_a_doubt() -> None:
    (event,) = fix_doubts(3, 0.9**2 + 1.3**2 + 4.6**2, 600.0)
    assert (event.kind, event.t_s) == (DOUBT, 600.0)
    assert event.detail.startswith("chainage, speed: fixes are 2.8 times as far")


@pytest.mark.parametrize(("number", "square"), [(0, 0.0), (1, 2.5**2), (30, 30.0), (2, 2.0**2 + 2.5**2)])
def test_fixes_as_far_off_as_chance_allows_are_none(number: int, square: float) -> None:
    assert fix_doubts(number, square, 600.0) == ()
