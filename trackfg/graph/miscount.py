"""A tach that misses pulses, or counts some twice, is found out by the accelerometer before slips are sought.

Each such error looks like a short slip. Where they are many, a search for slips takes the largest for slips, and what
is left for a good wheel. As independent errors with the density c, m in sqrt(1 m), they give the third difference over
times T apart (:mod:`trackfg.sensors.speed_noise`), in which d_1, d_2 and d_3 m are rolled, the variance

    V = c^2 (d_1 + 4 d_2 + d_3) + O,   O = v_1 + 4 v_2 + v_3 + 20 r^2 + a^2 T^3,

with the variances v of the creep that a wheel is expected to have (:mod:`trackfg.graph.odometry`), the sigma r of a
reading, and the accelerometer's noise a. The median of squares is that of normal errors of these variances with

    c^2 = median ((m D^2 - O) / (d_1 + 4 d_2 + d_3)),   m = 1.4826^2,

for the differences D; no more than half of them may be slips. What else moves the wheel's distance against the
accelerometer grows with T faster (gradients, traction) or not at all (a body that rocks), so that each T gives an upper
limit of c, and the lowest is taken.
"""

from __future__ import annotations

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.graph.odometry import creep_variance_over
from trackfg.numerics.robust import SD_PER_MAD, median
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.speed_noise import FEWEST, third_differences
from trackfg.sensors.tach import Wheel

_STEPS_S = (0.5, 1.0, 2.0)
"""T, s: from the step of the search for slips to as long as a gradient hardly changes."""

_WEIGHTS = np.array([1.0, 4.0, 1.0])
"""Squares of the coefficients of a second difference, which a third one is of increments."""

_READINGS = 20.0
"""Sum of the squares of the coefficients of a third difference."""

_ROUNDED = 0.5
"""Where roundings are most of what is expected, differences beyond it by less than this share of them are no errors of
the count: roundings are not independent. With four pulses per revolution they make 0.3 to 0.35 more."""


def with_miscount(wheel: Wheel, data: Intervals, gravity: float, config: SmoothConfig) -> Wheel:
    """Return the wheel with the errors of its count; itself where it has none, or is too short to show them.

    ``gravity`` m/s^2.
    """
    density = _density(wheel, data, gravity, config)
    return wheel.with_miscount(density) if density > 0.0 else wheel


def _density(wheel: Wheel, data: Intervals, gravity: float, config: SmoothConfig) -> float:
    """Return c, m in sqrt(1 m); 0 where differences over some T are no larger than expected."""
    least = np.inf
    for step, differences in zip(_STEPS_S, third_differences(wheel, data, _STEPS_S), strict=True):
        if len(differences.noise) < FEWEST:
            break
        distance = np.abs(differences.distance)
        creep = creep_variance_over(distance, differences.force / gravity, step, config.tach) * config.noise.tach**2
        rolled, rounding = creep @ _WEIGHTS + differences.by_accel, _READINGS * wheel.rounding_sd**2
        excess = SD_PER_MAD**2 * differences.noise**2 - rolled - rounding
        if rounding > median(rolled) and median(excess) < _ROUNDED * rounding:
            return 0.0
        least = min(least, median(excess / (distance @ _WEIGHTS)))
    return float(np.sqrt(max(least, 0.0))) if least < np.inf else 0.0
