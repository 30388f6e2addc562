"""A run followed on a reference, section by section."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.mapping.recognition.recognition import recognise
from trackfg.mapping.recognition.tracker import PlaceTracker, TrackedPlace, reference_of


def followed(run: pd.DataFrame, reference: pd.DataFrame, begins: range, rate_sd: float = 1e-3) -> list[TrackedPlace]:
    follower, profile = PlaceTracker(rate_sd), reference_of(reference)
    found = [follower.take(run, begin, profile) for begin in begins]
    return [at for at in found if at is not None]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_run_is_found_and_stays_found(line: Any, reference: pd.DataFrame, direction: int) -> None:
    run = line.run(0.0, 1500.0, place=lambda x: x + 2345.0, seed=7)
    places = followed(run, reference, range(0, 1500, 100)[::direction])
    assert [at.run_m for at in places] == [50.0 + 100.0 * k for k in range(15)][::direction]
    sure = [at.probability > 0.99 for at in places]
    assert any(sure[:6])
    assert all(sure[sure.index(True) :])
    for at, certain in zip(places, sure, strict=True):
        assert not certain or abs(at.reference_m - at.run_m - 2345.0) < 5.0


def test_it_says_what_the_recognition_of_the_run_so_far_says(line: Any, reference: pd.DataFrame) -> None:
    run = line.run(0.0, 1000.0, place=lambda x: x + 2345.0, seed=7)
    last = followed(run, reference, range(0, 1000, 100))[-1]
    whole = recognise(run, reference, place_sd_m=None, rate_sd=1e-3, direction=1).sections.iloc[-1]
    assert last.reference_m == pytest.approx(whole["reference_m"], abs=2.0)
    assert last.probability == pytest.approx(whole["probability_so_far"], abs=0.01)


def test_another_line_is_not_found(draw_line: Callable[..., Any], reference: pd.DataFrame) -> None:
    for seed in (2, 3, 4):
        run = draw_line(4000.0, seed=seed).run(0.0, 2000.0, seed=7)
        assert all(at.probability < 0.9 for at in followed(run, reference, range(0, 2000, 100)))


def test_what_was_seen_before_is_no_further_evidence(line: Any, reference: pd.DataFrame) -> None:
    run = line.run(0.0, 300.0, place=lambda x: x + 2345.0, seed=7)
    follower, profile = PlaceTracker(1e-3), reference_of(reference)
    for begin in (0, 100, 200):
        assert follower.take(run, begin, profile) is not None
    before = follower.state
    for begin in (200, 100, 0):
        assert follower.take(run, begin, profile) is None
    assert follower.state is before
    assert np.isfinite(follower.least).all()
