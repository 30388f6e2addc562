"""No line climbs as steeply for half of a run as the one of a solution with a wrong mounting may.

A sensor stands as gravity shows. A mounting whose pitch is off by 30 deg, since shaking or crooked axes look like a
direction of travel, therefore makes a line of 30 deg, and no residual says so.
"""

from __future__ import annotations

import math

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.motion import mount_matrix
from trackfg.results.verdict import QUANTITIES, Doubt
from trackfg.smoothing.reassessment import SolvedRun

_STEEPEST = 0.138
"""Gradient of the steepest line on which wheels drive: Calcada de Sao Francisco, Lisbon, 180 m long (Guinness World
Records, "Steepest railway gradient (adhesion)"). Rack railways have up to 0.48."""

_SHOW_HEIGHTS = FactorType.GNSS_POSITION, FactorType.DELAYED_POSITION


def gradient_doubts(run: SolvedRun) -> list[Doubt]:
    """Return a doubt of all quantities where half of a run is steeper than any line and no positions say that it is."""
    if not is_steeper_than_any_line(run):
        return []
    reason = (
        f"the line would have a gradient of {1e3 * _gradient(run):.0f} permille for half of the run, and the steepest "
        f"has {1e3 * _STEEPEST:.0f}: the sensor's mounting is not determined"
    )
    return [Doubt(QUANTITIES, math.inf, reason, "declare mount_rpy_deg of [imu]; a rack railway needs GNSS besides")]


def is_steeper_than_any_line(run: SolvedRun) -> bool:
    """Return whether half of a run is steeper than any line and no positions say that it is."""
    return all(run.problem.family(kind) is None for kind in _SHOW_HEIGHTS) and _gradient(run) > _STEEPEST


def _gradient(run: SolvedRun) -> float:
    """Return the size of the run's median gradient."""
    states = run.solution.states
    forward = np.einsum("nij,j->ni", states.nav.R, mount_matrix(states.mount)[0, :, 0])
    return abs(float(np.median(forward[:, 2] / np.hypot(forward[:, 0], forward[:, 1]))))
