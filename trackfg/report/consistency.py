"""Are the sigmas true? Residuals against what the factors' sigmas lead to expect, and errors against the truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtr

from trackfg.evaluation.scores import quantities, score_run
from trackfg.numerics.arrays import Array
from trackfg.plots.sheet import BLUE, GREY, RED
from trackfg.report.charts import Figure, bar_figure
from trackfg.report.numbers import digits, percent
from trackfg.report.page import PageTable, TableRow

_WITHIN = (1.0, 1.96, 3.0)
"""Sigmas within which errors are counted: those of 68, 95 and 99.7 % of a normal distribution."""
_EDGE, _BINS = 5.0, 50
"""Edge of the histograms, in sigmas, and their number of bins."""
_ACROSS = 4
"""Histograms beside each other."""
_ROW_PX = 190
"""Height of a row of histograms, pixels."""
_LOUD = 2.0
"""Noise above this many times what is assumed stands out."""

_UNITS = {
    "1pm": ("1/km", 1000.0),
    "permille": ("‰", 1.0),
    "mm": ("mm", 1.0),
    "m": ("m", 1.0),
    "mrad": ("mrad", 1.0),
    "kmh": ("km/h", 1.0),
}
"""Suffix of a column: the unit it is shown in, and what brings it there."""

_BAND_KMH = 10.0
"""Width of a band of speed, km/h."""
_DOUBLINGS = 3
"""Doublings of the noise to each side of 1 that the axis shows."""


@dataclass(frozen=True)
class Named:
    """A quantity's words and unit, from its column: ``versine_level_mm`` is "versine level" in mm."""

    name: str
    unit: str
    scale: float


def named(column: str) -> Named:
    """Return words and unit of a column, and the factor from the column's own unit."""
    words, _, suffix = column.rpartition("_")
    if suffix in _UNITS and words:
        return Named(words.replace("cross_level", "cross-level").replace("_", " "), *_UNITS[suffix])
    return Named(column.replace("_", " "), "", 1.0)


def noise_bars(ratios: Mapping[str, float]) -> Figure:
    """Draw actual over assumed noise of each group of factors, on a scale of doublings about 1.

    A bar that leaves the scale ends at its edge; its number says where.
    """
    most, reach = 2.0**_DOUBLINGS, _DOUBLINGS + 0.5
    ticks = list(range(-_DOUBLINGS, _DOUBLINGS + 1))
    bars = {
        name: (float(np.log2(np.clip(ratio, 1.0 / most, most))), digits(ratio), RED if ratio > _LOUD else BLUE)
        for name, ratio in ratios.items()
    }
    x_axis = {
        "range": [-reach, reach],
        "tickvals": ticks,
        "ticktext": [_power(power) for power in ticks],
        "title": {"text": "actual over assumed noise"},
        "zerolinecolor": "#1c2733",
        "zerolinewidth": 1.5,
    }
    values = ", ".join(f"{name} {digits(ratio)}" for name, ratio in ratios.items())
    return bar_figure(bars, x_axis, f"Bars of actual over assumed noise: {values}.")


def _power(power: int) -> str:
    return f"{2**power}" if power >= 0 else f"1/{2**-power}"


def error_table(errors: pd.DataFrame) -> PageTable:
    """Return one row per quantity that has an error."""
    scores = score_run(errors, band_kmh=None)
    rows = []
    for score in scores[scores["places"] > 0].to_dict("records"):
        quantity = named(score["quantity"])
        shown = (digits(quantity.scale * score[size]) for size in ("rms", "sd", "mean_abs", "max", "mean_sd"))
        rows.append(TableRow((quantity.name, quantity.unit, str(score["places"]), *shown, digits(score["ratio"]))))
    return PageTable(
        ("quantity", "unit", "rows", "RMS", "SD", "mean |error|", "largest", "mean 1 sigma", "RMS of error/sigma"),
        tuple(rows),
        numbers=frozenset(range(2, 9)),
    )


