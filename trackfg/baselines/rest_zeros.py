"""A sensor's output at rest is taken for its zero until the next rest."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def held_since_rest(t: Array, rests: Array, samples: Array) -> Array:
    """Return the means of the samples (n, c) at ``t`` (n,) over the latest of the ``rests`` (m, 2), which are in order.

    Each holds from the start of its rest to that of the next, the first also before; zero where there is no rest.
    """
    if len(rests) == 0:
        return np.zeros_like(samples)
    means = np.stack([samples[(t >= start) & (t <= end)].mean(axis=0) for start, end in rests])
    return means[np.clip(np.searchsorted(rests[:, 0], t, side="right") - 1, 0, None)]
