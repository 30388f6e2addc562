"""The charts of a comparison: curves of one run of each case, errors by speed, and run times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from trackfg.comparison.table import BAND_KMH, QUANTITIES, REFERENCE, TRUTH, Comparison
from trackfg.comparison.table import Row as Score
from trackfg.numerics.arrays import Array
from trackfg.plots.scales import extent, with_margin
from trackfg.plots.sheet import BAND, BLUE
from trackfg.report.charts import (
    GRID,
    PALETTE,
    TRUTH_COLOUR,
    ChartLine,
    ChartPanel,
    Figure,
    Strips,
    bar_figure,
    plain,
    whole_range,
)
from trackfg.report.columns import Column, packed, packed_sigma
from trackfg.report.geometry_charts import chainage_axis

_OF_SIZE = 100.0
"""Values are packed to this part of their usual size."""
_PLACE, _INSTANT = 1e-3, 1e-3
"""Accuracy of the axes' places, m, and times, s, in the page."""
_LEAST = 1.0
"""Half of what an axis spans at least, in the quantity's unit."""
_LEAST_BANDS = 2
"""Bands of speed that a chart over speed needs."""
_ROBUST = 0.995
"""An error axis holds this share of the errors of the estimators that are shown at first."""


@dataclass(frozen=True)
class CaseCurves:
    """The curves of the first run of a case: geometry and its errors over chainage, errors over time; each may lack."""

    geometry: Strips | None
    errors: Strips | None
    over_time: Strips | None


def colours(names: Iterable[str]) -> dict[str, str]:
    """Return one colour for each estimator, the same in every chart."""
    others = [name for name in names if name != REFERENCE]
    return {REFERENCE: BLUE} | {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(others)}


def case_curves(comparison: Comparison, case: str, colour: Mapping[str, str]) -> CaseCurves:
    """Return all that the comparison keeps of a case."""
    scored: dict[str, list[str]] = {}
    for row in comparison.about.rows:
        if row.case == case and row.from_kmh is None:
            scored.setdefault(row.quantity, []).append(row.estimator)
    best = {REFERENCE, TRUTH}
    for ranked in scored.values():
        best |= set([name for name in ranked if name != REFERENCE][:1])
    if not scored:
        best |= {difference.estimator for difference in comparison.about.differences if difference.case == case}
    geometry, over_time = (_of_case(table, case) for table in (comparison.geometry, comparison.positions))
    chart = _CaseChart(scored, best, colour)
    values, errors = chart.over_chainage(geometry) if geometry else (None, None)
    return CaseCurves(values, errors, chart.over_time(over_time) if over_time else None)


def _of_case(table: pd.DataFrame, case: str) -> dict[str, pd.DataFrame]:
    """Return the case's table of each estimator."""
    if "case" not in table:
        return {}
    return {str(name): rows for name, rows in table[table["case"] == case].groupby("estimator", sort=False)}


