"""The motion of a vehicle's body is its deviation from the designed line, as functions of time.

Five functions: ``y`` to the horizontal left of the designed heading and ``z`` vertically up, m, and what is added to
the designed roll, pitch and yaw, rad. They are cubic splines with a knot at every edge of the IMU's intervals, so that
within an interval everything is smooth; the splines *are* the body's true motion, whatever model drew their values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from trackfg.numerics.arrays import Array


@dataclass(frozen=True)
class BodyMotion:
    """Columns: left and up, m, roll, pitch and yaw, rad.

    ``spline`` is cubic, over time, and means nothing more than a knot's distance beyond its ends.
    """

    spline: BSpline

    def at(self, t: Array, nu: int = 0) -> Array:
        """Return the five functions, or their derivatives of order ``nu`` <= 2, at any times. Shape (...) to (...,
        5).
        """
        return np.asarray(self.spline(t, nu))

    @property
    def knots_s(self) -> Array:
        """Return where the third derivatives jump, sorted."""
        return np.unique(self.spline.t)


def through(edges: Array, values: Array) -> BodyMotion:
    """Return the motion through ``values`` (n + 1, 5) at the times ``edges`` (n + 1,), twice continuously
    differentiable.
    """
    return BodyMotion(make_interp_spline(edges, values, k=3))
