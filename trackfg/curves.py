"""Curves of a line from its smoothed curvature and cross-level: chainages, radii, laws, cants, each with its sigma.

The designed line is straights, circles and transitions; the profile is that plus irregularities, which are far larger
than the smoother's own errors and set the sigmas. See docs/curves.md.

Facing increasing chainage, a curve has BTC, BCC, ECC and ETC: begin of transition, begin and end of the circular curve,
end of transition. In a compound curve the transition between two parts is the exit of one and the entry of the next.
Where the profile begins or ends within a curve, the points beyond it are NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
import pandas as pd
from scipy.stats import chi2 as chi_squared

from trackfg.curve_fit import Fit, Stretch, fitted
from trackfg.curve_laws import LawTrial, law_spread, law_trial, law_weights, with_likeliest_laws
from trackfg.curve_model import CurveChain, tilts, turns
from trackfg.curve_segments import Cells, cells_of, first_chains
from trackfg.curve_structure import simplified, structured
from trackfg.frames import Array
from trackfg.increment_noise import IncrementNoise, fitted_noise
from trackfg.transition_laws import TransitionLaw

CurveKind = Literal["simple", "compound part", "reverse part", "compound and reverse part"]
CurveLaw = TransitionLaw | Literal["none", "unseen"]

POINTS = ("btc_m", "bcc_m", "ecc_m", "etc_m")
QUANTITIES = (*POINTS, "curvature_1pm", "cant_mm")
"""What :attr:`Curve.covariance` refers to, in this order."""

_AROUND_M = 300.0
_SHORTEST_AROUND_M = 80.0
_CLEAR_M = 15.0
_TURN_FLOOR_RAD = 2e-6
_TILT_FLOOR_MM = 1e-3
_SHARED_ABOVE = 1e-4
_LEAST_CLEAR = 0.2
_ANYTHING = 1e3


@dataclass(frozen=True)
class Curve:
    """A circular curve and its transitions. ``id`` counts from 1 in order of chainage.

    ``sense`` faces increasing chainage; ``curvature_1pm`` is positive to the left; ``cant_mm`` raises the outer rail.
    ``covariance`` (6, 6) is that of :data:`QUANTITIES`, NaN for what is not known: neighbouring points err together,
    and the middle of a transition is known far better than its ends. ``law_in_probability`` and ``law_out_probability``
    say how sure the laws are. A law is "none" without transition and "unseen" beyond the profile's ends.
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
        """Positive."""
        return 1.0 / abs(self.curvature_1pm)

    @property
    def length_in_m(self) -> float:
        """Of the transition at the begin."""
        return self.bcc_m - self.btc_m

    @property
    def length_out_m(self) -> float:
        """Of the transition at the end."""
        return self.etc_m - self.ecc_m

    @property
    def middle_in_m(self) -> float:
        """Of the transition at the begin: the best-known point of the curve's begin."""
        return 0.5 * (self.btc_m + self.bcc_m)

    @property
    def middle_out_m(self) -> float:
        """Of the transition at the end."""
        return 0.5 * (self.ecc_m + self.etc_m)

    def sd(self, name: str) -> float:
        """The 1-sigma of a quantity by its name, in its unit. Raises ``KeyError`` for a name without one."""
        weights = _WEIGHTS[name] if name != "radius_m" else _WEIGHTS["curvature_1pm"] * self.radius_m**2
        used = np.flatnonzero(weights)
        return float(np.sqrt(weights[used] @ self.covariance[np.ix_(used, used)] @ weights[used]))


