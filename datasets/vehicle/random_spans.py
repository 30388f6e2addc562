"""Spans at random along an axis: stretches of track, times without reception."""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array


def random_spans(rate: float, lengths: tuple[float, float], end: float, rng: np.random.Generator) -> Array:
    """Return spans (start, end) that start between 0 and ``end``, in order and apart. Shape (k, 2).

    The gap before a span is exponential with mean ``1/rate``, its length uniform within ``lengths``. They are drawn one
    after the other: those up to a smaller ``end`` are the same ones.
    """
    spans: list[tuple[float, float]] = []
    place = rng.exponential(1.0 / rate) if rate > 0 else np.inf
    while place < end:
        length = rng.uniform(*lengths)
        spans.append((place, place + length))
        place += length + rng.exponential(1.0 / rate)
    return np.array(spans).reshape(-1, 2)