def band_table(errors: pd.DataFrame, columns: Iterable[str]) -> PageTable:
    """Return RMS of some quantities by speed."""
    scores = score_run(errors, band_kmh=_BAND_KMH)
    scores = scores[scores["from_kmh"].notna() & scores["quantity"].isin(list(columns))]
    wide = scores.pivot_table(index="from_kmh", columns="quantity", values="rms", sort=False).sort_index()
    shown = [name for name in columns if name in wide]
    values = wide[shown].to_numpy() * [named(name).scale for name in shown]
    return PageTable(
        ("speed, km/h", *(f"{named(name).name}, {named(name).unit}" for name in shown)),
        TableRow.plain(
            (f"{band:.0f} – {band + _BAND_KMH:.0f}", *map(digits, row))
            for band, row in zip(wide.index, values, strict=True)
        ),
        numbers=frozenset(range(1, 1 + len(shown))),
        caption="RMS of the error by speed",
    )


def coverage_table(errors: pd.DataFrame) -> PageTable:
    """Return how often an error is within so many sigmas, beside what a normal distribution has there."""
    rows = TableRow.plain(
        (named(name).name, *(percent(float(np.mean(np.abs(ratio) <= within))) for within in _WITHIN))
        for name, ratio in _normalised(errors)
    )
    expected = (percent(float(2.0 * ndtr(within) - 1.0)) for within in _WITHIN)
    return PageTable(
        ("quantity", *(f"within {within:g} sigma" for within in _WITHIN)),
        (*rows, TableRow(("normal distribution", *expected), mark="own")),
        numbers=frozenset(range(1, 1 + len(_WITHIN))),
    )


def histograms(errors: pd.DataFrame) -> Figure | None:
    """Draw error over sigma of each quantity, beside the normal density; None where no error has a sigma."""
    ratios = list(_normalised(errors))
    if not ratios:
        return None
    rows = -(-len(ratios) // _ACROSS)
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "grid": {"rows": rows, "columns": _ACROSS, "pattern": "independent", "xgap": 0.12, "ygap": 0.3},
        "margin": {"l": 40, "r": 20, "t": 30, "b": 30},
        "showlegend": False,
        "bargap": 0,
        "annotations": [],
    }
    edges = np.linspace(-_EDGE, _EDGE, _BINS + 1)
    middle = (edges[1:] + edges[:-1]) / 2.0
    for number, (name, ratio) in enumerate(ratios, start=1):
        count, _ = np.histogram(np.clip(ratio, -_EDGE, _EDGE), edges)
        density = count / (ratio.size * np.diff(edges))
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}", "hoverinfo": "skip"}
        traces.append(
            {"type": "bar", "x": _list(middle), "y": _list(density), "marker": {"color": BLUE, "opacity": 0.55}} | axes
        )
        normal = {"type": "scatter", "mode": "lines", "line": {"color": "#1c2733", "width": 1.3}}
        traces.append(normal | {"x": _list(middle), "y": _list(np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi))} | axes)
        layout[f"xaxis{number}"] = {"range": [-_EDGE, _EDGE], "tickvals": [-4, -2, 0, 2, 4], "tickfont": {"size": 10}}
        layout[f"yaxis{number}"] = {"rangemode": "tozero", "showticklabels": False, "gridcolor": "#eef1f4"}
        layout["annotations"].append(
            {
                "text": named(name).name,
                "xref": f"x{number} domain",
                "yref": f"y{number} domain",
                "x": 0.5,
                "y": 1.02,
                "xanchor": "center",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 12, "color": GREY},
            }
        )
    names = ", ".join(named(name).name for name, _ in ratios)
    description = f"Histograms of error over sigma of {names} beside the normal density"
    return Figure(tuple(traces), layout, 40 + _ROW_PX * rows, f"{description}; the table below counts them.")


def _normalised(errors: pd.DataFrame) -> Iterator[tuple[str, Array]]:
    """Return error over sigma of each quantity, where there are both."""
    for name in quantities(errors):
        sigma = errors[f"{name}_sd"].to_numpy()
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = errors[name].to_numpy() / np.where(sigma > 0.0, sigma, np.nan)
        ratio = ratio[np.isfinite(ratio)]
        if ratio.size:
            yield name, ratio


def _list(values: Array) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
