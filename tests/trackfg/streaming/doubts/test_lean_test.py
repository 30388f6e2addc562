"""A stream finds out a car body that is declared rigid by its lean in curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.results.events import DOUBT
from trackfg.smoothing.leaning_body import circle_sums, circles, pull
from trackfg.smoothing.passage import STEP_M
from trackfg.streaming.doubts.lean_test import LeanTest

from ..conftest import setting_off, streamed


def cells(share: float) -> np.ndarray:
    """Cells along 3 km with circles of R 500 to the left and to the right, from 25 down to 15 m/s."""
    s = np.arange(0.0, 3000.0, STEP_M)
    curvature = np.where((s > 300.0) & (s < 700.0), 1.0, np.where((s > 1500.0) & (s < 2200.0), -1.0, 0.0)) / 500.0
    speed = np.linspace(25.0, 15.0, len(s))
    roll = share * speed**2 * curvature / STANDARD_GRAVITY + 3e-4 * np.random.default_rng(0).standard_normal(len(s))
    return np.column_stack([np.cumsum(curvature) * STEP_M, roll, np.full(len(s), 1e-6), speed])


def put_through(table: np.ndarray, *ends: int) -> LeanTest:
    test, first = LeanTest(), 0
    for end in (*ends, len(table)):
        test.put(table[first:end])
        first = end
    return test


def test_a_body_that_leans_is_a_doubt_of_its_roll_and_geometry() -> None:
    (event,) = put_through(cells(0.3)).events(200.0)
    assert (event.kind, event.t_s) == (DOUBT, 200.0)
    assert event.detail.startswith(
        "roll, cross_level, twist, level, alignment, curvature: in curves the vehicle leans outwards by 3"
    )
    assert "rigid = false" in event.detail


def test_a_wheelset_is_not_doubted() -> None:
    assert put_through(cells(0.0)).events(200.0) == ()
    assert LeanTest().events(0.0) == ()


def test_pieces_of_any_size_make_the_sums_of_the_whole() -> None:
    table = cells(0.3)
    heading, roll, _, speed = table.T
    whole = circle_sums(pull(speed, heading), roll, circles(heading))
    assert whole[4] == 2.0
    for ends in ((), (0, 1, 2, 7), tuple(range(1, 300)), tuple(range(5, 300, 13)), (50, 180)):
        test = put_through(table, *ends)
        np.testing.assert_allclose(test.sums, whole, rtol=1e-9)
        assert len(test.cells) < 20


@pytest.mark.slow
@pytest.mark.parametrize(("name", "doubts"), [("spring-roll", 0), ("spring-roll-declared-rigid", 1)])
def test_a_stream_of_a_body_declared_rigid_is_not_to_be_trusted(name: str, doubts: int) -> None:
    plan = replace(setting_off("mainline"), effects=(effect(name, 0.2),))
    recording = simulate(plan, seed=0, duration_s=300.0).recording
    events = streamed(recording, lag_s=20.0, batch_s=5.0, config=SmoothConfig()).events
    said = {event.detail.partition(":")[0] for event in events if "leans outwards" in event.detail}
    assert len(said) == doubts
