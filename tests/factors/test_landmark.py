"""A known line and balises, by cases worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.landmark import OnLine, across_line, along_line, balise_passage
from trackfg.factors.states import SHARED, Nav, Odo, States

FACING_NORTH = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Forward is north, left is west."""
LEVER_ARM = np.array([3.0, 0.5, 1.0])
"""Of the IMU: 3 m ahead of the reference point, 0.5 m to its left."""


def states(*reference_m: tuple[float, float]) -> States:
    """Return keyframes whose vehicle reference points are at these places, east and north."""
    n = len(reference_m)
    place = np.column_stack([np.array(reference_m), np.full(n, 7.0)])
    nav = Nav(np.tile(FACING_NORTH, (n, 1, 1)), place + FACING_NORTH @ LEVER_ARM, np.zeros((n, 3)))
    return States(nav, np.zeros((n, 6)), Odo(np.zeros((n, 4))), *(np.zeros((1, kind.dim)) for kind in SHARED))


def northwards(index: list[int], east_m: float) -> OnLine:
    """Return feet at north 100 m on a line that goes north: its left is west."""
    m = len(index)
    return OnLine(np.array(index), np.tile([east_m, 100.0], (m, 1)), np.tile([-1.0, 0.0], (m, 1)))


def test_it_is_positive_to_the_left_of_the_line() -> None:
    family = across_line(northwards([0], 50.0), LEVER_ARM, np.ones((1, 1)), None)
    np.testing.assert_allclose(family.residual(states((48.0, 100.0))), [[2.0]])
    np.testing.assert_allclose(family.residual(states((50.5, 123.0))), [[-0.5]])  # along the line counts nothing


def test_a_constant_error_of_the_line_is_counted_once() -> None:
    """Of 2 m, the part that stays, 0.75, is expected at the next place; 0.5 m are new there."""
    first, second = northwards([0], 50.0), northwards([1], 50.0)
    family = along_line(first, second, np.array([0.75]), LEVER_ARM, np.ones((1, 1)), None)
    np.testing.assert_allclose(family.residual(states((48.0, 100.0), (48.5, 120.0))), [[0.0]], atol=1e-12)
    np.testing.assert_allclose(family.residual(states((48.0, 100.0), (48.0, 120.0))), [[0.5]])


def test_a_balise_is_where_the_vehicle_is_when_it_reads_it() -> None:
    """Read half a metre behind the keyframes at 10 m and at 30 m, of balises at 10 m and at 31 m."""
    standing = states((0.0, 0.0), (0.0, 0.0))
    odo = Odo.of(np.array([10.0, 30.0]), np.ones(2), np.zeros(2), np.zeros(2))
    at = replace(standing, odo=odo, sensor=np.array([[0.0, 0.0], [10.0, 31.0]]))
    family = balise_passage(np.arange(2), np.full(2, 0.5), np.arange(2), 1, np.ones((2, 1)), None)
    np.testing.assert_allclose(family.residual(at)[:, 0], [0.5, -0.5])
