"""A sensor that is declared rigid and leans in curves sits on springs: its path and its roll are not the track's.

In a steady state a body on springs leans outwards by a share s of the cant deficiency, the flexibility coefficient of
UIC 505-5: 0.2-0.4 for coaches. With the curvature k at the speed v,

    roll = -cant + s (x - cant),   x = v^2 k / g,

in a curve to the left, left side up. In a circle the cant stays, so that roll against x has the slope s there, and 0
for a sensor on a wheelset. Where the speed does not change in curves lean and cant are one, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt
from trackfg.smoothing.passage import Passage, chord_curvature, passage
from trackfg.smoothing.reassessment import Reassessment, SolvedRun

_CURVED_1PM = 1e-3
"""Curvature from which on a curve leans a body much: at R 1000 and 20 m/s, without cant, by 8 mrad at s = 0.2."""

_CONSTANT = 0.05
"""Share by which the curvature of a circle may vary over the span around a place: transitions change it by more."""

_SPAN_CELLS = 7
"""Cells around a place in which its curvature is compared: 60 m, as short as transitions are."""

_CHORD_CELLS = 2
"""Curvature is that of the heading over so many cells to either side."""

_FEWEST_CELLS = 4
"""Circles of fewer cells are left out: the mean and the slope of three are two thirds of them."""

_ALIKE_CELLS = 3.0
"""Irregularities of the cross-level are alike over some 30 m, so that so many cells are worth one."""

_LEAST_POWER = 1e-10
"""Sum of squares of x, rad^2, below which rounding is all that changes."""

_SURE_SIGMAS = 4.0
"""Sigmas by which the slope has to exceed :data:`_LEAST`."""

_LEAST = 0.05
"""Bogie frames, on their stiff springs, lean less than this share; what is measured on them is nearly the track's."""

_HINT = "write rigid = false in [imu]: the geometry of the track then needs displacement sensors"


class _Lean(NamedTuple):
    """Share of the cant deficiency by which the vehicle leans outwards, with its sigma."""

    share: float
    sd: float


def leaning_body(run: SolvedRun) -> Reassessment:
    """Reassess whether a sensor that is declared rigid leans in curves."""
    if run.problem.family(FactorType.PATH) is None:
        return Reassessment(run.problem)
    at = passage(run)
    lean = _lean(at)
    if lean.share - _LEAST < _SURE_SIGMAS * lean.sd:
        return Reassessment(run.problem)
    message = (
        f"in curves the vehicle leans outwards by {100 * lean.share:.0f} +- {100 * lean.sd:.0f} % of the cant "
        "deficiency: the sensor is on springs and was declared rigid"
    )
    angle = lean.share / (1.0 + lean.share) * (_pull(at) + at.roll)
    factor = float(np.sqrt(1.0 + np.mean(angle**2) / np.mean(at.roll_variance)))
    doubts = (
        Doubt(("cross_level", "twist", "level", "alignment"), np.inf, message, _HINT),
        Doubt(("roll",), factor, message, _HINT),
    )
    return Reassessment(run.problem, (Finding("warning", "leaning-body", message, hint=_HINT),), doubts)


def _lean(at: Passage) -> _Lean:
    """Return the slope of roll against x within circles, and its sigma; infinite where no speed changes."""
    pull, roll = [np.zeros(0)], [np.zeros(0)]
    x = _pull(at)
    for circle in _circles(_curvature(at)):
        pull.append(x[circle] - x[circle].mean())
        roll.append(at.roll[circle] - at.roll[circle].mean())
    x, phi = np.concatenate(pull), np.concatenate(roll)
    power = float(x @ x)
    circles = len(pull) - 1
    free = len(x) / _ALIKE_CELLS - circles - 1
    if power < _LEAST_POWER or free <= 0.0:
        return _Lean(0.0, np.inf)
    share = float(x @ phi) / power
    variance = float(np.sum((phi - share * x) ** 2)) / _ALIKE_CELLS / free
    return _Lean(share, float(np.sqrt(_ALIKE_CELLS * variance / power)))


def _curvature(at: Passage) -> Array:
    """Return the turn to the left per metre of way, 1/m, 0 at both ends of the run."""
    curvature = np.zeros(len(at.heading))
    curvature[_CHORD_CELLS:-_CHORD_CELLS] = chord_curvature(at.heading, _CHORD_CELLS)
    return curvature


def _pull(at: Passage) -> Array:
    """Return x, rad: what the cant would be that takes up all of the lateral acceleration."""
    return np.asarray(at.speed * np.abs(at.speed) * _curvature(at) / STANDARD_GRAVITY)


def _circles(curvature: Array) -> Iterator[slice]:
    """Yield the circles, as cells along the way."""
    spread = maximum_filter1d(curvature, _SPAN_CELLS) - minimum_filter1d(curvature, _SPAN_CELLS)
    size = np.abs(curvature)
    circular = (size > _CURVED_1PM) & (spread < _CONSTANT * size)
    for first, end in true_runs(circular).tolist():
        if end - first >= _FEWEST_CELLS:
            yield slice(first, end)
