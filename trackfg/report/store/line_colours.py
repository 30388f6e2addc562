"""Lines as coloured bars over their chainage: a quantity by sections of 200 m, or how fast it grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.report.consistency import named
from trackfg.report.numbers import digits
from trackfg.report.page import BarCell, BarRow, ColourBar
from trackfg.report.sections.places import PagePlaces
from trackfg.report.sections.quality import SECTION_M, bar_places, colour_steps
from trackfg.report.store.addresses import line_address, section_address

MOST_CELLS = 600
"""Cells of a bar: narrower ones than some pixels are not seen. Beyond, neighbours are one cell, of the worst value."""


@dataclass(frozen=True)
class Aspect:
    """An aspect that lines are coloured by: a column of their sections, or its growth."""

    quantity: str
    growth: bool

    @property
    def name(self) -> str:
        """Return its name in an address."""
        return f"{self.quantity}{'_per_month' if self.growth else ''}"

    @property
    def label(self) -> str:
        """Return what is read."""
        return f"{'growth of ' if self.growth else ''}SD of {named(self.quantity).name}"

    @property
    def unit(self) -> str:
        """Return its unit."""
        return "mm a month" if self.growth else "mm"

    def badness(self, sections: pd.DataFrame) -> Array:
        """Return what is coloured, from good to poor: growth counts as far as it is significant, and not below zero."""
        values: Array = sections[self.name].to_numpy(dtype=np.float64)
        if not self.growth:
            return values
        with np.errstate(invalid="ignore"):
            grown = values > SIGMAS * sections[f"{self.name}_sd"].to_numpy()
        return np.where(np.isnan(values), np.nan, np.where(grown, values, 0.0))

    def steps(self, values: Array) -> tuple[Array, Array]:
        """Return the colour of each value of :meth:`badness`, -1 where it is not known; and where colours begin."""
        if not self.growth:
            return colour_steps(values)
        step = np.searchsorted(GROWTH_EDGES, values, side="right") - 1
        return np.where(np.isfinite(values), step, -1), GROWTH_EDGES


GROWTH_EDGES = np.array([0.0, 0.1, 0.2, 0.4, 0.8])
"""Where the colours of growth begin, mm a month, alike on every page: those that are coloured reach down to the least
rate of a trend (:data:`trackfg.mapping.trends.trends.LEAST_RATE`), however fast the fastest section grows.
"""
SIGMAS = 2.0
"""A growth that is fewer sigmas from zero counts as none: 2.5 % of sections that do not grow exceed it by chance."""


def aspects(quantities: tuple[str, ...]) -> tuple[Aspect, ...]:
    """Return everything that lines can be coloured by."""
    return tuple(Aspect(quantity, growth) for growth in (False, True) for quantity in quantities)


def coloured_lines(lines: Mapping[str, pd.DataFrame], aspect: Aspect) -> list[ColourBar]:
    """Return a bar per line, over its own chainage, all with the same colours. ``lines``: their sections by name."""
    tables = {line: sections for line, sections in lines.items() if np.isfinite(aspect.badness(sections)).any()}
    if not tables:
        return []
    shown = {line: _coarse(sections, aspect) for line, sections in tables.items()}
    steps, edges = aspect.steps(np.concatenate([value for _, value in shown.values()]))
    legend = _legend(edges, aspect)
    bars, first = [], 0
    for line, (cells, value) in shown.items():
        step, first = steps[first : first + len(cells)], first + len(cells)
        row = BarRow(f"line {line}", _cells(line, cells, value, step, aspect.unit), legend, line_address(line))
        bars.append(_bar((row,), cells, f"{aspect.label} along line {line}"))
    return bars


def coloured_sections(line: str, sections: pd.DataFrame, shown: tuple[Aspect, ...]) -> ColourBar | None:
    """Return a bar per aspect over the chainage of one line, each with its own colours; None where none is known."""
    rows = []
    cells = sections
    for aspect in shown:
        if not np.isfinite(aspect.badness(sections)).any():
            continue
        cells, value = _coarse(sections, aspect)
        step, edges = aspect.steps(value)
        rows.append(BarRow(aspect.label, _cells(line, cells, value, step, aspect.unit), _legend(edges, aspect)))
    return _bar(tuple(rows), cells, f"Quantities along line {line}") if rows else None


def _legend(edges: Array, aspect: Aspect) -> str:
    if edges.size == 1:
        return f"{digits(edges[0], 2)} {aspect.unit}"
    if aspect.growth:
        return f"below {edges[1]:g} to {edges[-1]:g} {aspect.unit} and more"
    return f"{digits(edges[0], 2)} to {digits(edges[-1], 2)} {aspect.unit} and more"


def _coarse(sections: pd.DataFrame, aspect: Aspect) -> tuple[pd.DataFrame, Array]:
    """Return cells (``from_m, to_m``) and what is coloured there: sections, or the worst of several."""
    number = -(-len(sections) // MOST_CELLS)
    group = np.arange(len(sections)) // number
    cells = sections.groupby(group).agg(from_m=("from_m", "first"), to_m=("to_m", "last"))
    worst = pd.Series(aspect.badness(sections)).groupby(group).max()
    return cells, np.asarray(worst, dtype=np.float64)


def _cells(line: str, cells: pd.DataFrame, value: Array, step: Array, unit: str) -> tuple[BarCell, ...]:
    ends = zip(cells["from_m"].tolist(), cells["to_m"].tolist(), strict=True)
    return tuple(
        BarCell(a, b, int(k), f"km {1e-3 * a:.3f} to {1e-3 * b:.3f}: {digits(v)} {unit}", section_address(line, a))
        for (a, b), k, v in zip(ends, step, value, strict=True)
    )


def _bar(rows: tuple[BarRow, ...], cells: pd.DataFrame, what: str) -> ColourBar:
    places = bar_places(cells["from_m"].iloc[0], cells["to_m"].iloc[-1], SECTION_M)
    return ColourBar(rows, tuple(PagePlaces().written(places)), f"{what}. The page of the line has all as a table.")
