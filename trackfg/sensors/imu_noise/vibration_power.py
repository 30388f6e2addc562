"""Vibration power is the mean square of what is faster than the motion of a vehicle on its springs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import uniform_filter1d

from trackfg.numerics.arrays import Array
from trackfg.sensors.imu_intervals import Intervals

_MOTION_S = 0.25
"""Means over this, s, are motion: what is faster than 2-4 Hz is vibration, a body on its springs sways at 1-2 Hz."""

_STEADY_S = 5.0
"""Vibration changes with the speed, over as many seconds; its power over one second scatters by a fifth."""


def vibration_widths(data: Intervals) -> tuple[int, int]:
    """Return over how many samples means are motion, and over how many the vibration lasts."""
    fast, lasting = (max(3, round(span / data.usual_duration)) for span in (_MOTION_S, _STEADY_S))
    return fast, lasting


def vibration_power(data: Intervals) -> Iterator[Array]:
    """Yield the power of the vibration at each sample, (m/s^2)^2, shape (n,), of one axis after the other.

    That is the mean square, over some seconds, of what is faster than the motion of a vehicle on its springs.
    """
    widths = [(rows, *vibration_widths(data.take(rows))) for rows in data.stretches]
    for force in data.accel.T:
        power = np.empty(len(data))
        for rows, fast, lasting in widths:
            shaking = force[rows] - uniform_filter1d(force[rows], fast)
            uniform_filter1d(np.square(shaking, out=shaking), lasting, output=power[rows])
        yield power
