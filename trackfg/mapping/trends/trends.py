"""Trends of a track: where it drifts and how fast, where it jumped, and when a limit is reached.

The drift of every cell and of every 200 m is fitted (:mod:`trackfg.mapping.trends.drift`). A cell has a trend where its
rate is large enough to matter, and beyond the threshold that noise exceeds :data:`FALSE_PER_100_KM` times in 100 km,
all quantities together: how often the whitened rate crosses zero is counted, and Rice's formula gives how seldom it
then goes so far (:mod:`trackfg.mapping.changes.change_noise`). Steps have a threshold likewise, for every run. Work on
the track is done over a length: around a step that was found, one of the same run counts from three sigmas on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pandas as pd

from trackfg.geometry.limits import Limit
from trackfg.mapping.changes.change_noise import FEWEST_CROSSINGS_PER_M, freedom_of, threshold
from trackfg.mapping.joining.build import JoinableRun
from trackfg.mapping.trends.drift import Drift, drift, reached
from trackfg.mapping.trends.offsets import offset_columns
from trackfg.mapping.trends.series import Series, section_series, series
from trackfg.mapping.trends.wear import DAY_S, Wear, months
from trackfg.maps.feature_map import FeatureMap, MapConventions
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_stretches
from trackfg.results.result import Result
from trackfg.results.trends import PLACE, Trends, columns_of

FALSE_PER_100_KM = 0.5
"""Trends that noise makes in 100 km, and steps: half of the one that is allowed."""

LEAST_RATE = 0.1
"""Rate of a trend that matters, mm per month: a millimetre in a year is what a recording car repeats to."""

LEAST_STEP_MM = 1.0
"""Step that is listed, mm: likewise."""

_TOGETHER_M = 10.0
"""Cells this near, m, are one trend: the base of versines, which show a defect of a point so far to either side."""
_WORKED_M = 100.0
"""Around a step, another of the same run is likely, m: the shortest length that a tamping machine is sent for."""
_LIKELY_SIGMAS = 3.0
"""Sigmas from which a likely step is one."""
_SURE_SIGMAS = 2.0
"""A row is that of the cell whose rate or step is the largest so many sigmas below: 97.5 % are larger than that."""
_FURTHEST = timedelta(days=50 * 365.25)
"""Dates further ahead are none: no track lies so long without work."""


def find_trends(
    results: Sequence[Result | JoinableRun],
    feature_map: FeatureMap,
    limits: Iterable[Limit] = (),
    *,
    floor_mm_per_month: float = LEAST_RATE,
    load: Wear | None = None,
) -> Trends:
    """Find the trends that runs over a map show together, of at least a rate, mm per month.

    Rates are per month, or per unit of a ``load``, which has to be known on the date of each run. The ``limits`` are
    those that hold on the line: :func:`trackfg.geometry.limits.at_line_speed` chooses them by its speed. A run that is
    not recognised on the map is left out. Raises :class:`~trackfg.errors.BadInputError` for fewer runs than a trend
    needs, and one without a date.
    """
    by_cell, left_out = series(results, feature_map)
    twist_base_m = results[0].summary.geometry.twist_base_m
    followed, not_followed = _followed(limits, feature_map.conventions, twist_base_m)
    trends = trends_of(by_cell, followed, feature_map.conventions.chord_m, floor_mm_per_month, load)
    left_out = {f"run {run}": reason for run, reason in left_out.items()}
    return replace(trends, left_out={**left_out, **not_followed}, doubts=by_cell.doubts)


def trends_of(
    by_cell: Series,
    followed: Sequence[tuple[Limit, str]] = (),
    correlated_m: float = 10.0,
    floor_mm_per_month: float = LEAST_RATE,
    load: Wear | None = None,
) -> Trends:
    """Find the trends of a series. ``followed``: limits, each with the quantity that is held against it.

    Errors of a run are taken to be independent ``correlated_m`` apart, for the sigmas of sections. ``load``: what rates
    are per; months if None.
    """
    wear = months(by_cell.dates) if load is None else load
    floor_mm = floor_mm_per_month * wear.months_each
    by_section = section_series(by_cell, correlated_m)
    drifts = {name: drift_of(by_cell, name, wear) for name in by_cell.value}
    of_sections = {name: drift_of(by_section, name, wear) for name in by_section.value}
    spans = {name: _spans(by_cell, _significant(by_cell, name, d, floor_mm)) for name, d in drifts.items()}
    rate, columns = f"rate_mm_per_{wear.per}", columns_of(wear.per)
    return Trends(
        trends=pd.DataFrame(
            [_trend(by_cell, name, drifts[name], span, rate) for name in drifts for span in spans[name]],
            columns=columns["trends"],
        ),
        steps=pd.DataFrame(
            [row for name in drifts for row in _steps(by_cell, name, drifts[name])],
            columns=columns["steps"],
        ),
        reached=pd.DataFrame(
            [
                _reached(by_cell, name, drifts[name], span, limit, wear)
                for limit, name in followed
                for span in spans[name]
            ],
            columns=columns["reached"],
        ),
        cells=_table(by_cell, drifts, wear.per),
        sections=_table(by_section, of_sections, wear.per),
        values=by_cell.table(),
        section_values=by_section.table(),
        per=wear.per,
    )


def drift_of(places: Series, name: str, wear: Wear) -> Drift:
    """Fit the drift of a quantity of a series, a second time with steps likely where one was found nearby."""
    t, y, sd = wear.at(places.dates), places.value[name], places.sd[name]
    strict = _threshold(places, name, np.diff(y, axis=0), tests=t.size)
    offsets = offset_columns(places.t_days, places.sensors, np.isfinite(y))
    fit = drift(t, y, sd, threshold=strict, offsets=offsets)
    near = 1 + 2 * round(_WORKED_M / places.step_m)
    stepped = pd.DataFrame((fit.steps != 0.0).T.astype(float))
    worked = stepped.rolling(near, center=True, min_periods=1).max().to_numpy().T > 0.0
    if not worked.any():
        return fit
    return drift(t, y, sd, threshold=np.where(worked, min(_LIKELY_SIGMAS, strict), strict), offsets=offsets)


def _crossings(places: Series, rows: Array) -> float:
    """Return how often per m what should be noise changes sign along the line."""
    signs = np.sign(rows)
    both = signs[:, 1:] * signs[:, :-1]
    counted = np.isfinite(both).sum() * places.step_m
    return max(float((both < 0.0).sum() / counted) if counted else 0.0, FEWEST_CROSSINGS_PER_M)


def _threshold(places: Series, name: str, rows: Array, tests: int = 1) -> float:
    """Return the sigmas that noise, which changes sign as often as ``rows`` do, exceeds as seldom as it may."""
    alarms_per_m = 1e-5 * FALSE_PER_100_KM / len(places.value) / tests
    return threshold(_crossings(places, rows) / alarms_per_m, freedom_of(name))


def _significant(places: Series, name: str, d: Drift, floor_mm: float) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        sigmas = d.rate / d.rate_sd
    large = np.abs(d.rate) >= floor_mm
    return np.asarray(large & (np.abs(sigmas) > _threshold(places, name, sigmas[None])))


def _spans(places: Series, true: np.ndarray) -> list[slice]:
    """Return the stretches of cells that are true, those near each other as one."""
    stretches = true_stretches(true, round(_TOGETHER_M / places.step_m))
    return [slice(int(first), int(stop)) for first, stop in stretches]


def _place(places: Series, span: slice, at: int, name: str) -> dict[str, Any]:
    chainage = places.chainage_m
    return dict(zip(PLACE, (chainage[span.start], chainage[span.stop - 1], chainage[at], name), strict=True))


def _trend(places: Series, name: str, d: Drift, span: slice, rate: str) -> dict[str, Any]:
    at = span.start + _largest(d.rate[span], d.rate_sd[span])
    stepped = np.flatnonzero(d.steps[:, at])
    return {
        **_place(places, span, at, name),
        rate: d.rate[at],
        f"{rate}_sd": d.rate_sd[at],
        "value_mm": d.value[at],
        "value_mm_sd": d.value_sd[at],
        "runs": int(d.runs[at]),
        "last_step": places.dates[stepped[-1]].date().isoformat() if stepped.size else "",
    }


def _largest(values: Array, sd: Array) -> int:
    """Return where values are surely the largest in magnitude."""
    return int(np.nanargmax(np.abs(values) - _SURE_SIGMAS * sd))


def _steps(places: Series, name: str, d: Drift) -> list[dict[str, Any]]:
    rows = []
    for run, jump in enumerate(d.steps):
        for span in _spans(places, np.abs(jump) >= LEAST_STEP_MM):
            at = span.start + _largest(jump[span], d.step_sd[run, span])
            usable = np.isfinite(places.value[name][run:, at]) & ~d.outliers[run:, at]
            rows.append(
                {
                    **_place(places, span, at, name),
                    "date": places.dates[run].date().isoformat(),
                    "step_mm": jump[at],
                    "step_mm_sd": d.step_sd[run, at],
                    "runs_after": int(usable.sum()),
                }
            )
    return rows


def _reached(places: Series, name: str, d: Drift, span: slice, limit: Limit, wear: Wear) -> dict[str, Any]:
    """Return when the first cell of a trend reaches a limit; of several at one time, that of the largest value."""
    part = replace(
        d, **{field: getattr(d, field)[span] for field in ("rate", "rate_sd", "value", "value_sd", "covariance")}
    )
    times = reached(part, limit.value_mm)
    at_first = times[0] == np.nanmin(times[0])
    first = int(np.argmax(np.where(at_first, np.abs(part.value), -1.0)))
    at = span.start + first
    on, earliest, latest = (_day(float(wear.days_at(time[first])), places.dates[-1]) for time in times)
    return {
        **_place(places, span, at, name),
        "limit": str(limit),
        "limit_mm": limit.value_mm,
        "value_mm": d.value[at],
        f"rate_mm_per_{wear.per}": d.rate[at],
        "reached_on": on,
        "earliest": earliest,
        "latest": latest,
    }


def _day(days: float, last: datetime) -> str:
    """Return a date as ISO 8601; an empty text where it is never, or further ahead of the last than anyone plans."""
    if not np.isfinite(days) or days * DAY_S - last.timestamp() > _FURTHEST.total_seconds():
        return ""
    return datetime.fromtimestamp(days * DAY_S, UTC).date().isoformat()


def _followed(
    limits: Iterable[Limit], conventions: MapConventions, twist_base_m: float
) -> tuple[list[tuple[Limit, str]], dict[str, str]]:
    """Return the limits that a quantity can be held against, with that, and why of the others."""
    followed, left_out = [], {}
    for limit in limits:
        name = {
            ("twist", twist_base_m): "twist_mm",
            ("level", conventions.chord_m): "versine_level_mm",
            ("alignment", conventions.chord_m): "versine_alignment_mm",
        }.get((limit.parameter, limit.base_m or limit.chord_m or 0.0))
        if name is None or limit.kind != "peak" or limit.uniformity or limit.track != "any":
            left_out[str(limit)] = (
                f"followed are peaks of twist over {twist_base_m:g} m, and of versines of level and alignment over "
                f"{conventions.chord_m:g} m"
            )
        else:
            followed.append((limit, name))
    return followed, left_out


def _table(places: Series, drifts: dict[str, Drift], per: str) -> pd.DataFrame:
    columns: dict[str, Any] = {"chainage_m": places.chainage_m}
    for name, d in drifts.items():
        rate = f"{name}_per_{per}"
        columns |= {name: d.value, f"{name}_sd": d.value_sd, rate: d.rate, f"{rate}_sd": d.rate_sd}
        columns[f"{name}_runs"] = d.runs
    return pd.DataFrame(columns)
