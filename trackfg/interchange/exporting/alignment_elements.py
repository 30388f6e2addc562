"""Alignment elements are the straights, transitions and circles of curves, laid end to end, with their cant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.curves import Curve
from trackfg.curves.transition_laws import LAWS, TransitionLaw, rise
from trackfg.numerics.arrays import Array

_SHORTEST_M = 0.01
"""Elements below the resolution of coordinates in such files are left out, m."""


@dataclass(frozen=True)
class AlignmentElement:
    """An element of an alignment: curvature (1/m, left positive) and cant (mm, left rail higher) at both ends."""

    length_m: float
    start: float
    end: float
    start_cant_mm: float
    end_cant_mm: float
    law: TransitionLaw = "clothoid"

    def headings(self, x: Array) -> Array:
        """Return the turn since the element's start, rad, at places x (m,) of it, m."""
        _, first, _ = rise(self.law, x / self.length_m)
        return np.asarray(self.start * x + (self.end - self.start) * self.length_m * first)


def alignment_elements(curves: Sequence[Curve], start: float, end: float) -> list[AlignmentElement]:
    """Return the elements between two chainages; what lies beyond an end of the profile is cut off there."""
    elements: list[AlignmentElement] = []
    at, previous = start, None
    for curve in curves:
        begin, stop = max(np.nan_to_num(curve.bcc_m, nan=start), start), min(np.nan_to_num(curve.ecc_m, nan=end), end)
        curvature, cant = curve.curvature_1pm, curve.cant_mm * -np.sign(curve.curvature_1pm)
        # Curves whose ends are not known (NaN) are joined, too.
        if previous is not None and not curve.btc_m > previous.etc_m + _SHORTEST_M:
            last = elements[-1]
            elements.append(
                AlignmentElement(begin - at, last.end, curvature, last.end_cant_mm, cant, _law(curve.law_in))
            )
        else:
            if previous is not None:
                elements.append(_exit(previous, at))
                at += elements[-1].length_m
            straight = np.nan_to_num(curve.btc_m, nan=at)
            elements.append(AlignmentElement(max(straight - at, 0.0), 0.0, 0.0, 0.0, 0.0))
            at = max(straight, at)
            elements.append(AlignmentElement(begin - at, 0.0, curvature, 0.0, cant, _law(curve.law_in)))
        elements.append(AlignmentElement(stop - begin, curvature, curvature, cant, cant))
        at, previous = stop, curve
    if previous is not None and at < end:
        elements.append(_exit(previous, at))
        at += elements[-1].length_m
    elements.append(AlignmentElement(end - at, 0.0, 0.0, 0.0, 0.0))
    return [element for element in elements if element.length_m > _SHORTEST_M]


def _exit(curve: Curve, at: float) -> AlignmentElement:
    cant = curve.cant_mm * -np.sign(curve.curvature_1pm)
    length = np.nan_to_num(curve.etc_m, nan=at) - at
    return AlignmentElement(max(length, 0.0), curve.curvature_1pm, 0.0, float(cant), 0.0, _law(curve.law_out))


def _law(law: str) -> TransitionLaw:
    return next((transition for transition in LAWS if transition == law), "clothoid")
