"""A curve has four points, a circle, transition laws and cant, with their covariance; a table has several curves.

Facing increasing chainage, a curve has BTC, BCC, ECC and ETC: begin of transition, begin and end of the circular curve,
end of transition. In a compound curve the transition between two parts is the exit of one and the entry of the next.
Where the profile begins or ends within a curve, the points beyond it are NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.curves.transition_laws import TransitionLaw
from trackfg.numerics.arrays import Array

CurveKind = Literal["simple", "compound part", "reverse part", "compound and reverse part"]
CurveLaw = TransitionLaw | Literal["none", "unseen"]

POINTS = ("btc_m", "bcc_m", "ecc_m", "etc_m")
"""The points of a curve by chainage, m: where the transition in begins and ends, and where the one out does."""
QUANTITIES = (*POINTS, "curvature_1pm", "cant_mm")
"""What :attr:`Curve.covariance` refers to, in this order."""


@dataclass(frozen=True)
class Curve:
    """A circular curve and its transitions. ``id`` counts from 1 in order of chainage.

    ``sense`` faces increasing chainage; ``curvature_1pm`` is positive to the left; ``cant_mm`` raises the outer rail.
    ``covariance`` (6, 6) is that of :data:`QUANTITIES`, NaN for what is not known: neighbouring points err together,
    and the middle of a transition is known far better than its ends. ``law_in_probability`` and ``law_out_probability``
    say how sure the laws are. A law is "none" without transition and "unseen" beyond the profile's ends.

    Examples
    --------
    >>> from trackfg.curves import find_curves
    >>> from trackfg.datasets import simulate
    >>> designed = simulate("mainline", seed=1, duration_s=90.0).truth_geometry
    >>> curve = find_curves(designed.assign(curvature_1pm_sd=1e-5))[0]
    >>> curve.id, curve.sense, round(curve.radius_m)
    (1, 'left', 581)
    """

    id: int
    kind: CurveKind
    sense: Literal["left", "right"]
    btc_m: float
    bcc_m: float
    ecc_m: float
    etc_m: float
    curvature_1pm: float
    cant_mm: float
    law_in: CurveLaw
    law_out: CurveLaw
    law_in_probability: float
    law_out_probability: float
    covariance: Array

    @property
    def radius_m(self) -> float:
        """The radius of the circle, m, positive."""
        return 1.0 / abs(self.curvature_1pm)

    @property
    def length_in_m(self) -> float:
        """The length of the transition at the begin, m."""
        return self.bcc_m - self.btc_m

    @property
    def length_out_m(self) -> float:
        """The length of the transition at the end, m."""
        return self.etc_m - self.ecc_m

    @property
    def arc_length_m(self) -> float:
        """The length of the circular curve, m."""
        return self.ecc_m - self.bcc_m

    @property
    def middle_in_m(self) -> float:
        """The middle of the transition at the begin, m: the best-known point of the curve's begin."""
        return 0.5 * (self.btc_m + self.bcc_m)

    @property
    def middle_out_m(self) -> float:
        """The middle of the transition at the end, m."""
        return 0.5 * (self.ecc_m + self.etc_m)

    def sd(self, name: str) -> float:
        """Return the sigma of a quantity by its name, in its unit. Raises ``KeyError`` for a name without one."""
        weights = _WEIGHTS[name] if name != "radius_m" else _WEIGHTS["curvature_1pm"] * self.radius_m**2
        used = np.flatnonzero(weights)
        return float(np.sqrt(weights[used] @ self.covariance[np.ix_(used, used)] @ weights[used]))


_UNIT = dict(zip(QUANTITIES, np.eye(len(QUANTITIES)), strict=True))
_WEIGHTS: dict[str, Array] = {
    **_UNIT,
    "length_in_m": _UNIT["bcc_m"] - _UNIT["btc_m"],
    "length_out_m": _UNIT["etc_m"] - _UNIT["ecc_m"],
    "arc_length_m": _UNIT["ecc_m"] - _UNIT["bcc_m"],
    "middle_in_m": 0.5 * (_UNIT["bcc_m"] + _UNIT["btc_m"]),
    "middle_out_m": 0.5 * (_UNIT["etc_m"] + _UNIT["ecc_m"]),
}

_MEASURED = (
    *POINTS,
    "radius_m",
    "curvature_1pm",
    "cant_mm",
    "length_in_m",
    "length_out_m",
    "arc_length_m",
    "middle_in_m",
    "middle_out_m",
)
CURVE_COLUMNS = (
    "id",
    "kind",
    "sense",
    "law_in",
    "law_out",
    "law_in_probability",
    "law_out_probability",
    *(column for name in _MEASURED for column in (name, f"{name}_sd")),
)
"""Columns of :func:`curve_table`."""


def curve_table(curves: Sequence[Curve]) -> pd.DataFrame:
    """Return a table of curves, one row each.

    Parameters
    ----------
    curves
        Curves of one line, as :func:`find_curves` returns them.

    Returns
    -------
    pandas.DataFrame
        Columns :data:`CURVE_COLUMNS`: places and lengths in m, radii in m, cant in mm, each with its 1-sigma.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.curves import curve_table, find_curves
    >>> table = curve_table(find_curves(trackfg.Result.read("out1").geometry))
    >>> len(table), list(table.columns)[:3]  # this run of a minute is on straight track
    (0, ['id', 'kind', 'sense'])
    """
    named = {field.name for field in fields(Curve)} | set(_MEASURED)
    rows = [
        {name: getattr(curve, name) if name in named else curve.sd(name.removesuffix("_sd")) for name in CURVE_COLUMNS}
        for curve in curves
    ]
    return pd.DataFrame(rows, columns=list(CURVE_COLUMNS))
