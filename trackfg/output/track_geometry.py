"""The geometry table: operators of :mod:`trackfg.geometry` applied to the smoothed profiles, with their sigmas.

Values come from each pass at the grid's step. Sigmas are the spread of the same operators over samples of the
profiles' joint posterior error (:mod:`trackfg.output.profile_samples`), taken on a coarser grid and averaged over a
short length: a twist has both ends' correlation in it, a versine that of three points. Those of chainage and of a
vehicle's own cross-level, which belong to one moment, are the marginal ones. Where the run passed a place more than
once, the longest pass counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TypeVar

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
from trackfg.output.profile_samples import PlaceErrors, PointErrors, PosteriorErrors
from trackfg.output.profiles import Profile, Shapes, View
from trackfg.output.trajectory import keyframe_variances
from trackfg.results.columns import GEOMETRY_COLUMNS, RAIL_COLUMNS
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.displacement import SIDES
from trackfg.solver.covariance import Covariance, posterior_samples
from trackfg.solver.square_root import SquareRoot

_Item = TypeVar("_Item")

_SAMPLES = 64
"""Draws of the posterior error: a sigma from n draws errs by ``1 / sqrt(2 n)``, 9 %."""

_COARSEST_M = 1.25
"""The sampled errors are smooth below this: the white noise of the inertial samples was integrated."""

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
    rng = np.random.default_rng(0)
    errors = PosteriorErrors.of(states, posterior_samples(root, _SAMPLES, rng)[0], rng)
    variance = keyframe_variances(states, covariance, run.lever_arm, run.mount_roll_sd)
    tables: list[pd.DataFrame] = []
    taken = np.zeros(0, dtype=np.int64)
    for profile in sorted(passes, key=len, reverse=True):
        free = ~np.isin(profile.cell, taken)
        if free.any():
            columns = _Columns(run, profile, errors, variance).all()
            tables.append(pd.DataFrame(columns, columns=names)[free])
            taken = np.concatenate([taken, profile.cell[free]])
    return pd.concat(tables, ignore_index=True).sort_values("chainage_m", ignore_index=True)


def reach_m(meaning: GeometryConventions) -> float:
    """Return how far from a place the values of its row depend on the profile, to either side, m."""
    band = end_margin_m(meaning.step_m, Band(*meaning.band_m))
    return max(band, meaning.twist_base_m, 0.5 * meaning.gradient_base_m, meaning.chord_m)


@dataclass(frozen=True)
class _Columns:
    """The columns of one pass."""

    run: RunContext
    profile: Profile
    errors: PosteriorErrors
    variance: Array

    @property
    def meaning(self) -> GeometryConventions:
        """What the columns mean."""
        return self.run.conventions

    def all(self) -> dict[str, Array]:
        profile, step = self.profile, self.meaning.step_m
        place = {"chainage_m": profile.cell * step, "speed_mps": profile.speed}
        values = self._points(profile.shapes, step) | self._bands(profile.shapes, step)
        sigmas = {**self._sampled(), **self._marginal()}
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

    def _points(self, shapes: Shapes, step_m: float) -> dict[str, Array]:
        """Return the quantities of one place or a few, in the columns' units, from shapes (..., n)."""
        meaning = self.meaning
        half, cross_level = 0.5 * meaning.chord_m, meaning.cross_level_base_m * shapes.tilt
        columns = {
            "curvature_1pm": curvature(shapes.heading, step_m, meaning.curvature_base_m),
            "gradient_permille": 1e3 * gradient(shapes.height, step_m, meaning.gradient_base_m),
            "cross_level_mm": 1e3 * cross_level,
            "twist_mm": 1e3 * twist(cross_level, step_m, meaning.twist_base_m, meaning.twist_anchor),
            "versine_level_mm": 1e3 * versine(shapes.height, step_m, half, half),
            "versine_alignment_mm": 1e3 * versine(shapes.lateral, step_m, half, half),
        }
        if shapes.gauge is not None:
            columns["gauge_mm"] = 1e3 * shapes.gauge
        return columns

    def _bands(self, shapes: Shapes, step_m: float) -> dict[str, Array]:
        """Return level and alignment in the band of wavelengths, of the centre line and of each rail."""
        band = Band(*self.meaning.band_m)
        lines = {"": (shapes.height, shapes.lateral)} | {f"_{side}": both for side, both in shapes.rails.items()}
        columns: dict[str, Array] = {}
        for name, (height, lateral) in lines.items():
            columns[f"level{name}_mm"] = 1e3 * band_pass(height, step_m, band)
            columns[f"alignment{name}_mm"] = 1e3 * band_pass(lateral, step_m, band)
        return columns

    def _marginal(self) -> dict[str, Array]:
        view = self.profile.views[0]
        k, f = view.points.keyframe, view.points.fraction
        at = self.variance[k] * (1.0 - f[:, None]) + self.variance[k + 1] * f[:, None]
        sigmas = {"chainage_m": np.sqrt(at[:, 0])}
        if not self.profile.shapes.rails:
            roll = at[:, 5] + self.run.noise.gyro[k, 0] ** 2 * np.diff(self.run.t)[k] * f * (1.0 - f)
            sigmas["cross_level_mm"] = 1e3 * self.meaning.cross_level_base_m * np.sqrt(roll)
        return sigmas

    def _sampled(self) -> dict[str, Array]:
        """Return sigmas for all rows, from every n-th row, by chunks that overlap by the operators' reach."""
        rows, every = len(self.profile), self._stride
        step = every * self.meaning.step_m
        total = -(-rows // every)
        chunk = max(1, int(_CHUNK_M / step))
        margin = int(np.ceil(4.0 * max(self.meaning.band_m[1], self.meaning.gradient_base_m) / step))
        # On the coarser grid white noise would look denser by the stride to a filter.
        below = self.profile.views[0].below * every**-0.5
        spans = [(max(0, start - margin), start, min(total, start + chunk)) for start in range(0, total, chunk)]
        drawn: Iterator[tuple[Shapes, Shapes]] = (
            self._drawn(slice(low * every, (min(total, end + margin) - 1) * every + 1, every)) for low, _, end in spans
        )
        if len(spans) > 1:
            drawn = _made_ahead(drawn)
        parts: dict[str, list[Array]] = {}
        for (low, start, end), (smooth, white) in zip(spans, drawn, strict=True):
            columns = self._points(_sum(smooth, white, 1.0), step) | self._bands(_sum(smooth, white, below), step)
            for name, samples in columns.items():
                variance = _averaged(np.mean(samples**2, axis=0), step, _AVERAGED_M)
                parts.setdefault(name, []).append(variance[start - low : end - low])
        coarse = np.arange(0, rows, every)
        return {
            name: np.interp(np.arange(rows), coarse, np.sqrt(np.concatenate(pieces))) for name, pieces in parts.items()
        }

    @property
    def _stride(self) -> int:
        """The coarsest stride that divides all bases and still shows the noise between keyframes."""
        meaning = self.meaning
        halves = (meaning.chord_m / 2, meaning.curvature_base_m / 2, meaning.gradient_base_m / 2)
        common = int(np.gcd.reduce([round(length / meaning.step_m) for length in (meaning.twist_base_m, *halves)]))
        apart = len(self.profile) / max(np.ptp(self.profile.views[0].points.keyframe), 1)
        limit = min(_COARSEST_M / meaning.step_m, 0.5 * apart)
        return max((n for n in range(1, common + 1) if common % n == 0 and n <= limit), default=1)

    def _drawn(self, rows: slice) -> tuple[Shapes, Shapes]:
        """Draw samples of the errors of some rows: those of the motion, and the white noise of displacement sensors."""
        views, step = self.profile.views, rows.step * self.meaning.step_m
        if views[0].side is None:
            path = PointErrors(self.run, views[0].points[rows], self.errors)
            (place,), angle = path.places(), path.angles()
            nothing = np.zeros_like(place.height)
            motion = Shapes(place.height, place.lateral, angle.tilt, angle.heading + place.turn / step)
            return motion, Shapes(nothing, nothing, nothing, nothing)
        units = groupby(views, key=lambda view: view.along_m)
        moved = [errors for _, unit in units for errors in self._passed(tuple(unit), rows)]

        def rails(heights: list[Array], laterals: list[Array]) -> Shapes:
            sides = {
                side: tuple(
                    np.mean([x for x, view in zip(values, views, strict=True) if view.side == side], axis=0)
                    for values in (heights, laterals)
                )
                for side in SIDES
            }
            (z_left, u_left), (z_right, u_right) = sides["left"], sides["right"]
            return Shapes(
                height=0.5 * (z_left + z_right),
                lateral=0.5 * (u_left + u_right),
                tilt=(z_left - z_right) / self.meaning.tops_apart_m,
                heading=np.gradient(0.5 * (u_left + u_right), step, axis=-1),
                rails={"left": (z_left, u_left), "right": (z_right, u_right)},
                gauge=u_left - u_right,
            )

        def noise(sd: Array) -> Array:
            return np.asarray(sd[rows] * self.errors.rng.standard_normal(moved[0].height.shape))

        smooth = rails([one.height for one in moved], [one.lateral for one in moved])
        white = rails([noise(view.up_sd) for view in views], [noise(view.across_sd) for view in views])
        slope = np.sqrt(sum(view.slope**2 * view.across_sd[rows] ** 2 for view in views)) / len(views)
        slope = np.hypot(slope, self._turning(rows, step))
        return smooth, replace(white, heading=slope * self.errors.rng.standard_normal(white.heading.shape))

    def _passed(self, unit: tuple[View, ...], rows: slice) -> list[PlaceErrors]:
        """Draw the errors of some rows of the rails under one unit, which are passed at the same time."""
        points = [view.points[rows] for view in unit]
        return PointErrors(self.run, points[0], self.errors).places(*(each.arm for each in points))

    def _turning(self, rows: slice, step_m: float) -> Array:
        """Return the sigma of the heading by what the gyro's noise turns units far from it within the fitted slope,
        less what differences over two of the samples' steps have of it.
        """
        views = [view for view in self.profile.views if view.side == "left"]
        speed = np.maximum(self.profile.speed[rows], _SLOWEST_MPS)
        variance = np.zeros(len(speed))
        for view in views:
            points = view.points[rows]
            ahead = points.arm[:, 0] * points.left[:, 1] - points.arm[:, 1] * points.left[:, 0]
            missing = max(view.walk**2 - 0.5 / step_m, 0.0)
            variance += missing * (ahead * self.run.noise.gyro[points.keyframe, 2] / len(views)) ** 2 / speed
        return np.sqrt(variance)


def _sum(smooth: Shapes, white: Shapes, share: float) -> Shapes:
    """Add both errors; the gauge has no part in the motion, which moves both rails alike."""
    return Shapes(
        height=smooth.height + share * white.height,
        lateral=smooth.lateral + share * white.lateral,
        tilt=smooth.tilt + share * white.tilt,
        heading=smooth.heading + share * white.heading,
        rails={
            side: (smooth.rails[side][0] + share * z, smooth.rails[side][1] + share * u)
            for side, (z, u) in white.rails.items()
        },
        gauge=white.gauge,
    )


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
