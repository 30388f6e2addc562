"""The scale of a panel is the part of its axis that is shown.

A sigma grows without bound where a run was slow, and the values with it. What was measured well sets the scale: no peak
that stands out of its own noise leaves the panel, and no noise squeezes the rest.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array

_POOR = 5.0
"""A sigma above this many times the channel's median is poor; a value of this many of its own sigmas is no noise."""

_NEAR = 2.5
"""Limits within this many times the extent of the values are brought into the panel."""

_MARGIN = 0.08
"""Air above and below, as a share of the extent. Chosen for the look."""


def extent(values: Array, sigmas: Array, base: float, least: float) -> tuple[float, float]:
    """Return least and greatest of the values measured well, ``base`` among them and, from it, ``least`` at least, to
    the sides on which there are values.
    """
    finite = np.isfinite(values) & np.isfinite(sigmas)
    y, sd = values[finite], sigmas[finite]
    if y.size == 0:
        return base - least, base + least
    good = (sd <= _POOR * np.median(sd)) | (np.abs(y - np.median(y)) >= _POOR * sd)
    low, high = min(float(y[good].min()), base), max(float(y[good].max()), base)
    if max(base - low, high - base) < least:
        return (base - least if low < base else base), (base + least if high > base or low == base else base)
    return low, high


def with_limits(low: float, high: float, base: float, limits: Array) -> tuple[float, float]:
    """Return the extent with those limits that are near enough not to squeeze the values."""
    reach = _NEAR * max(base - low, high - base)
    near = limits[np.abs(limits - base) <= reach]
    return float(np.min(near, initial=low)), float(np.max(near, initial=high))


def symmetric(low: float, high: float, base: float) -> tuple[float, float]:
    """Return the extent with ``base`` in its middle."""
    reach = max(base - low, high - base)
    return base - reach, base + reach


def with_margin(low: float, high: float) -> tuple[float, float]:
    """Return the extent with some air above and below."""
    air = _MARGIN * (high - low)
    return low - air, high + air


def common_zero(
    first: tuple[float, float], second: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return both extents widened so that zero, which is in both, is at the same height of one panel."""
    sizes = [max(-low, high) for low, high in (first, second)]
    low = min(first[0] / sizes[0], second[0] / sizes[1])
    high = max(first[1] / sizes[0], second[1] / sizes[1])
    return (low * sizes[0], high * sizes[0]), (low * sizes[1], high * sizes[1])
