"""Turn the columns of a geometry table into the quantity that a limit speaks of, or say why that cannot be had.

Used are the standard columns (``level_mm``, ``versine_level_mm``, ``cross_level_mm``, ``twist_mm``, ``gauge_mm``; each
also for the rails, ``level_left_mm``), the design's ``cant_mm``, and *profiles*: ``profile_level_m`` and
``profile_alignment_m``, height and lateral position, of the centre line or of a rail (``profile_level_left_m``). Only a
profile has every wavelength: without one there are the band and the chord of the columns (:class:`ColumnLengths`), and
those that :mod:`trackfg.geometry.versine_bands` and :mod:`trackfg.geometry.versine_chords` have added. The sigma of a
column ``q`` is ``q_sd``; what is computed from several rows has none, because the sigmas of the rows do not say how
their errors are correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.geometry.bands import BANDS, D1, Band, band_pass
from trackfg.geometry.limits import Limit
from trackfg.geometry.twist import Anchor
from trackfg.geometry.twist import twist as twist_of
from trackfg.geometry.versine_chords import further_chord_column
from trackfg.geometry.versines import uniformity_deviation, versine
from trackfg.numerics.arrays import Array

_SIDES = ("", "_left", "_right")
_STEP_TOLERANCE = 1e-3
"""Of a step: how far a row's chainage may be from its place on the grid."""


@dataclass(frozen=True)
class ColumnLengths:
    """Band, chord and base of twist that the standard columns of a table have, m, and where that base lies."""

    band: Band = D1
    chord_m: float = 10.0
    twist_base_m: float = 5.0
    twist_anchor: Anchor = "behind"


@dataclass(frozen=True)
class JudgedQuantity:
    """A quantity that is judged: its name, its values in mm by chainage (n,), and their 1-sigma where it is known, else
    None.

    Only positive values can exceed where ``one_sided``.
    """

    name: str
    chainage_m: Array
    value_mm: Array
    value_mm_sd: Array | None = None
    one_sided: bool = False


def step_of(chainage_m: Array) -> float:
    """Return the step of a uniform chainage. Raises ``BadInputError`` where it is not uniform, with the row."""
    if len(chainage_m) < 2:
        raise BadInputError(f"geometry with {len(chainage_m)} rows; expected at least 2")
    step = float(chainage_m[-1] - chainage_m[0]) / (len(chainage_m) - 1)
    uniform = chainage_m[0] + step * np.arange(len(chainage_m))
    wrong = ~(np.abs(chainage_m - uniform) <= _STEP_TOLERANCE * step)
    if step <= 0.0 or wrong.any():
        row = int(np.argmax(wrong)) + 1
        raise BadInputError(f"geometry, column 'chainage_m', data row {row}: expected rising in equal steps")
    return round(step, 9)


def quantities(
    table: pd.DataFrame,
    limit: Limit,
    curved_to_left: Array,
    gauge_m: float | None,
    lengths: ColumnLengths,
) -> list[JudgedQuantity] | str:
    """Return what of the table the limit applies to; or in words what is missing.

    ``curved_to_left`` (n,) is 1 in left-hand curves, -1 in right-hand ones and 0 on tangent track. ``lengths`` are
    those of the standard columns.
    """
    chainage = table["chainage_m"].to_numpy(dtype=np.float64)
    step = step_of(chainage)
    if limit.parameter in ("level", "alignment"):
        try:
            return _offsets(table, limit, chainage, step, lengths)
        except BadInputError as error:
            return str(error)
    if limit.parameter == "runoff":
        return "where the track was raised is not in a geometry table"
    if limit.parameter in ("gauge_wide", "gauge_narrow", "gauge_change"):
        return _gauge(table, limit, chainage, step, gauge_m)
    twist = _column(table, "twist_mm")
    if limit.parameter == "twist" and limit.base_m == lengths.twist_base_m and twist is not None:
        return [JudgedQuantity("twist_mm", chainage, twist, _column(table, "twist_mm_sd"))]
    cross_level = _column(table, "cross_level_mm")
    if cross_level is None:
        return "needs the column cross_level_mm"
    if limit.parameter in ("elevation", "reverse_cross_level", "cross_level"):
        return _cross_level(table, limit, chainage, cross_level, curved_to_left)
    if limit.parameter == "warp":
        return [JudgedQuantity("cross_level_mm", chainage, _range_within(cross_level, step, _base_of(limit)))]
    try:
        value = twist_of(cross_level, step, _base_of(limit), lengths.twist_anchor)
    except BadInputError as error:
        return str(error)
    return [JudgedQuantity("cross_level_mm", chainage, value)]


def _column(table: pd.DataFrame, name: str) -> Array | None:
    return table[name].to_numpy(dtype=np.float64) if name in table else None


def _gauge(
    table: pd.DataFrame, limit: Limit, chainage: Array, step: float, gauge_m: float | None
) -> list[JudgedQuantity] | str:
    """Return what a limit of the gauge applies to: its change, or how much wider or narrower than nominal it is."""
    gauge = _column(table, "gauge_mm")
    if gauge is None:
        return "needs the column gauge_mm"
    if limit.parameter == "gauge_change":
        return [JudgedQuantity("gauge_mm", chainage, _range_within(gauge, step, _base_of(limit)))]
    if gauge_m is None:
        return "needs the nominal gauge"
    wide = gauge - 1000.0 * gauge_m
    value = wide if limit.parameter == "gauge_wide" else -wide
    return [JudgedQuantity("gauge_mm", chainage, value, _column(table, "gauge_mm_sd"), one_sided=True)]


