"""The geometry table: operators of :mod:`trackfg.geometry` applied to the smoothed profiles, with their sigmas.

Values come from each pass at the grid's step. Sigmas are the spread of the same operators over samples of the
profiles' joint posterior error (:mod:`trackfg.output.profile_samples`), taken on a coarser grid and averaged over a
short length: a twist has both ends' correlation in it, a versine that of three points. Those of chainage and of a
vehicle's own cross-level, which belong to one moment, are the marginal ones. Where the run passed a place more than
once, the longest pass counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, groupby
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from trackfg.factors.states import States
from trackfg.geometry.bands import Band, band_pass, end_margin_m
from trackfg.geometry.curvature import curvature
from trackfg.geometry.gradient import gradient
from trackfg.geometry.twist import twist
from trackfg.geometry.versines import versine
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import ThreadBeside
from trackfg.numerics.float_table import float_table
from trackfg.output.normal_draws import NormalDraws
from trackfg.output.profile_samples import PointErrors, PosteriorErrors, Shifts
from trackfg.output.profiles import Profile, Shapes, View
from trackfg.output.trajectory import keyframe_variances
from trackfg.results.columns import GEOMETRY_COLUMNS, RAIL_COLUMNS
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.displacement import SIDES, Side
from trackfg.solver.covariance import Covariance, posterior_samples
from trackfg.solver.square_root import SquareRoot

_Item = TypeVar("_Item")

Lines = Mapping[str, tuple[Array, Array]]
"""Heights and lateral positions (..., n) of lines that are taken to bands, by the ends of their columns' names."""

_SAMPLES = 64
"""Draws of the posterior error: a sigma from n draws errs by ``1 / sqrt(2 n)``, 9 %."""

_AVERAGED_M = 10.0
"""Sigmas are averaged over this: 64 samples alone know a sigma to 9 %. Near a stop they change within some metres."""

_SLOWEST_MPS = 0.05
"""At a crawl the gyro's noise per metre counts as at this speed, m/s."""

_CHUNK_M = 10_000.0
"""Track that is sampled at a time, m: bounds the memory, changes nothing else."""

_SHORT_WAVES = 0.05
"""rad/m: what the heading of a lateral profile misses of waves below 5 m, per alignment there is (rms over
``_TYPICAL_M``), as measured on tracks of the German spectra, and at both ends of the curvature's base.
"""
_TYPICAL_M = 200.0
"""The alignment whose short waves are missed is averaged over this, m."""


def geometry_table(
    run: RunContext,
    passes: list[Profile],
    states: States,
    covariance: Covariance,
    root: SquareRoot,
) -> pd.DataFrame:
    """Return one row per step of chainage passed, ascending: columns :data:`trackfg.results.columns.GEOMETRY_COLUMNS`,
    and
    :data:`~trackfg.results.columns.RAIL_COLUMNS` where the profiles have rails.
    """
    with_rails = any(profile.shapes.rails for profile in passes)
    names = [*GEOMETRY_COLUMNS, *(RAIL_COLUMNS if with_rails else ())]
    if not passes:
        return pd.DataFrame(columns=names, dtype=np.float64)
    variance = keyframe_variances(states, covariance, run.lever_arm, run.mount_roll_sd)
    parts: list[tuple[_Columns, np.ndarray]] = []
    taken = np.zeros(0, dtype=np.int64)
    for profile in sorted(passes, key=len, reverse=True):
        free = ~np.isin(profile.cell, taken)
        if free.any():
            parts.append((_Columns(run, profile, variance), free))
            taken = np.concatenate([taken, profile.cell[free]])
    rng = NormalDraws()
    errors = PosteriorErrors.of(states, posterior_samples(root, _SAMPLES, rng), rng)
    sampled = [columns.sampled(errors) for columns, _ in parts]
    del errors  # the tables need its memory
    tables: list[pd.DataFrame] = []
    for (columns, free), sigmas in zip(parts, sampled, strict=True):
        of_pass, unknown = columns.all(sigmas), np.full(len(free), np.nan)
        table = float_table({name: of_pass.get(name, unknown) for name in names})
        tables.append(table if free.all() else table[free])
    if len(tables) == 1:
        return tables[0]  # one pass ascends, and no row of it is left out
    return pd.concat(tables, ignore_index=True).sort_values("chainage_m", ignore_index=True)


def reach_m(meaning: GeometryConventions) -> float:
    """Return how far from a place the values of its row depend on the profile, to either side, m."""
    band = end_margin_m(meaning.step_m, Band(*meaning.band_m))
    return max(band, meaning.twist_base_m, 0.5 * meaning.gradient_base_m, meaning.chord_m)


class _Drawn(NamedTuple):
    """Samples of the errors of shapes and of lines, (count, n) each."""

    shapes: Shapes
    lines: Lines