_UNIT = dict(zip(QUANTITIES, np.eye(len(QUANTITIES)), strict=True))
_WEIGHTS: dict[str, Array] = {
    **_UNIT,
    "length_in_m": _UNIT["bcc_m"] - _UNIT["btc_m"],
    "length_out_m": _UNIT["etc_m"] - _UNIT["ecc_m"],
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


def find_curves(profile: pd.DataFrame, *, base_m: float = 10.0, widest_radius_m: float = 10_000.0) -> list[Curve]:
    """The curves of a profile, in order of chainage.

    ``profile`` has ``chainage_m`` ascending in uniform steps, ``curvature_1pm`` over ``base_m`` and its ``_sd``, and
    perhaps ``cross_level_mm``: a result's geometry table. Rows may be missing or NaN. What is wider than
    ``widest_radius_m`` is held to be straight. Sigmas refer to the profile's own chainage: that of the chainage itself
    is not in them. Raises :class:`~trackfg.errors.BadInputError` for a profile without these columns or this grid.
    """
    lines = [_Line(cells, tuple(first_chains(cells, widest_radius_m))) for cells in cells_of(profile, base_m)]
    if not any(line.chains for line in lines):
        return []
    noise = _noise(lines, guessed=True)
    lines = [line.structured(noise, widest_radius_m) for line in lines]
    noise = _noise(lines, guessed=False)
    groups = [
        _group(chain, line.stretch(k, noise, True), widest_radius_m)
        for line in lines
        for k, chain in enumerate(line.chains)
    ]
    found = [group for group in groups if group is not None]
    weights = law_weights([group.trial for group in found])
    found = [group.relawed(w) for group, w in zip(found, weights, strict=True)]
    weights = law_weights([group.trial for group in found])
    curves = [curve for group, w in zip(found, weights, strict=True) for curve in _curves(group, w)]
    return [replace(curve, id=number) for number, curve in enumerate(curves, start=1)]


def curve_table(curves: Sequence[Curve]) -> pd.DataFrame:
    """One row per curve, columns :data:`CURVE_COLUMNS`."""
    named = {field.name for field in fields(Curve)} | set(_MEASURED)
    rows = [
        {name: getattr(curve, name) if name in named else curve.sd(name.removesuffix("_sd")) for name in CURVE_COLUMNS}
        for curve in curves
    ]
    return pd.DataFrame(rows, columns=list(CURVE_COLUMNS))


@dataclass(frozen=True)
class _Noise:
    turn: IncrementNoise
    tilt: IncrementNoise | None


@dataclass(frozen=True)
class _Line:
    """Cells without a gap, and the groups of curves on them."""

    cells: Cells
    chains: tuple[CurveChain, ...]

    def residuals(self) -> Array:
        """Turns that the chains do not explain. Shape (n,)."""
        out = self.cells.turn.copy()
        for k, chain in enumerate(self.chains):
            rows = self._rows(k, overlapping=False)
            out[rows] -= turns(chain, self.cells.edges[rows.start : rows.stop + 2])[0]
        return out

    def clear(self) -> np.ndarray:
        """Cells away from all curves."""
        free = np.ones(len(self.cells.turn), dtype=bool)
        x = self.cells.centres
        for chain in self.chains:
            low = chain.points[0] if chain.straight[0] else -np.inf
            high = chain.points[-1] if chain.straight[-1] else np.inf
            free &= (x < low - 2 * self.cells.base_m) | (x > high + 2 * self.cells.base_m)
        return free

    def stretch(self, k: int, noise: _Noise, with_tilt: bool) -> Stretch:
        """Group k and what of the straights beside it is near."""
        rows, cells = self._rows(k, overlapping=True), self.cells
        edges, known = cells.edges[rows.start : rows.stop + 2], cells.turn_known[rows]
        stretch = Stretch(edges, cells.turn[rows], noise.turn.whitener(known))
        if not with_tilt or noise.tilt is None or cells.cross_level is None or cells.cross_level_known is None:
            return stretch
        tilt = np.diff(cells.cross_level[rows])
        white = noise.tilt.whitener(np.zeros(len(tilt)))
        return replace(stretch, tilt=tilt, tilt_white=white, cross_level_known=cells.cross_level_known[rows])

    def structured(self, noise: _Noise, widest_radius_m: float) -> _Line:
        """With the chains that the curvature shows."""
        stretches = [self.stretch(k, noise, False) for k in range(len(self.chains))]
        fits = [structured(c, stretch, widest_radius_m) for c, stretch in zip(self.chains, stretches, strict=True)]
        return replace(self, chains=tuple(fit.chain for fit in fits if fit is not None))

    def _rows(self, k: int, *, overlapping: bool) -> slice:
        """The cells of group k: to the next groups if ``overlapping``, else to half way there."""
        x = self.cells.centres
        chain = self.chains[k]
        low, high = -np.inf, np.inf
        share = 1.0 if overlapping else 0.5
        clear = _CLEAR_M if overlapping else 0.0
        if chain.straight[0]:
            low = chain.points[0] - _AROUND_M if overlapping else -np.inf
            if k > 0:
                before = self.chains[k - 1].points[-1]
                low = max(low, chain.points[0] - share * (chain.points[0] - before) + clear)
        if chain.straight[-1]:
            high = chain.points[-1] + _AROUND_M if overlapping else np.inf
            if k + 1 < len(self.chains):
                after = self.chains[k + 1].points[0]
                high = min(high, chain.points[-1] + share * (after - chain.points[-1]) - clear)
        # Neighbours that were pulled over each other keep what is their own.
        low, high = min(low, chain.points[0]), max(high, chain.points[-1])
        rows = np.flatnonzero((x >= low) & (x < high))
        return slice(int(rows[0]), int(rows[-1]) + 1)


def _noise(lines: Sequence[_Line], *, guessed: bool) -> _Noise:
    """From what the curves leave over; from the straights alone of curves that are only guessed, and of cross-level,
    whose cants are not known yet. Increments left out count as not measured: their walk may be anything.
    """
    turn, tilt = [], []
    for line in lines:
        clear = line.clear()
        if clear.mean() < _LEAST_CLEAR:
            clear[:] = True
        turn.append(_masked(line.residuals(), line.cells.turn_known, clear if guessed else np.ones_like(clear)))
        if line.cells.cross_level is not None:
            steps = np.diff(line.cells.cross_level)
            tilt.append(_masked(steps, np.zeros(len(steps)), clear[1:] & clear[:-1]))
    return _Noise(
        fitted_noise(turn, _TURN_FLOOR_RAD),
        fitted_noise(tilt, _TILT_FLOOR_MM) if tilt and not guessed else None,
    )


def _masked(residuals: Array, known: Array, used: np.ndarray) -> tuple[Array, Array]:
    anything = _ANYTHING * (float(np.var(residuals[used])) + _TURN_FLOOR_RAD**2 + float(known.max()))
    return np.where(used, residuals, 0.0), np.where(used, known, anything)


@dataclass(frozen=True)
class _Group:
    """A group of curves with its laws on trial. ``cants`` are those of a fit of their own, where the cant's ramps are
    elsewhere than the transitions; ``trial`` is then that of the curvature alone.
    """

    trial: LawTrial
    stretch: Stretch
    cants: Fit | None

    def relawed(self, weights: Array) -> _Group:
        return replace(self, trial=with_likeliest_laws(self.trial, weights, self.stretch))


def _group(chain: CurveChain, stretch: Stretch, widest_radius_m: float) -> _Group | None:
    bare = stretch.without_tilt()
    alone = structured(chain, bare, widest_radius_m)
    if alone is None:
        return None
    if stretch.tilt is None or not any(alone.chain.straight):
        return _Group(law_trial(alone, bare), bare, None)
    seeded = _with_cant(alone.chain, stretch)
    together = fitted(seeded, stretch)
    apart = _cant_alone(seeded, stretch)
    excess = together.chi2 / together.scale - (alone.chi2 + apart.chi2) / together.scale
    limit = float(chi_squared.isf(_SHARED_ABOVE, len(alone.chain.places)))
    if excess < limit and np.all(np.diff(together.chain.points) >= 0.0):
        return _Group(law_trial(simplified(together, stretch, widest_radius_m), stretch), stretch, None)
    return _Group(law_trial(alone, bare), bare, apart)


def _with_cant(chain: CurveChain, stretch: Stretch) -> CurveChain:
    """With the cants that fit the cross-level best, the ramps where the transitions are."""
    assert stretch.tilt is not None
    assert stretch.tilt_white is not None
    slopes = stretch.tilt_white(tilts(chain, stretch.tilt_edges)[1][:, len(chain.places) :])
    cants = np.linalg.lstsq(slopes, stretch.tilt_white(stretch.tilt), rcond=1e-10)[0]
    cant = chain.cant.copy()
    cant[chain.curved] = cants
    return replace(chain, cant=cant)


def _cant_alone(chain: CurveChain, stretch: Stretch) -> Fit:
    """The cant's levels and ramps wherever they fit the cross-level best."""
    return fitted(chain, replace(stretch, turn=None))


def _curves(group: _Group, weights: Array) -> list[Curve]:
    """The curves of a group, their ids still to come."""
    trial = group.trial
    chain, shared = trial.fit.chain, group.stretch.tilt is not None
    covariance = trial.fit.covariance + law_spread(trial, weights)
    sure = dict(zip(trial.transitions, weights.max(axis=1), strict=True))
    p, c = len(chain.places), len(chain.curved)
    curves = []
    for k, level in enumerate(chain.curved):
        sign = float(np.sign(chain.curvature[level]))
        values, of_parameter = np.full(6, np.nan), np.zeros((6, len(covariance)))
        for transition, first in ((level - 1, 0), (level, 2)):
            if 0 <= transition < len(chain.laws):
                ends = [chain.begin[transition], chain.end[transition]]
                values[first : first + 2] = chain.places[ends]
                of_parameter[[first, first + 1], ends] = 1.0
        values[4] = chain.curvature[level]
        of_parameter[4, p + k] = 1.0
        cant_variance = 0.0
        if shared:
            values[5] = -sign * chain.cant[level]
            of_parameter[5, p + c + k] = -sign
        elif group.cants is not None:
            values[5] = -sign * group.cants.chain.cant[level]
            cant_variance = float(group.cants.covariance[p + c + k, p + c + k])
        uncertain = of_parameter @ covariance @ of_parameter.T
        uncertain[5, 5] += cant_variance + _profile_variance(group.stretch, values[:4])
        unknown = np.isnan(values)
        uncertain[unknown, :] = uncertain[:, unknown] = np.nan
        law_in, law_out = _law(chain, int(level) - 1), _law(chain, int(level))
        curves.append(
            Curve(
                id=0,
                kind=_kind(chain, int(level)),
                sense="left" if sign > 0.0 else "right",
                **dict(zip(QUANTITIES, values.tolist(), strict=True)),
                law_in=law_in,
                law_out=law_out,
                law_in_probability=float(sure.get(int(level) - 1, 1.0 if law_in == "none" else np.nan)),
                law_out_probability=float(sure.get(int(level), 1.0 if law_out == "none" else np.nan)),
                covariance=uncertain,
            )
        )
    return curves


def _profile_variance(stretch: Stretch, points: Array) -> float:
    """By how much more the profile's own cross-level is uncertain in the curve than beside it, mm^2.

    What it does not know on the straight either is the sensor's offset, which a cant has not.
    """
    if stretch.cross_level_known is None:
        return 0.0
    middle = float(np.nanmean(points[1:3]))
    here = float(np.interp(middle, stretch.edges[1:-1], stretch.cross_level_known))
    return here - float(stretch.cross_level_known.min())


def _law(chain: CurveChain, transition: int) -> CurveLaw:
    if not 0 <= transition < len(chain.laws):
        return "unseen"
    return "none" if chain.begin[transition] == chain.end[transition] else chain.laws[transition]


def _kind(chain: CurveChain, level: int) -> CurveKind:
    last = len(chain.straight) - 1
    beside = [i for i in (level - 1, level + 1) if 0 <= i <= last]
    compound = any(not chain.straight[i] for i in beside)
    before = level > 1 and chain.straight[level - 1] and chain.end[level - 2] == chain.begin[level - 1]
    after = level + 1 < last and chain.straight[level + 1] and chain.end[level] == chain.begin[level + 1]
    # Straights without length lie between curves of opposite sign, and may between those of one.
    reverse = (before and chain.curvature[level - 2] * chain.curvature[level] < 0.0) or (
        after and chain.curvature[level + 2] * chain.curvature[level] < 0.0
    )
    kinds: dict[tuple[bool, bool], CurveKind] = {
        (False, False): "simple",
        (True, False): "compound part",
        (False, True): "reverse part",
        (True, True): "compound and reverse part",
    }
    return kinds[compound, bool(reverse)]