def _cross_level(
    table: pd.DataFrame, limit: Limit, chainage: Array, cross_level: Array, curved_to_left: Array
) -> list[JudgedQuantity] | str:
    """Return what a limit of the cross-level itself applies to: in curves its sense, else its deviation from design."""
    sd = _column(table, "cross_level_mm_sd")
    if limit.parameter in ("elevation", "reverse_cross_level"):
        inner_above = cross_level * curved_to_left
        value = inner_above if limit.parameter == "reverse_cross_level" else -inner_above
        return [JudgedQuantity("cross_level_mm", chainage, value, sd, one_sided=True)]
    cant = _column(table, "cant_mm")
    if cant is not None:
        return [JudgedQuantity("cross_level_mm", chainage, cross_level - cant, sd)]
    if limit.track == "tangent":
        return [JudgedQuantity("cross_level_mm", chainage, cross_level, sd)]
    return "needs the column cant_mm, the design's cross-level"


def _base_of(limit: Limit) -> float:
    """Return the base of a limit whose parameter is over one, m."""
    assert limit.base_m is not None  # by the schema
    return limit.base_m


def _offsets(
    table: pd.DataFrame, limit: Limit, chainage: Array, step: float, lengths: ColumnLengths
) -> list[JudgedQuantity] | str:
    """Return level and alignment in a band or from a chord, of every profile, or else of the standard columns."""
    offsets = []
    for side in _SIDES:
        name = f"profile_{limit.parameter}{side}_m"
        if name in table:
            profile = table[name].to_numpy(dtype=np.float64)
            if limit.band is not None:
                offsets.append(JudgedQuantity(name, chainage, 1000.0 * band_pass(profile, step, BANDS[limit.band])))
            else:
                offsets.append(_chord_offsets(name, chainage, profile, step, limit))
    if offsets:
        return offsets
    further: list[str] = []
    if limit.band is not None:
        further = [f"{limit.parameter}{side}_{limit.band.lower()}_mm" for side in _SIDES]
    elif limit.chord_m is not None:
        further = [further_chord_column(limit.parameter, side, limit.chord_m) for side in _SIDES]
    if limit.band is not None and BANDS[limit.band] == lengths.band:
        columns = [f"{limit.parameter}{side}_mm" for side in _SIDES]
    elif any(name in table for name in further):
        columns = further
    elif limit.chord_m == lengths.chord_m:
        columns = [f"versine_{limit.parameter}{side}_mm" for side in _SIDES]
    else:
        return f"needs a column profile_{limit.parameter}_m (or of a rail): the other columns have not all wavelengths"
    for name in columns:
        if name in table:
            value = table[name].to_numpy(dtype=np.float64)
            sd = table[f"{name}_sd"].to_numpy(dtype=np.float64) if f"{name}_sd" in table else None
            places = chainage
            if limit.uniformity and limit.chord_m is not None:
                places, value, finer = _with_quarters(chainage, value, step, limit.chord_m)
                value, sd = uniformity_deviation(value, finer, limit.chord_m), None
            offsets.append(JudgedQuantity(name, places, value, sd))
    return offsets or f"needs the column {columns[0]} or profile_{limit.parameter}_m"


def _chord_offsets(name: str, chainage: Array, profile: Array, step: float, limit: Limit) -> JudgedQuantity:
    """Return versines, or their deviations from uniformity, of a chord of any length."""
    assert limit.chord_m is not None
    chainage, profile, step = _with_quarters(chainage, profile, step, limit.chord_m)
    value = 1000.0 * versine(profile, step, limit.chord_m / 2.0, limit.chord_m / 2.0)
    if limit.uniformity:
        value = uniformity_deviation(value, step, limit.chord_m)
    return JudgedQuantity(name, chainage, value)


def _with_quarters(chainage: Array, profile: Array, step: float, chord_m: float) -> tuple[Array, Array, float]:
    """Return chainage, profile and step; where a quarter of the chord is no multiple of the step (31 ft is 9.4488 m),
    those of a slightly finer grid of which it is one."""
    quarter = chord_m / 4.0
    per_quarter = int(np.ceil(quarter / step - 1e-6))
    if abs(per_quarter * step - quarter) <= 1e-6 * step:
        return chainage, profile, step
    finer = quarter / per_quarter
    return *_to_step(chainage, profile, finer), finer


def _to_step(chainage: Array, profile: Array, step: float) -> tuple[Array, Array]:
    """Return a profile on another grid, by a cubic spline; NaN next to where it is NaN."""
    from scipy.interpolate import CubicSpline

    grid = chainage[0] + step * np.arange(int((chainage[-1] - chainage[0]) / step) + 1)
    known = np.isfinite(profile)
    if known.sum() < 4:
        return grid, np.full(len(grid), np.nan)
    filled = np.where(known, profile, np.interp(chainage, chainage[known], profile[known]))
    values = CubicSpline(chainage, filled)(grid)
    lower = np.clip(np.searchsorted(chainage, grid, side="right") - 1, 0, len(chainage) - 2)
    values[~(known[lower] & known[lower + 1])] = np.nan
    return grid, values


def _range_within(value: Array, step: float, length_m: float) -> Array:
    """Return the greatest difference of places less than ``length_m`` apart, centred; NaN at holes and near ends."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    count = max(1, int(np.ceil(length_m / step - 1e-6)))  # places of which the outermost are less than that apart
    holes = np.isnan(value)
    filled = np.where(holes, 0.0, value)
    out: Array = maximum_filter1d(filled, count) - minimum_filter1d(filled, count)
    near = maximum_filter1d(holes, count)
    near[: count // 2] = True
    near[max(len(near) - (count - 1) // 2, 0) :] = True
    out[near] = np.nan
    return out
