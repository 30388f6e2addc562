"""Identity of curves: which curve of a new version of a map is which of the version before.

Both are rows of curves in order of chainage. A pair of one sense differs by

    d^2 = sum over q of (q_new - q_old)^2 / (sigma_new^2 + sigma_old^2 + floor^2),

where ``q`` are the mean chainage of the points that both have, the logarithm of the radius and the length of the
circle. Of all ways to pair them in order, the one with the least sum of ``d^2``, plus half a gate for each curve
without a partner, is taken (dynamic programming, as in Needleman and Wunsch, Journal of Molecular Biology 48, 1970): a
curve that appears or vanishes between others does not shift the rest, and a pair beyond the gate is none. The floors
are changes that leave a curve the same one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from scipy.special import chdtri

_FLOOR_M, _FLOOR_LOG_RADIUS, _FLOOR_LENGTH_M = 5.0, 0.03, 10.0
"""Changes of a curve that remains the same one, 1-sigma: m of its points, relative of its radius, m of its circle.
Chosen: what maintenance moves is less."""
_GATE = float(chdtri(3, 1e-4))
"""Greatest ``d^2`` of a pair: three quantities of the same curve exceed it once in 10,000."""


@dataclass(frozen=True)
class CurveFeatures:
    """The features by which a curve is identified: its sense, and (value, sigma) pairs in m.

    ``radius_m``; ``arc_length_m``, of the circle; ``points_m`` by their kind ("BTC" ...). What is not known is NaN, or
    no point.
    """

    sense: str
    radius_m: tuple[float, float]
    arc_length_m: tuple[float, float]
    points_m: dict[str, tuple[float, float]]


def paired(old: Sequence[CurveFeatures], new: Sequence[CurveFeatures]) -> list[int | None]:
    """Return for each new curve, in order of chainage, the index of the same old one, or None."""
    m, n = len(old), len(new)
    apart = np.array([[_distance(a, b) for b in new] for a in old]).reshape(m, n)
    unpaired = 0.5 * _GATE
    best = np.zeros((m + 1, n + 1))
    best[:, 0], best[0] = unpaired * np.arange(m + 1), unpaired * np.arange(n + 1)
    for i in range(m):
        for j in range(n):
            best[i + 1, j + 1] = min(best[i, j] + apart[i, j], best[i, j + 1] + unpaired, best[i + 1, j] + unpaired)
    partners: list[int | None] = [None] * n
    i, j = m, n
    while i and j:
        if best[i, j] == best[i - 1, j - 1] + apart[i - 1, j - 1]:
            i, j = i - 1, j - 1
            partners[j] = i
        elif best[i, j] == best[i - 1, j] + unpaired:
            i -= 1
        else:
            j -= 1
    return partners


def _distance(a: CurveFeatures, b: CurveFeatures) -> float:
    """Return ``d^2``, infinite for another sense or without a point in common."""
    common = a.points_m.keys() & b.points_m.keys()
    if a.sense != b.sense or not common:
        return math.inf
    places = [fmean(b.points_m[kind][0] - a.points_m[kind][0] for kind in common)]
    places += [fmean(points[kind][1] for kind in common) for points in (a.points_m, b.points_m)]
    (radius_a, radius_a_sd), (radius_b, radius_b_sd) = a.radius_m, b.radius_m
    (length_a, length_a_sd), (length_b, length_b_sd) = a.arc_length_m, b.arc_length_m
    terms = (
        places[0] / math.hypot(places[1], places[2], _FLOOR_M),
        math.log(radius_b / radius_a) / math.hypot(radius_a_sd / radius_a, radius_b_sd / radius_b, _FLOOR_LOG_RADIUS),
        (length_b - length_a) / math.hypot(length_a_sd, length_b_sd, _FLOOR_LENGTH_M),
    )
    return sum(term**2 for term in terms if math.isfinite(term))
