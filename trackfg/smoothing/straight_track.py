"""Straight track has no cant: a roll on it that lasts is the sensor's, and the recording does not declare it."""

from __future__ import annotations

import math

import numpy as np

from trackfg.factors.motion import mount_matrix
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.results.verdict import Doubt
from trackfg.smoothing.reassessment import SolvedRun

_STRAIGHT_PER_M = 1.0 / 5000.0
"""Curvature below which track is straight, 1/m: curves of 5 km and more have 0-20 mm of cant even at 160 km/h."""

_LEAST_M = 500.0
"""Straight track that is needed, m: cross-level errors of maintenance and of transitions average out."""

_ROLL_SD = 2e-3
"""Sigma of the mean roll of straight track, rad: 3 mm on 1500 mm, the limit for new track in EN 13231-1."""

_FAR = 3.0
"""A mean further off than this, in sigmas, is not the track's."""

_LEAST_MPS = 1.0
"""Slower keyframes do not tell the curvature, m/s."""


def roll_on_straights(run: SolvedRun) -> list[Doubt]:
    """Return a doubt of roll and cross-level where straight track seems to be canted."""
    states, context = run.solution.states, run.problem.run
    step = np.abs(np.diff(states.odo.distance))
    roll, _, yaw = rpy_from_matrix(states.nav.R @ mount_matrix(states.mount)[0]).T
    turned = np.abs(np.diff(np.unwrap(yaw)))
    moving = step > _LEAST_MPS * np.diff(context.t)
    straight = moving & (turned < _STRAIGHT_PER_M * step)
    weight = step * (straight & np.append(straight[1:], False) & np.append(False, straight[:-1]))
    if weight.sum() < _LEAST_M:
        return []
    variance = keyframe_variances(states, run.covariance, context.lever_arm, context.mount_roll_sd)
    sigma = math.sqrt(float(np.mean(variance[:, QUANTITIES.index("roll_rad")])))
    mean = float(np.average(0.5 * (roll[1:] + roll[:-1]), weights=weight))
    if abs(mean) < _FAR * math.hypot(_ROLL_SD, sigma):
        return []
    reason = f"straight track seems to be canted by {1e3 * mean:+.1f} mrad: the sensor is mounted so, or the track is"
    hint = "survey the roll of the mounting, or declare imu.mount_roll_sd_deg"
    return [Doubt(("roll", "cross_level"), math.hypot(1.0, mean / sigma), reason, hint)]
