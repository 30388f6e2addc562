"""Roll and pitch: what the specific force shows of them, and how the angular rate changes them."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def force_tilt(force: Array) -> Array:
    """Return roll and pitch (n, 2), rad, of a body at rest that measures ``force`` (n, 3), m/s^2: f = R' (0, 0, g)."""
    return np.stack(
        [np.arctan2(force[:, 1], force[:, 2]), np.arctan2(-force[:, 0], np.hypot(force[:, 1], force[:, 2]))], axis=1
    )


def euler_rates(rate: Array, tilt: Array) -> Array:
    """Return the rates of roll, pitch and yaw (n, 3), rad/s, of a body that turns with ``rate`` (n, 3) in its axes.

    ``tilt`` (n, 2): its roll and pitch, rad.
    """
    sin_r, cos_r = np.sin(tilt[:, 0]), np.cos(tilt[:, 0])
    across = rate[:, 1] * sin_r + rate[:, 2] * cos_r
    roll = rate[:, 0] + across * np.tan(tilt[:, 1])
    return np.stack([roll, rate[:, 1] * cos_r - rate[:, 2] * sin_r, across / np.cos(tilt[:, 1])], axis=1)
