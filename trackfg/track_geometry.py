"""The geometry table: operators of :mod:`trackfg.geometry` applied to the smoothed profiles, with their sigmas.

Values come from each pass at the grid's step. Sigmas of what needs several places at once (twist, versines, bands,
gradient, curvature) are the spread of the same operators over samples of the profiles' joint posterior error, taken on
a coarser grid and averaged over a short length; those of chainage and cross-level, which belong to one place, are the
marginal ones. Where the run passed a place more than once, the longest pass counts.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from trackfg.config import GeometryConfig
from trackfg.covariance import Covariance, SquareRoot, posterior_samples
from trackfg.dense import DenseMotion
from trackfg.description import Track
from trackfg.factors.states import States
from trackfg.frames import Array
from trackfg.geometry.bands import Band, band_pass
from trackfg.geometry.curvature import curvature
from trackfg.geometry.gradient import gradient
from trackfg.geometry.twist import twist
from trackfg.geometry.versines import versine
from trackfg.graph import Problem
from trackfg.profile import PosteriorErrors, Profile, profile_samples, profiles
from trackfg.results import GEOMETRY_COLUMNS, GeometryConventions
from trackfg.trajectory import keyframe_variances

_SAMPLES = 64
_COARSEST_M = 1.25
"""The sampled errors are smooth below this: the white noise of the sensors was integrated."""

_AVERAGED_M = 25.0
"""Sigmas are averaged over this: 64 samples alone know a sigma to 9 %."""

_CHUNK_M = 10_000.0


def conventions(config: GeometryConfig, track: Track) -> GeometryConventions:
    """What the columns will mean."""
    return GeometryConventions(
        gauge_m=track.gauge_m, cross_level_base_m=track.cross_level_base_m, **config.model_dump()
    )


def geometry_table(
    problem: Problem,
    motion: DenseMotion,
    states: States,
    covariance: Covariance,
    root: SquareRoot,
    track: Track,
    meaning: GeometryConventions,
) -> pd.DataFrame:
    """One row per step of chainage passed, ascending, columns :data:`trackfg.results.GEOMETRY_COLUMNS`."""
    passes = profiles(problem, motion, states, track.direction, meaning.step_m)
    rng = np.random.default_rng(0)
    errors = PosteriorErrors.of(states, posterior_samples(root, _SAMPLES, rng), rng)
    variance = keyframe_variances(states, covariance, problem.lever_arm)
    tables: list[pd.DataFrame] = []
    taken = np.zeros(0, dtype=np.int64)
    for profile in passes:
        free = ~np.isin(profile.cell, taken)
        if free.any():
            columns = _values(profile, meaning) | _sigmas(problem, profile, errors, variance, meaning)
            tables.append(pd.DataFrame(columns, columns=list(GEOMETRY_COLUMNS))[free])
            taken = np.concatenate([taken, profile.cell[free]])
    if not tables:
        return pd.DataFrame(columns=list(GEOMETRY_COLUMNS), dtype=np.float64)
    return pd.concat(tables, ignore_index=True).sort_values("chainage_m", ignore_index=True)


def _values(profile: Profile, meaning: GeometryConventions) -> dict[str, Array]:
    step = meaning.step_m
    place = {"chainage_m": profile.cell * step, "speed_mps": profile.speed}
    level = {"cross_level_mm": 1e3 * meaning.cross_level_base_m * profile.tilt}
    return place | level | _extended(profile.height, profile.lateral, profile.heading, profile.tilt, step, meaning)


def _extended(
    height: Array, lateral: Array, heading: Array, tilt: Array, step_m: float, meaning: GeometryConventions
) -> dict[str, Array]:
    """What needs more than one place, from profiles (..., n)."""
    half, band = 0.5 * meaning.chord_m, Band(*meaning.band_m)
    return {
        "curvature_1pm": curvature(heading, step_m, meaning.curvature_base_m),
        "gradient_permille": 1e3 * gradient(height, step_m, meaning.gradient_base_m),
        "twist_mm": 1e3 * twist(meaning.cross_level_base_m * tilt, step_m, meaning.twist_base_m),
        "level_mm": 1e3 * band_pass(height, step_m, band),
        "alignment_mm": 1e3 * band_pass(lateral, step_m, band),
        "versine_level_mm": 1e3 * versine(height, step_m, half, half),
        "versine_alignment_mm": 1e3 * versine(lateral, step_m, half, half),
    }


def _sigmas(
    problem: Problem, profile: Profile, errors: PosteriorErrors, variance: Array, meaning: GeometryConventions
) -> dict[str, Array]:
    k, f = profile.keyframe, profile.fraction
    marginal = variance[k] * (1.0 - f[:, None]) + variance[k + 1] * f[:, None]
    roll = marginal[:, 5] + problem.noise.gyro**2 * np.diff(problem.t)[k] * f * (1.0 - f)
    sigmas = {
        "chainage_m_sd": np.sqrt(marginal[:, 0]),
        "cross_level_mm_sd": 1e3 * meaning.cross_level_base_m * np.sqrt(roll),
    }
    every = _coarse(profile, meaning)
    spread = _spread(problem, profile, errors, every, meaning)
    coarse = np.arange(0, len(profile), every)
    for name, sd in spread.items():
        sigmas[f"{name}_sd"] = np.interp(np.arange(len(profile)), coarse, sd)
    values = _values(profile, meaning)
    return {name: np.where(np.isnan(values[name.removesuffix("_sd")]), np.nan, sd) for name, sd in sigmas.items()}


def _coarse(profile: Profile, meaning: GeometryConventions) -> int:
    """The coarsest stride that all bases are multiples of and that still shows the noise between keyframes."""
    lengths = (meaning.twist_base_m, meaning.chord_m / 2, meaning.curvature_base_m / 2, meaning.gradient_base_m / 2)
    common = int(np.gcd.reduce([round(length / meaning.step_m) for length in lengths]))
    apart = len(profile) / max(np.ptp(profile.keyframe), 1)
    limit = min(_COARSEST_M / meaning.step_m, 0.5 * apart)
    return max((n for n in range(1, common + 1) if common % n == 0 and n <= limit), default=1)


def _spread(
    problem: Problem, profile: Profile, errors: PosteriorErrors, every: int, meaning: GeometryConventions
) -> Mapping[str, Array]:
    """Sigmas of the extended quantities on every ``every``-th row, by chunks that overlap by the operators' reach."""
    step = every * meaning.step_m
    total = -(-len(profile) // every)
    chunk = max(1, int(_CHUNK_M / step))
    margin = int(np.ceil(4.0 * max(meaning.band_m[1], meaning.gradient_base_m) / step))
    parts: dict[str, list[Array]] = {}
    for start in range(0, total, chunk):
        low, high = max(0, start - margin), min(total, start + chunk + margin)
        drawn = profile_samples(problem, profile, slice(low * every, (high - 1) * every + 1, every), errors)
        columns = _extended(drawn.height, drawn.lateral, drawn.heading, drawn.tilt, step, meaning)
        own = slice(start - low, min(total, start + chunk) - low)
        for name, samples in columns.items():
            parts.setdefault(name, []).append(_averaged(np.mean(samples**2, axis=0), step)[own])
    return {name: np.sqrt(np.concatenate(pieces)) for name, pieces in parts.items()}


def _averaged(variance: Array, step_m: float) -> Array:
    """The running mean of what is known; ends take the nearest known value."""
    known = np.isfinite(variance)
    if not known.any():
        return variance
    width = max(1, round(_AVERAGED_M / step_m))
    filled = np.interp(np.arange(variance.size), np.flatnonzero(known), variance[known])
    return np.asarray(uniform_filter1d(filled, width, mode="nearest"))
