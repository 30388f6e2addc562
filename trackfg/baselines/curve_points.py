"""Curves as virtual balises: finding known curves again in the measured curvature, and checking that they are the ones.

A curve's points are, in the order of travel (the paper's table 1): start of the entry straight's check; its end, where
the transition begins; where the curvature passes the lower limit upwards, and downwards; where the exit straight
begins; end of its check. The position is corrected at the point where the curvature falls below the lower limit, by
what the table says of it less what the odometer does, if all diagnostics are passed:

1. the entry straight is as long as the table's (20 m): the curvature counts as straight over that distance;
2. the curvature has the sign of the curve, and nowhere exceeds its value by more than 20 %;
3. between the crossings of the lower limit, 20 % below the curve's value, lies the table's length, to a tolerance;
4. the exit straight is as long as the table's.

There is no correction where a slip was detected on the way, or where the train was slower than 10 km/h.

The measured curvature is the yaw rate over the speed, both averaged over the same 3 s, which is the heading's change
over the distance of those 3 s; it is held to be that in the middle of this distance.

Source: Iwata, Yamamichi, Sugiyama and Kitano, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.numerics.units import KMH

_MARGIN = 0.2
"""Share of the curve's value by which the lower limit is below it, and the upper one above."""
_STRAIGHT_1PM, _LENGTH_TOLERANCE_M = 1.0 / 2000.0, 20.0
"""Curvature that counts as straight, 1/m, and the tolerance of 3, m: assumed."""
_STRAIGHT_M, _WIDEST_RADIUS_M = 20.0, 600.0
"""Straight beside a curve that makes a good point, and the widest radius of one, m."""
_SLOWEST_KMH, _SEARCH_M = 10.0, 100.0
"""Least speed, km/h, and how far to either side a curve is looked for, m."""


@dataclass(frozen=True)
class CurvePoints:
    """One curve of the table, facing increasing chainage: ascending chainages, m; curvature 1/m, left positive."""

    start_m: float
    entry_m: float
    enter_m: float
    leave_m: float
    exit_m: float
    end_m: float
    curvature_1pm: float

    @property
    def length_m(self) -> float:
        """Return the length between the crossings of the lower limit, m."""
        return self.leave_m - self.enter_m


@dataclass(frozen=True)
class Sighting:
    """The outcome of one curve.

    ``left``, ``checked``: samples at which its end and that of the exit straight's check were passed. ``refused``: why
    there is no ``correction_m``; empty if there is one.
    """

    left: int
    checked: int
    place_m: float
    correction_m: float
    refused: str


def curve_table(chainage_m: Array, curvature_1pm: Array) -> list[CurvePoints]:
    """Return the curves of a line that make good points, from its curvature (n,) over ascending chainage (n,).

    Those sharper than 600 m, to one side only, with 20 m of straight before and after. The value of a curve is the
    median of what is within 10 % of its peak.
    """
    bends = true_runs(np.abs(curvature_1pm) >= _STRAIGHT_1PM)
    points = []
    for n, (first, stop) in enumerate(bends):
        entry, leaving = float(chainage_m[first]), float(chainage_m[stop - 1])
        previous_end = float(chainage_m[bends[n - 1][1] - 1] if n else chainage_m[0])
        next_begin = float(chainage_m[bends[n + 1][0]] if n + 1 < len(bends) else chainage_m[-1])
        bend = curvature_1pm[first:stop]
        if (
            entry - previous_end < _STRAIGHT_M
            or next_begin - leaving < _STRAIGHT_M
            or np.any(np.sign(bend) != np.sign(bend[0]))
        ):
            continue
        size = np.abs(bend)
        value = float(np.median(size[size >= 0.9 * size.max()]))
        level = (1.0 - _MARGIN) * value
        crossings = true_runs(size >= level)
        if value < 1.0 / _WIDEST_RADIUS_M or len(crossings) != 1:
            continue
        i, j = first + crossings[0][0], first + crossings[0][1] - 1
        points.append(
            CurvePoints(
                start_m=entry - _STRAIGHT_M,
                entry_m=entry,
                enter_m=_crossing(chainage_m, np.abs(curvature_1pm), i - 1, level),
                leave_m=_crossing(chainage_m, np.abs(curvature_1pm), j, level),
                exit_m=leaving,
                end_m=leaving + _STRAIGHT_M,
                curvature_1pm=value * float(np.sign(bend[0])),
            )
        )
    return points


