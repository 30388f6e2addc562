"""Passes: where a run changes direction, and what rests and single keyframes belong to."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from trackfg.numerics.chainage.passes import Pass, passes


@pytest.mark.parametrize(
    ("distance", "expected"),
    [
        pytest.param([0.0, 5.0, 12.0, 20.0], [Pass(0, 3, 1)], id="forwards"),
        pytest.param([0.0, -5.0, -12.0], [Pass(0, 2, -1)], id="backwards"),
        pytest.param(
            [0.0, 10.0, 20.0, 12.0, 3.0, 9.0], [Pass(0, 2, 1), Pass(2, 4, -1), Pass(4, 5, 1)], id="to and fro"
        ),
        pytest.param([0.0, 0.0, 0.0, 10.0, 20.0], [Pass(0, 4, 1)], id="a rest first belongs to what follows"),
        pytest.param([0.0, 10.0, 10.0, 10.0, 0.0], [Pass(0, 3, 1), Pass(3, 4, -1)], id="a rest belongs to what was"),
        pytest.param([0.0, 10.0, 10.0, 20.0, 20.0], [Pass(0, 4, 1)], id="a rest within a pass divides nothing"),
        pytest.param([0.0, 10.0, 9.96, 10.01, 20.0], [Pass(0, 4, 1)], id="noise at rest is no change of direction"),
        pytest.param([0.0, 0.01, 0.02], [], id="at rest all the time"),
        pytest.param([3.0], [], id="one keyframe"),
        pytest.param([], [], id="none"),
    ],
)
def test_passes(distance: list[float], expected: list[Pass]) -> None:
    assert passes(np.array(distance)) == expected


def test_passes_follow_one_upon_another() -> None:
    """Every keyframe is in a pass, and a pass ends where the next begins."""
    distance = np.cumsum(np.random.default_rng(0).normal(0.0, 1.0, 200))
    found = passes(distance)
    assert found[0].first == 0
    assert found[-1].last == 199
    assert all(one.last == other.first and one.sense == -other.sense for one, other in pairwise(found))
    for one in found:
        steps = one.sense * np.diff(distance[one.first : one.last + 1])
        assert steps.min() > -0.05


def test_rows_of_a_pass_include_both_its_keyframes() -> None:
    keyframes = np.array([0.0, 1.0, 2.0, 4.0])
    t = np.arange(0.0, 4.01, 0.25)
    rows = Pass(1, 2, 1).rows(keyframes, t)
    np.testing.assert_array_equal(t[rows], [1.0, 1.25, 1.5, 1.75, 2.0])
    assert t[Pass(2, 3, -1).rows(keyframes, t)][0] == 2.0