@dataclass(frozen=True)
class _CaseChart:
    """``scored``: the estimators of each quantity, the best first; ``best``: those that are shown at first."""

    scored: Mapping[str, list[str]]
    best: set[str]
    colour: Mapping[str, str]

    def over_chainage(self, tables: Mapping[str, pd.DataFrame]) -> tuple[Strips | None, Strips | None]:
        """Draw values with the truth, and errors, over chainage."""
        every = [table["chainage_m"].to_numpy() for table in tables.values()]
        unit, scale = chainage_axis(np.concatenate(every))
        x = {name: packed(scale * table["chainage_m"].to_numpy(), scale * _PLACE) for name, table in tables.items()}
        x_range = whole_range(*(scale * chainage for chainage in every))
        label = f"chainage, {unit}"
        values = [panel for quantity in QUANTITIES if (panel := self._values(tables, x, quantity))]
        errors = [panel for quantity in QUANTITIES if (panel := self._errors(tables, x, quantity, "_error"))]
        return (
            Strips(label, unit, x_range, tuple(values), legend=True) if values else None,
            Strips(label, unit, x_range, tuple(errors), legend=True) if errors else None,
        )

    def over_time(self, tables: Mapping[str, pd.DataFrame]) -> Strips | None:
        """Draw errors over time."""
        x = {name: packed(table["t_s"].to_numpy(), _INSTANT) for name, table in tables.items()}
        x_range = whole_range(*(table["t_s"].to_numpy() for table in tables.values()))
        panels = [panel for quantity in QUANTITIES if (panel := self._errors(tables, x, quantity, ""))]
        if not panels:
            return None
        return Strips("time, s", "s", x_range, tuple(panels), legend=True)

    def _values(self, tables: Mapping[str, pd.DataFrame], x: Mapping[str, Column], quantity: str) -> ChartPanel | None:
        curves = self._known(tables, quantity, quantity)
        if not set(curves) - {TRUTH}:
            return None
        lines = tuple(
            ChartLine(
                name,
                TRUTH_COLOUR if name == TRUTH else self.colour[name],
                x[name],
                _packed(values),
                wide=name == TRUTH,
                shown=name in self.best,
            )
            for name, values in curves.items()
        )
        guide = next(curves[name] for name in (TRUTH, REFERENCE, *curves) if name in curves)
        return _panel(quantity, lines, with_margin(*extent(guide, np.zeros(len(guide)), 0.0, _LEAST)))

    def _errors(
        self, tables: Mapping[str, pd.DataFrame], x: Mapping[str, Column], quantity: str, suffix: str
    ) -> ChartPanel | None:
        """Return the errors, the smoother's with the band that it claims; where an unknown offset is not scored it is
        not drawn either.
        """
        curves = self._known(tables, quantity, quantity + suffix)
        curves.pop(TRUTH, None)
        if not curves:
            return None
        centred = QUANTITIES[quantity].statistic == "sd"
        if centred:
            curves = {name: values - np.nanmean(values) for name, values in curves.items()}
        lines, sizes = [], []
        for name, values in curves.items():
            band = None
            if name == REFERENCE:
                sigmas = tables[name][f"{quantity}_sd"].to_numpy(dtype=np.float64)
                sigmas = sigmas[np.isfinite(sigmas)]
                if sigmas.size:
                    band = packed_sigma(tables[name][f"{quantity}_sd"].to_numpy(dtype=np.float64))
                    sizes.append(BAND * float(np.quantile(sigmas, _ROBUST)))
            if name in self.best:
                sizes.append(float(np.nanquantile(np.abs(values), _ROBUST)))
            shown = name in self.best
            line = ChartLine(name, self.colour[name], x[name], _packed(values), band, band_about_zero=True, shown=shown)
            lines.append(line)
        reach = max(sizes, default=0.0) or 1.0
        return _panel(quantity, tuple(lines), with_margin(-reach, reach), centred=centred)

    def _known(self, tables: Mapping[str, pd.DataFrame], quantity: str, column: str) -> dict[str, Array]:
        """Return the truth, and the estimators scored for the quantity (all in a case without scores), where they have
        it.
        """
        curves = {}
        for name, table in tables.items():
            if column not in table or not (name == TRUTH or not self.scored or name in self.scored.get(quantity, ())):
                continue
            values = table[column].to_numpy(dtype=np.float64)
            if np.isfinite(values).any():
                curves[name] = values
        return curves


def _panel(
    quantity: str, lines: tuple[ChartLine, ...], y_range: tuple[float, float], *, centred: bool = False
) -> ChartPanel:
    meaning = QUANTITIES[quantity]
    label = meaning.label.partition(",")[0].replace(" of ", "\nof ").replace(" along ", "\nalong ")
    if centred:
        label += "\nless its mean"
    return ChartPanel(label, meaning.unit, lines, y_range, base=0.0, share=1.25)


