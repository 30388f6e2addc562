"""A tach that contradicts all other sensors of a stream."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.results.events import DOUBT
from trackfg.smoothing.smoother import SmoothedStates
from trackfg.streaming.doubts.tach_test import TachTest
from trackfg.streaming.window.window import Window


@pytest.fixture
def window(smoothed: Callable[..., SmoothedStates]) -> Window:
    """A window as long as its run."""
    run = smoothed("mainline-gnss", seed=0, duration_s=150.0)
    problem = run.problem
    return Window(problem.t, run.solution.states, tuple(problem.measured), problem.response, tuple(problem.families))


def counting(window: Window, factor: float) -> Window:
    """The window of a tach that counts that many times as much."""
    odo = replace(window.states.odo, array=window.states.odo.array * [1.0, 1.0, factor, 1.0])
    return replace(window, states=replace(window.states, odo=odo))


def put(window: Window) -> TachTest:
    test = TachTest()
    test.put(window)
    test.put(window)
    return test


def test_each_distance_counts_once_and_a_sound_tach_is_not_doubted(window: Window) -> None:
    test = put(window)
    assert 50 < len(test.weightless) < len(window)
    assert np.nanmedian(test.moved) == pytest.approx(1.0, abs=0.02)
    assert test.events(150.0, placed=False) == ()
    assert TachTest().events(0.0, placed=False) == ()


def test_a_tach_of_the_other_sense_leaves_no_direction_of_travel(window: Window) -> None:
    """Positions do not show which end of the vehicle is ahead."""
    (event,) = put(counting(window, -1.0)).events(150.0, placed=True)
    assert (event.kind, event.t_s) == (DOUBT, 150.0)
    assert event.detail.startswith("chainage, speed, roll, pitch, yaw, cross_level, twist, ")
    assert "the vehicle moves -0.99" in event.detail
    assert "do not trust it, or check unit, sign and clock of [tach]" in event.detail


@pytest.mark.parametrize("placed", [False, True])
def test_a_tach_in_another_unit_is_a_doubt_where_nothing_else_places_the_vehicle(
    window: Window, *, placed: bool
) -> None:
    events = put(counting(window, 3.6)).events(150.0, placed=placed)
    assert [event.detail.partition(":")[0] for event in events] == ([] if placed else ["chainage, speed"])
