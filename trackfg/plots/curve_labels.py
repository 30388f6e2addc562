"""The curves of a line, named by sense and radius, from its measured curvature."""

from __future__ import annotations

import numpy as np

from trackfg.geometry.curves import curve_sense, mean_curvature
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs

_STRAIGHT_1PM = 1e-4
"""Curvature below which a curve is called straight, 1/m: a radius of 10 km."""
_LEAST_LENGTH_M = 40.0
"""A shorter curve is not named, m. Chosen for the look."""
_BODY = 0.8
"""The circle of a curve is where it has this share of its greatest curvature."""


def sense_and_radius(curvature_1pm: float) -> str:
    """Return ``left R 402 m``; ``straight`` where the radius is above 10 km, empty where there is no curvature."""
    if not np.isfinite(curvature_1pm):
        return ""
    if abs(curvature_1pm) < _STRAIGHT_1PM:
        return "straight"
    return f"{'left' if curvature_1pm > 0.0 else 'right'} R {1.0 / abs(curvature_1pm):.0f} m"


def curves(chainage_m: Array, curvature_1pm: Array) -> list[tuple[float, float, str]]:
    """Return start, end (m) and :func:`sense_and_radius` of each curve, the longest first.

    The table is on a uniform grid. The radius is the median one of the curve's sharpest part.
    """
    mean = mean_curvature(chainage_m, curvature_1pm)
    sense = curve_sense(chainage_m, curvature_1pm)
    measured = ~np.isnan(curvature_1pm)
    arcs = []
    for side in (1.0, -1.0):
        for start, end in true_runs((sense == side) & measured):
            along, bend = chainage_m[start:end], np.abs(mean[start:end])
            if along[-1] - along[0] >= _LEAST_LENGTH_M:
                circle = curvature_1pm[start:end][bend >= _BODY * bend.max()]
                arcs.append((float(along[0]), float(along[-1]), sense_and_radius(float(np.median(circle)))))
    return sorted(arcs, key=lambda curve: curve[0] - curve[1])