@dataclass(frozen=True)
class _Columns:
    """The columns of one pass."""

    run: RunContext
    profile: Profile
    variance: Array

    @property
    def meaning(self) -> GeometryConventions:
        """The meaning of the columns."""
        return self.run.conventions

    def all(self, sampled: Mapping[str, Array]) -> dict[str, Array]:
        """Return the columns by their names, with the sigmas that were sampled."""
        profile, step = self.profile, self.meaning.step_m
        place = {"chainage_m": profile.cell * step, "speed_mps": profile.speed}
        shapes = profile.shapes
        lines = {"": (shapes.height, shapes.lateral)} | {f"_{side}": rail for side, rail in shapes.rails.items()}
        values = dict([*self._points(shapes, step), *self._bands(lines, step)])
        sigmas = {**sampled, **self._marginal()}
        if profile.shapes.rails:
            short = np.sqrt(_averaged((1e-3 * values["alignment_mm"]) ** 2, step, _TYPICAL_M))
            missed = _SHORT_WAVES * short / self.meaning.curvature_base_m
            sigmas["curvature_1pm"] = np.hypot(sigmas["curvature_1pm"], missed)
            # A pass too short for any alignment does not say what its curvature misses.
            values["curvature_1pm"] = np.where(np.isnan(missed), np.nan, values["curvature_1pm"])
            offset = 1e3 * self.meaning.cross_level_base_m * self.run.mount_roll_sd
            sigmas["cross_level_mm"] = np.hypot(sigmas["cross_level_mm"], offset)
        columns = place | values
        sd_columns = {f"{name}_sd": np.where(np.isnan(columns[name]), np.nan, sd) for name, sd in sigmas.items()}
        return columns | sd_columns

    def _points(self, shapes: Shapes, step_m: float) -> Iterator[tuple[str, Array]]:
        """Yield the quantities of one place or a few, in the columns' units, from shapes (..., n)."""
        meaning = self.meaning
        half = 0.5 * meaning.chord_m
        yield "curvature_1pm", curvature(shapes.heading, step_m, meaning.curvature_base_m)
        yield "gradient_permille", 1e3 * gradient(shapes.height, step_m, meaning.gradient_base_m)
        cross_level = meaning.cross_level_base_m * shapes.tilt
        yield "cross_level_mm", 1e3 * cross_level
        yield "twist_mm", 1e3 * twist(cross_level, step_m, meaning.twist_base_m, meaning.twist_anchor)
        yield "versine_level_mm", 1e3 * versine(shapes.height, step_m, half, half)
        yield "versine_alignment_mm", 1e3 * versine(shapes.lateral, step_m, half, half)
        if shapes.gauge is not None:
            yield "gauge_mm", 1e3 * shapes.gauge

    def _bands(self, lines: Lines, step_m: float) -> Iterator[tuple[str, Array]]:
        """Yield level and alignment in the band of wavelengths, of lines with height and lateral position (..., n).

        Where there is no centre line it is the mean of both rails, and so is its band.
        """
        band = Band(*self.meaning.band_m)
        for i, quantity in enumerate(("level", "alignment")):
            bands = {name: 1e3 * band_pass(line[i], step_m, band) for name, line in lines.items()}
            yield from ((f"{quantity}{name}_mm", values) for name, values in bands.items())
            if "" not in bands:
                left, right = bands.values()
                yield f"{quantity}_mm", 0.5 * (left + right)

    def _marginal(self) -> dict[str, Array]:
        k, f = self.profile.keyframe, self.profile.fraction
        at = self.variance[k] * (1.0 - f[:, None]) + self.variance[k + 1] * f[:, None]
        sigmas = {"chainage_m": np.sqrt(at[:, 0])}
        if not self.profile.shapes.rails:
            roll = at[:, 5] + self.run.noise.gyro[k, 0] ** 2 * np.diff(self.run.t)[k] * f * (1.0 - f)
            sigmas["cross_level_mm"] = 1e3 * self.meaning.cross_level_base_m * np.sqrt(roll)
        return sigmas

    def sampled(self, errors: PosteriorErrors) -> dict[str, Array]:
        """Return sigmas for all rows, from every n-th row, by chunks that overlap by the operators' reach."""
        rows, every = len(self.profile), self.profile.every
        step = every * self.meaning.step_m
        total = -(-rows // every)
        chunk = max(1, int(_CHUNK_M / step))
        margin = int(np.ceil(4.0 * max(self.meaning.band_m[1], self.meaning.gradient_base_m) / step))
        # On the coarser grid white noise would look denser by the stride to a filter.
        below = self.profile.views[0].below * every**-0.5
        spans = [(max(0, start - margin), start, min(total, start + chunk)) for start in range(0, total, chunk)]
        drawn: Iterator[_Drawn] = (
            self._drawn(errors, slice(low, min(total, end + margin)), step, below) for low, _, end in spans
        )
        if len(spans) > 1:
            drawn = _made_ahead(drawn)
        parts: dict[str, list[Array]] = {}
        for (low, start, end), (shapes, lines) in zip(spans, drawn, strict=True):
            for name, samples in chain(self._points(shapes, step), self._bands(lines, step)):
                variance = _averaged(np.einsum("sm,sm->m", samples, samples) / len(samples), step, _AVERAGED_M)
                parts.setdefault(name, []).append(variance[start - low : end - low])
        coarse = np.arange(0, rows, every)
        return {
            name: np.interp(np.arange(rows), coarse, np.sqrt(np.concatenate(pieces))) for name, pieces in parts.items()
        }

    def _drawn(self, errors: PosteriorErrors, rows: slice, step_m: float, below: float) -> _Drawn:
        """Draw samples of the errors of some of the views' rows, which are ``step_m`` apart, with noise in the lines
        that is ``below`` times as large.
        """
        if self.profile.shapes.rails:
            return self._drawn_rails(errors, rows, step_m, below)
        path = PointErrors(self.run, self.profile.views[0].points[rows], errors)
        place, angle = path.places(), path.angles()
        heading = angle.heading + place.turn / step_m
        return _Drawn(Shapes(place.height, place.lateral, angle.tilt, heading), {"": (place.height, place.lateral)})

    def _drawn_rails(self, errors: PosteriorErrors, rows: slice, step_m: float, below: float) -> _Drawn:
        """Draw the errors of the motion, and add the white noise of the displacement sensors."""
        views, rng, left = self.profile.views, errors.rng, self.profile.views[0].points.left[rows]
        share: dict[Side | None, float] = {side: 1.0 / sum(view.side == side for view in views) for side in SIDES}
        moved: dict[Side | None, Shifts] = {side: Shifts.none(len(left), errors.count) for side in SIDES}
        for _, unit in groupby(views, key=lambda view: view.along_m):
            under_unit = list(unit)  # passed at the same time
            passage = PointErrors(self.run, under_unit[0].points[rows], errors)
            for view in under_unit:
                passage.add_to(moved[view.side], view.points.arm[rows], share[view.side])
        smooth = {side: moved.pop(side).along(left) for side in SIDES}

        def noise(sd_of: Callable[[View], Array]) -> dict[Side | None, Array]:
            total: dict[Side | None, Array] = {side: np.zeros_like(place.height) for side, place in smooth.items()}
            for view in views:
                drawn = rng.standard_normal(total[view.side].shape)
                drawn *= share[view.side] * sd_of(view)[rows]
                total[view.side] += drawn
            return total

        up, across = noise(lambda view: view.up_sd), noise(lambda view: view.across_sd)
        slope = np.sqrt(sum(view.slope**2 * view.across_sd[rows] ** 2 for view in views)) / len(views)
        heading = rng.standard_normal(smooth["left"].height.shape)
        heading *= np.hypot(slope, self._turning(rows, step_m))
        heading += np.gradient(0.5 * (smooth["left"].lateral + smooth["right"].lateral), step_m, axis=-1)
        z_left, z_right = (smooth[side].height + up[side] for side in SIDES)
        u_left, u_right = (smooth[side].lateral + across[side] for side in SIDES)
        shapes = Shapes(
            height=0.5 * (z_left + z_right),
            lateral=0.5 * (u_left + u_right),
            tilt=(z_left - z_right) / self.meaning.tops_apart_m,
            heading=heading,
            gauge=across["left"] - across["right"],  # the motion moves both rails alike
        )
        for side, place in smooth.items():
            for part, white in zip(place[:2], (up[side], across[side]), strict=True):
                white *= below
                part += white
        return _Drawn(shapes, {f"_{side}": (place.height, place.lateral) for side, place in smooth.items()})

    def _turning(self, rows: slice, step_m: float) -> Array:
        """Return the sigma of the heading by what the gyro's noise turns units far from it within the fitted slope,
        less what differences over two of the samples' steps have of it.
        """
        views = [view for view in self.profile.views if view.side == "left"]
        speed = np.maximum(self.profile.speed[:: self.profile.every][rows], _SLOWEST_MPS)
        variance = np.zeros(len(speed))
        for view in views:
            points = view.points[rows]
            ahead = points.arm[:, 0] * points.left[:, 1] - points.arm[:, 1] * points.left[:, 0]
            missing = max(view.walk**2 - 0.5 / step_m, 0.0)
            variance += missing * (ahead * self.run.noise.gyro[points.keyframe, 2] / len(views)) ** 2 / speed
        return np.sqrt(variance)


def _made_ahead(items: Iterator[_Item]) -> Iterator[_Item]:
    """Yield items in their order, each made by a thread while the one before is used."""

    def made() -> _Item | None:
        return next(items, None)

    with ThreadBeside() as thread:
        ahead = thread.begin(made)
        while (item := ahead.result()) is not None:
            ahead = thread.begin(made)
            yield item


def _averaged(variance: Array, step_m: float, length_m: float) -> Array:
    """Return the running mean of the finite values; ends take the nearest one."""
    known = np.isfinite(variance)
    if not known.any():
        return variance
    width = max(1, round(length_m / step_m))
    filled = np.interp(np.arange(variance.size), np.flatnonzero(known), variance[known])
    return np.asarray(uniform_filter1d(filled, width, mode="nearest"))
