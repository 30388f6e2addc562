"""A run on a grid along its way: heading, roll and speed as the vehicle passes, for what is judged by curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.factors.motion import mount_matrix
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.smoothing.reassessment import SolvedRun

STEP_M = 10.0
"""Step along the way, m: short against any curve."""


@dataclass(frozen=True)
class Passage:
    """The vehicle passes every :data:`STEP_M` of its way with heading and roll, rad, the variance of roll and a speed,
    m/s, backwards negative. Each of shape (n,).
    """

    heading: Array
    roll: Array
    roll_variance: Array
    speed: Array


def passage(run: SolvedRun) -> Passage:
    """Return a solved run along its way, backwards and forwards alike."""
    states = run.solution.states
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(states.odo.distance)))])
    rpy = rpy_from_matrix(states.nav.R @ mount_matrix(states.mount)[0])
    variance = keyframe_variances(states, run.covariance, run.problem.run.lever_arm)[:, QUANTITIES.index("roll_rad")]
    speed = states.nav.own_velocity @ mount_matrix(states.mount)[0, :, 0]
    grid = np.arange(0.0, way[-1], STEP_M)
    return Passage(*(np.interp(grid, way, of) for of in (np.unwrap(rpy[:, 2]), rpy[:, 0], variance, speed)))


def chord_curvature(heading: Array, cells: int) -> Array:
    """Return the turn to the left per metre of way, 1/m, over so many cells to either side. (n,) to (n - 2 cells,)."""
    return np.asarray((heading[2 * cells :] - heading[: -2 * cells]) / (2 * cells * STEP_M))