def find_curve(
    curve: CurvePoints,
    place: Array,
    curvature: Array,
    speed: Array,
    slipping: np.ndarray,
    direction: int,
) -> Sighting | None:
    """Look for a curve about where the odometer says it should be; None if the run did not pass all of it there.

    ``place`` (n,) is the odometer's chainage, m; ``curvature`` (n,) 1/m facing increasing chainage; ``speed`` m/s and
    ``slipping``, of bool. A run against increasing chainage enters where the table has the curve's end.
    """
    rows = np.flatnonzero((place >= curve.start_m - _SEARCH_M) & (place <= curve.end_m + _SEARCH_M))
    if rows.size < 3:
        return None
    rows = np.arange(rows[0], rows[-1] + 1)
    size = curvature[rows] * np.sign(curve.curvature_1pm)
    limit = (1.0 - _MARGIN) * abs(curve.curvature_1pm)
    above = true_runs(np.abs(size) >= limit)
    if len(above) == 0:
        return None
    longest = above[np.argmax(above[:, 1] - above[:, 0])]
    i, j = int(longest[0]), int(longest[1]) - 1
    if i == 0 or j + 1 >= len(rows):
        return None
    travelled = direction * place[rows]
    enter = _crossing(travelled, np.abs(size), i - 1, limit)
    leave = _crossing(travelled, np.abs(size), j, limit)
    straight = np.abs(size) < _STRAIGHT_1PM
    straights_in, straights_out = true_runs(straight[:i]), j + 1 + true_runs(straight[j + 1 :])
    entry = float(travelled[straights_in[-1][1] - 1] - travelled[straights_in[-1][0]]) if len(straights_in) else 0.0
    leaving = float(travelled[straights_out[0][1] - 1] - travelled[straights_out[0][0]]) if len(straights_out) else 0.0
    straights = (curve.entry_m - curve.start_m, curve.end_m - curve.exit_m)
    needed_before, needed_after = straights if direction > 0 else straights[::-1]

    reached = travelled >= travelled[straights_out[0][0] if len(straights_out) else j] + needed_after
    checked = int(rows[np.argmax(reached)]) if reached.any() else int(rows[-1])
    began = np.searchsorted(travelled, travelled[straights_in[-1][1] - 1 if len(straights_in) else i] - needed_before)
    way = slice(int(rows[began]), checked + 1)
    reasons = [
        (entry < needed_before, f"entry straight of {entry:.0f} m"),
        (size[i : j + 1].mean() < 0.0, "curve to the other side"),
        (np.abs(size).max(initial=0.0) > (1.0 + _MARGIN) * abs(curve.curvature_1pm), "curvature above the limit"),
        (abs(leave - enter - curve.length_m) > _LENGTH_TOLERANCE_M, f"length of {leave - enter:.0f} m"),
        (leaving < needed_after, f"exit straight of {leaving:.0f} m"),
        (bool(slipping[way].any()), "slip or slide on the way"),
        (float(speed[way].min()) < _SLOWEST_KMH * KMH, "too slow"),
    ]
    leaving_m = curve.leave_m if direction > 0 else curve.enter_m
    return Sighting(
        left=int(rows[j]),
        checked=checked,
        place_m=direction * leave,
        correction_m=leaving_m - direction * leave,
        refused=", ".join(text for bad, text in reasons if bad),
    )


def _crossing(x: Array, y: Array, i: int, level: float) -> float:
    """Return where ``y``, straight between samples i and i + 1, is at ``level``."""
    return float(x[i] + (level - y[i]) / (y[i + 1] - y[i]) * (x[i + 1] - x[i]))