def _packed(values: Array) -> Column:
    """Pack to a hundredth of the usual size."""
    sizes = np.abs(values[np.isfinite(values)])
    sizes = sizes[sizes > 0.0]
    return packed(values, float(np.median(sizes)) / _OF_SIZE if sizes.size else 1.0)


def by_speed(rows: Iterable[Score], case: str, colour: Mapping[str, str]) -> Figure | None:
    """Draw error over speed of what is scored by speed, one line per estimator, on a logarithmic scale."""
    banded = [row for row in rows if row.case == case and row.from_kmh is not None]
    quantities = list(dict.fromkeys(row.quantity for row in banded))
    if len({row.from_kmh for row in banded}) < _LEAST_BANDS:
        return None
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "grid": {"rows": 1, "columns": len(quantities), "pattern": "independent", "xgap": 0.12},
        "legend": {"orientation": "h", "x": 0, "y": 1.04, "yanchor": "bottom"},
        "margin": {"l": 70, "r": 20, "t": 60, "b": 50},
        "hovermode": "closest",
        "showlegend": True,
    }
    named: dict[str, None] = {}  # in the order of the lines
    for number, quantity in enumerate(quantities, start=1):
        axis = "" if number == 1 else str(number)
        layout[f"xaxis{axis}"] = {"title": {"text": "speed, km/h"}, "gridcolor": GRID, "rangemode": "tozero"}
        layout[f"yaxis{axis}"] = {
            "title": {"text": f"error of {QUANTITIES[quantity].label}, {QUANTITIES[quantity].unit}"},
            "type": "log",
            "gridcolor": GRID,
            "dtick": "D2",
            "exponentformat": "none",
        }
        for name in colour:
            scores = sorted(
                (row for row in banded if row.quantity == quantity and row.estimator == name and row.error > 0.0),
                key=lambda row: row.from_kmh or 0.0,
            )
            if not scores:
                continue
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "name": plain(name),
                    "legendgroup": plain(name),
                    "showlegend": name not in named,
                    "x": [(row.from_kmh or 0.0) + BAND_KMH / 2.0 for row in scores],
                    "y": [float(f"{row.error:.4g}") for row in scores],
                    "line": {"color": colour[name], "width": 3 if name == REFERENCE else 1.5},
                    "marker": {"size": 5},
                    "xaxis": f"x{axis}",
                    "yaxis": f"y{axis}",
                    "hovertemplate": "%{x:.1f} km/h: %{y:.3g} "
                    + QUANTITIES[quantity].unit
                    + f"<extra>{plain(name)}</extra>",
                }
            )
            named[name] = None
    shown = ", ".join(QUANTITIES[quantity].label for quantity in quantities)
    description = (
        f"Error over speed of {shown}, a line each for {', '.join(named)}; the tables by speed have the numbers."
    )
    return Figure(tuple(traces), layout, 430, description)


def run_times(rows: Iterable[Score], colour: Mapping[str, str]) -> Figure | None:
    """Draw seconds per kilometre of each estimator, its median over the cases, on a logarithmic scale."""
    times: dict[str, dict[str, float]] = {}
    for row in rows:
        if row.seconds_per_km is not None and row.seconds_per_km > 0.0:
            times.setdefault(row.estimator, {})[row.case] = row.seconds_per_km
    if not times:
        return None
    typical = sorted((float(np.median(list(cases.values()))), name) for name, cases in times.items())
    bars = {name: (float(f"{seconds:.4g}"), f"{seconds:.3g}", colour[name]) for seconds, name in typical}
    lowest, highest = float(np.floor(np.log10(typical[0][0]))), float(np.ceil(np.log10(typical[-1][0])))
    x_axis = {
        "type": "log",
        "title": {"text": "s per km"},
        "dtick": 1,
        "range": [lowest, max(highest, lowest + 1.0) + 0.1],
        "exponentformat": "none",
    }
    description = ", ".join(f"{name} {seconds:.3g} s per km" for seconds, name in typical)
    return bar_figure(bars, x_axis, f"Bars of run time: {description}.")
