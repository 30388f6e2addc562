"""The base of a recorded twist, and where it lies, are identified from the recorded cross-level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackfg.errors import BadInputError
from trackfg.geometry.twist import ANCHORS, Anchor, twist
from trackfg.numerics.arrays import Array

_LONGEST_M = 20.0
"""Longest base that is tried, m: EN 13848-5 has limits for bases up to 20 m."""
_ROWS = 40_000
"""Rows that are compared: 10 km are enough to identify any base."""
_LEFT_OVER = 0.2
"""Greatest share of the recorded twist, as rms, that the computed one may leave: next to the right base, 0.25 m off at
3 m, some 10 % are left; with a wrong anchor the whole."""


@dataclass(frozen=True)
class TwistBase:
    """A recorded twist is ``sign`` times that over ``base_m``; ``left_mm``: rms of what is left, mm."""

    base_m: float
    anchor: Anchor
    sign: Literal[1, -1]
    left_mm: float


def identified_base(cross_level_mm: Array, twist_mm: Array, step_m: float) -> TwistBase | None:
    """Return the base for which the twist of a cross-level (n,), mm, is the recorded one; None where none fits."""
    level, recorded = cross_level_mm[:_ROWS], twist_mm[:_ROWS]
    size = float(np.sqrt(np.nanmean((recorded - np.nanmean(recorded)) ** 2))) if np.isfinite(recorded).any() else 0.0
    best: TwistBase | None = None
    for count in range(1, round(_LONGEST_M / step_m) + 1):
        for anchor in ANCHORS:
            try:
                computed = twist(level, step_m, count * step_m, anchor)
            except BadInputError:  # a centred base of an odd number of steps
                continue
            known = np.isfinite(computed) & np.isfinite(recorded)
            if known.sum() < 2:
                continue
            sign: Literal[1, -1] = 1 if float(computed[known] @ recorded[known]) >= 0.0 else -1
            misfit_mm = float(np.sqrt(np.mean((recorded - sign * computed)[known] ** 2)))
            if misfit_mm < _LEFT_OVER * size and (best is None or misfit_mm < best.left_mm):
                best = TwistBase(count * step_m, anchor, sign, misfit_mm)
    return best
