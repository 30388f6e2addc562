"""What a sensor shows at rest, taken for its zero until the next rest."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def held_since_rest(t: Array, rests: Array, samples: Array) -> Array:
    """Return the mean of the samples (n, c) over each rest (start, end) of ``rests`` (m, 2), in order, at times ``t``
    (n,).

    Each holds from the start of its rest to that of the next, the first also before; zero where there is no rest.
    """
    if len(rests) == 0:
        return np.zeros_like(samples)
    means = np.stack([samples[(t >= start) & (t <= end)].mean(axis=0) for start, end in rests])
    return means[np.clip(np.searchsorted(rests[:, 0], t, side="right") - 1, 0, None)]
