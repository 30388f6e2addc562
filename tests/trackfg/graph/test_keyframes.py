"""Placement of keyframes: properties over made-up speeds, rests and required times."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.config import KeyframeConfig
from trackfg.graph.keyframes import place_keyframes
from trackfg.numerics.spans import nearest, within

DT = 0.01
CONFIG = KeyframeConfig(interval_s=0.5, distance_m=10.0, interval_at_rest_s=5.0)


@st.composite
def runs(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Edges, speed with its times, rests, required times (some outside the run)."""
    n = draw(st.integers(60, 6000))
    edges = draw(st.floats(-50.0, 50.0)) + DT * np.arange(n + 1)
    t = np.linspace(edges[0], edges[-1], max(2, n // 10))
    knots = draw(st.lists(st.floats(-60.0, 60.0), min_size=2, max_size=6))
    speed = np.interp(t, np.linspace(edges[0], edges[-1], len(knots)), knots)
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=6, unique=True)))
    rests = edges[np.array(cuts[: len(cuts) // 2 * 2], dtype=int)].reshape(-1, 2)
    required = draw(st.lists(st.floats(edges[0] - 1.0, edges[-1] + 1.0), max_size=20))
    return edges, t, speed, rests, np.array(required)


@settings(deadline=None, max_examples=200)
@given(runs())
def test_placement_keeps_its_promises(run: tuple[np.ndarray, ...]) -> None:
    edges, t, speed, rests, required = run
    keyframes = place_keyframes(edges, t, speed, rests, required, CONFIG)
    assert keyframes[0] == 0
    assert keyframes[-1] == len(edges) - 1
    assert (np.diff(keyframes) > 0).all()
    at = edges[keyframes]
    asked = np.concatenate([required, rests.ravel()])
    for time in asked[(asked >= edges[0]) & (asked <= edges[-1])]:
        assert np.abs(at - time).min() <= 0.5 * DT + 1e-9
    # No interval is longer than the one asked for, save that one next to a required keyframe may take
    # up what a dropped one leaves.
    limit = np.where(within(0.5 * (at[1:] + at[:-1]), rests), CONFIG.interval_at_rest_s, CONFIG.interval_s)
    assert (np.diff(at) <= 1.7 * limit + 0.2).all()


@settings(deadline=None, max_examples=100)
@given(runs())
def test_keyframes_are_not_crowded(run: tuple[np.ndarray, ...]) -> None:
    """Apart from the required ones, no two are nearer than about a third of the regular spacing."""
    edges, t, speed, rests, _ = run
    at = edges[place_keyframes(edges, t, speed, rests, np.zeros(0), CONFIG)]
    rate = max(1.0 / CONFIG.interval_s, np.abs(speed).max() / CONFIG.distance_m)
    fixed = np.concatenate([rests.ravel(), edges[[0, -1]]])
    required = np.abs(at[:, None] - fixed).min(axis=1) < DT
    both = required[1:] & required[:-1]
    assert (np.diff(at)[~both] >= 0.35 / rate - 2 * DT).all()


def test_time_and_distance_whichever_comes_first() -> None:
    edges = DT * np.arange(20001)
    t = edges[::10]
    none = np.zeros((0, 2))
    for speed, spacing in ((0.0, 0.5), (10.0, 0.5), (20.0, 0.5), (40.0, 0.25), (-40.0, 0.25)):
        at = edges[place_keyframes(edges, t, np.full(t.size, speed), none, np.zeros(0), CONFIG)]
        np.testing.assert_allclose(np.diff(at)[1:-1], spacing, atol=DT + 1e-9)


def test_rests_are_sparse_and_have_keyframes_at_both_ends() -> None:
    edges = DT * np.arange(10001)
    t = edges[::10]
    rests = np.array([[20.0, 70.0]])
    at = edges[place_keyframes(edges, t, np.full(t.size, 10.0), rests, np.zeros(0), CONFIG)]
    inside = at[(at >= 20.0 - 1e-9) & (at <= 70.0 + 1e-9)]
    assert inside[0] == 20.0
    assert inside[-1] == 70.0
    assert 9 <= len(inside) <= 12


def test_a_run_of_one_interval() -> None:
    edges = np.array([0.0, 0.3])
    keyframes = place_keyframes(edges, edges, np.zeros(2), np.zeros((0, 2)), np.zeros(0), CONFIG)
    assert keyframes.tolist() == [0, 1]


@given(
    st.lists(st.floats(0.0, 100.0), min_size=2, max_size=30, unique=True),
    st.lists(st.floats(-10.0, 110.0), max_size=20),
)
def test_nearest_is_the_nearest(grid_values: list[float], times: list[float]) -> None:
    grid, at = np.sort(np.array(grid_values)), np.array(times)
    found = nearest(grid, at)
    for time, index in zip(at, found, strict=True):
        assert np.abs(grid[index] - time) == np.abs(grid - time).min()


def test_within_includes_both_ends() -> None:
    spans = np.array([[1.0, 2.0], [4.0, 5.0]])
    t = np.array([0.9, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 5.1])
    assert within(t, spans).tolist() == [False, True, True, True, False, True, True, False]
    assert not within(t, np.zeros((0, 2))).any()
