"""An IMU whose clock gains on that of the tach shows that one of both clocks is wrong, and not which.

A drift d of the tach's clock against the IMU's is estimated, so that distances are right at the IMU's times. If it is
the IMU's clock that is wrong, speeds are off by d, distances that its accelerometer determines by 2 d, and fixes and
positions, whose own clocks have no drift in the graph, come late by d times the time.
"""

from __future__ import annotations

import math

import numpy as np

from trackfg.factors.states import Kind
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.reassessment import SolvedRun

BY_CLOCK: tuple[Quantity, ...] = ("chainage", "position", "height", "speed", "pitch", "gradient")
"""What a clock that gains makes wrong: what is a distance or a speed, and what separates gravity from acceleration."""

_FAR_SIGMAS = 4.0
"""Sigmas of what is declared and of the estimate beyond which a drift is no quartz's, as of other priors."""


def clock_doubts(run: SolvedRun) -> list[Doubt]:
    """Return the doubt of what a clock makes wrong that gains on another by more than is declared."""
    drift = float(run.solution.states.clock[0, 1])
    known_to = math.sqrt(float(run.covariance.of(Kind.CLOCK)[0, 1, 1]))
    if run.problem.wheel is None or not is_far(drift, run.config.tach.clock_drift_sd, known_to):
        return []
    return [Doubt(BY_CLOCK, math.inf, in_words(drift), "stamp both sensors by one clock")]


def is_far(drift: float, declared_sd: float, known_to: float) -> bool:
    """Return whether a drift is beyond what is declared, and known well enough to say so."""
    return bool(abs(drift) > _FAR_SIGMAS * np.hypot(declared_sd, known_to))


def in_words(drift: float) -> str:
    """Return what a drift says of both clocks."""
    return f"the clock of the IMU gains {100.0 * drift:.2g} % on that of the tach, and nothing shows which one is right"
