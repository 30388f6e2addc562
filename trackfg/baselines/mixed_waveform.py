"""Switching between two ways of measuring by speed, and the mixed waveform.

The conventional system gives the difference method's versines up to a speed ``V1``, the inertial ones from ``V2`` on,
and between them (the transition band)

    v = (1 - w) v_low + w v_high,   w = (V - V1) / (V2 - V1).

The developed one puts the *mixed waveform* between the two, the short waves of the inertial and the long waves of the
difference method,

    v_mix = v_IMU - MA(v_IMU) + MA(v_diff),

``MA`` a centred moving average (24 m for level; for alignment one over 24 m and on it one over 18 m, which is how
"24 m-18 m double moving average" is read), with a transition band at either end. Source: Suto, Tsubokawa and Yoshida
(2020), sections 2 and 3, which describe it in words and figures.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.geometry.moving_average import remove_baseline
from trackfg.numerics.arrays import Array


def blended(low: Array, high: Array, speed: Array, band: tuple[float, float]) -> Array:
    """Return ``low`` up to the speed ``band[0]``, ``high`` from ``band[1]`` on, linear between. Shapes (n,).

    A value that has no weight is not looked at: it may be NaN.
    """
    w = np.clip((speed - band[0]) / (band[1] - band[0]), 0.0, 1.0)
    between = (1.0 - w) * low + w * high
    return np.asarray(np.where(w == 0.0, low, np.where(w == 1.0, high, between)))


def mixed_waveform(inertial: Array, difference: Array, step_m: float, windows_m: Sequence[float]) -> Array:
    """Return short waves of one, long waves of the other, ``v_mix`` (n,); NaN within half the windows of an end."""
    long_waves = difference - remove_baseline(difference, step_m, windows_m)
    return np.asarray(remove_baseline(inertial, step_m, windows_m) + long_waves)
