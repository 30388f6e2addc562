"""A sensor that is declared rigid and leans in curves sits on springs: its path and its roll are not the track's.

In a steady state a body on springs leans outwards by a share s of the cant deficiency, the flexibility coefficient of
UIC 505-5: 0.2-0.4 for coaches. With the curvature k at the speed v,

    roll = -cant + s (x - cant),   x = v^2 k / g,

in a curve to the left, left side up. In a circle the cant stays, so that roll against x has the slope s there, and 0
for a sensor on a wheelset. Where the speed does not change in curves lean and cant are one, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.passage import chord_curvature, passage
from trackfg.smoothing.reassessment import Reassessment, SolvedRun

_CURVED_1PM = 1e-3
"""Curvature from which on a curve leans a body much: at R 1000 and 20 m/s, without cant, by 8 mrad at s = 0.2."""

_CONSTANT = 0.05
"""Share by which the curvature of a circle may vary over the span around a place: transitions change it by more."""

_SPAN_CELLS = 7
"""Cells around a place in which its curvature is compared: 60 m, as short as transitions are."""

_CHORD_CELLS = 2
"""Curvature is that of the heading over so many cells to either side."""

NEIGHBOURS = _SPAN_CELLS // 2 + _CHORD_CELLS
"""Cells on either side of one that decide whether it is in a circle."""

FEWEST_CELLS = 4
"""Circles of fewer cells are left out: the mean and the slope of three are two thirds of them."""

ALIKE_CELLS = 3.0
"""Irregularities of the cross-level are alike over some 30 m, so that so many cells are worth one."""

_LEAST_POWER = 1e-10
"""Sum of squares of x, rad^2, below which rounding is all that changes."""

_SURE_SIGMAS = 4.0
"""Sigmas by which the slope has to exceed :data:`_LEAST`."""

_LEAST = 0.05
"""Bogie frames, on their stiff springs, lean less than this share; what is measured on them is nearly the track's."""

OF_TRACK: tuple[Quantity, ...] = ("cross_level", "twist", "level", "alignment", "curvature")
"""What such a sensor shows of the vehicle, and not of the track."""

HINT = "write rigid = false in [imu]: the geometry of the track then needs displacement sensors"


class Lean(NamedTuple):
    """Share of the cant deficiency by which the vehicle leans outwards, with its sigma."""

    share: float
    sd: float

    @property
    def is_sure(self) -> bool:
        """Return whether it is more than a bogie frame leans, beyond chance."""
        return self.share - _LEAST >= _SURE_SIGMAS * self.sd

    def in_words(self) -> str:
        """Say what it shows."""
        return (
            f"in curves the vehicle leans outwards by {100 * self.share:.0f} +- {100 * self.sd:.0f} % of the cant "
            "deficiency: the sensor is on springs and was declared rigid"
        )


def leaning_body(run: SolvedRun) -> Reassessment:
    """Reassess whether a sensor that is declared rigid leans in curves."""
    if run.problem.family(FactorType.PATH) is None:
        return Reassessment(run.problem)
    at = passage(run)
    x = pull(at.speed, at.heading)
    lean = lean_of(circle_sums(x, at.roll, circles(at.heading)))
    if not lean.is_sure:
        return Reassessment(run.problem)
    message = lean.in_words()
    angle = lean.share / (1.0 + lean.share) * (x + at.roll)
    factor = float(np.sqrt(1.0 + np.mean(angle**2) / np.mean(at.roll_variance)))
    doubts = (
        Doubt(OF_TRACK, np.inf, message, HINT),
        Doubt(("roll",), factor, message, HINT),
    )
    return Reassessment(run.problem, (Finding("warning", "leaning-body", message, hint=HINT),), doubts)


def circle_sums(x: Array, roll: Array, within: Iterable[slice]) -> Array:
    """Return sums over the cells of circles, (5,): of x^2, x roll and roll^2, each x and roll (n,) less its mean in the
    circle; and the numbers of cells and of circles.
    """
    sums = np.zeros(5)
    for circle in within:
        own_x, own_roll = x[circle] - x[circle].mean(), roll[circle] - roll[circle].mean()
        sums += [own_x @ own_x, own_x @ own_roll, own_roll @ own_roll, len(own_x), 1.0]
    return sums


def lean_of(sums: Array) -> Lean:
    """Return the slope of roll against x within circles, and its sigma; infinite where no speed changes."""
    power, product, of_roll, cells, number = sums.tolist()
    free = cells / ALIKE_CELLS - number - 1.0
    if power < _LEAST_POWER or free <= 0.0:
        return Lean(0.0, np.inf)
    share = product / power
    variance = (of_roll - share * product) / ALIKE_CELLS / free
    return Lean(share, float(np.sqrt(ALIKE_CELLS * max(variance, 0.0) / power)))


def pull(speed: Array, heading: Array) -> Array:
    """Return x (n,), rad: what the cant would be that takes up all of the lateral acceleration."""
    return np.asarray(speed * np.abs(speed) * _curvature(heading) / STANDARD_GRAVITY)


def circles(heading: Array) -> Iterator[slice]:
    """Yield the circles, as cells along the way."""
    curvature = _curvature(heading)
    spread = maximum_filter1d(curvature, _SPAN_CELLS) - minimum_filter1d(curvature, _SPAN_CELLS)
    size = np.abs(curvature)
    circular = (size > _CURVED_1PM) & (spread < _CONSTANT * size)
    for first, end in true_runs(circular).tolist():
        if end - first >= FEWEST_CELLS:
            yield slice(first, end)


def _curvature(heading: Array) -> Array:
    """Return the turn to the left per metre of way, 1/m, 0 at both ends."""
    curvature = np.zeros(len(heading))
    if len(heading) > 2 * _CHORD_CELLS:
        curvature[_CHORD_CELLS:-_CHORD_CELLS] = chord_curvature(heading, _CHORD_CELLS)
    return curvature
