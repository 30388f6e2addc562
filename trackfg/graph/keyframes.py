"""States are estimated at keyframes.

A phase runs along the recording at the rate ``max(1/interval, speed/distance)``, slower at rest; a keyframe lies at
each whole number. Starts and ends of rests and gaps and the times of positions are keyframes of their own, and a
regular one too close to such a one gives way. All keyframes lie on edges between inertial samples.
"""

from __future__ import annotations

import numpy as np

from trackfg.config import KeyframeConfig
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.spans import nearest, within

TOO_CLOSE = 0.35
"""In phase: a regular keyframe nearer than this to a required one is dropped."""


def place_keyframes(
    edges: Array, t: Array, speed: Array, rests: Array, required: Array, config: KeyframeConfig
) -> np.ndarray:
    """Return indices into ``edges`` (n + 1,), increasing, from 0 to n; ``speed`` (m,) is given at times ``t`` (m,)."""
    rate = np.maximum(1.0 / config.interval_s, np.abs(speed) / config.distance_m)
    rate = np.where(within(t, rests), 1.0 / config.interval_at_rest_s, rate)
    phase = trapezoid_integral(t, rate)
    fixed = np.unique(np.concatenate([required, rests.ravel(), [edges[0], edges[-1]]]))
    fixed = fixed[(fixed >= edges[0]) & (fixed <= edges[-1])]
    fixed_phase = np.interp(fixed, t, phase)
    regular = np.arange(1.0, phase[-1])
    upper = np.clip(np.searchsorted(fixed_phase, regular), 1, len(fixed) - 1)
    distance = np.minimum(np.abs(regular - fixed_phase[upper - 1]), np.abs(fixed_phase[upper] - regular))
    times = np.concatenate([fixed, np.interp(regular[distance > TOO_CLOSE], phase, t)])
    return np.unique(nearest(edges, times))
