"""The section of a page about the quality of each 200 m: standard deviations, the track quality index, a colour bar."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from trackfg.geometry.bands import D1
from trackfg.geometry.exceedances import Judgement
from trackfg.geometry.section_quality import index_channels
from trackfg.numerics.arrays import Array
from trackfg.report.consistency import named
from trackfg.report.exceedances import doubt_text
from trackfg.report.numbers import NONE, digits
from trackfg.report.page import BarCell, BarRow, Block, ColourBar, Fold, PageSection, PageTable, TableRow, Text
from trackfg.report.sections.places import PagePlaces
from trackfg.report.track_limits import doubt_about
from trackfg.report.track_statistics import track_statistics
from trackfg.results.result import Result

SECTION_M = 200.0
"""Length of a section, m: that of EN 13848-6 and of the track quality index of TB/T 3355."""
_WORST = 10
"""Sections that stand open, the worst first."""
_STEPS = 5
"""Colours of the bar, from the best sections to the worst."""
_WORST_SHARE = 0.95
"""The last colour begins below this share of the sections, so that a single bad place does not pale the others."""
_DARK = 2.0
"""Times the best section, at least, is the end of the colours: sections that are nearly alike look alike."""
_MOST_PLACES = 8
"""Stretches between the places below a bar, at most: their names have room on a tablet."""
_FEWEST_PLACES, _PLACES = 3, 5
"""Fewer stretches that end with sections do not do for a long bar: it has so many that do not."""


def quality_section(result: Result, judgement: Judgement | None, places: PagePlaces) -> PageSection:
    """Return the section; ``judgement`` adds the shares of each section beyond limits."""
    table = track_statistics(result, section_m=SECTION_M, judgement=judgement)
    names = [str(name) for name in table]
    channels = index_channels([name.removeprefix("sd_") for name in names if name.startswith("sd_")])
    table = table[table[[f"sd_{name}" for name in channels]].notna().any(axis=1)]
    if table.empty:
        return _section(Text("No section is known well enough to be rated."))
    rated = [name for name in ("tqi", *(f"sd_{name}" for name in channels)) if table[name].notna().any()]
    leading = next((name for name in rated if name.startswith("sd_level")), rated[0])
    worst = table.sort_values(leading, ascending=False, kind="stable", na_position="last").head(_WORST)
    whole = _table(table, channels, places)
    doubt = doubt_about(result)
    blocks: list[Block] = [
        *([doubt_text(doubt)] if doubt else []),
        _bar(table, rated, places),
        Text(_note(result, channels), "note"),
    ]
    if len(table) > _WORST:
        first = _table(worst, channels, places, f"The {len(worst)} sections of the greatest {_label(leading)}")
        blocks += [first, Fold(f"All {len(table)} sections", (whole,))]
    else:
        blocks.append(whole)
    return _section(*blocks)


def _section(*blocks: Block) -> PageSection:
    return PageSection("quality", f"Quality of each {SECTION_M:g} m", blocks, "Quality")


def _label(column: str) -> str:
    return "TQI" if column == "tqi" else f"SD of {named(column.removeprefix('sd_')).name}"


def _note(result: Result, channels: tuple[str, ...]) -> str:
    low, high = result.summary.geometry.band_m
    band = "D1" if (low, high) == (D1.shortest_m, D1.longest_m) else "their band"
    names = ", ".join(named(name).name for name in channels)
    return (
        f"Standard deviations over sections of {SECTION_M:g} m, in mm; level and alignment in {band} "
        f"({low:g}-{high:g} m). TQI: the sum of those of {names}. Cross-level and twist hold the designed cant: "
        "they and the TQI are great where a transition lies. A section of which less than half is known has none. "
        "Colours compare the sections of this run with each other; whether a value is allowed, limits say."
    )


def _table(table: pd.DataFrame, channels: tuple[str, ...], places: PagePlaces, caption: str = "") -> PageTable:
    shares = [str(name) for name in table if str(name).startswith("share_beyond_")]
    columns = ["tqi", *(f"sd_{name}" for name in channels)]
    ends = zip(places.written(table["from_m"]), places.written(table["to_m"]), strict=True)
    unknown = table[[name.replace("share_beyond_", "unknown_m_") for name in shares]]
    rows = tuple(
        TableRow((start, end, *(digits(value) for value in values), *map(_share, beyond, unknown_m)))
        for (start, end), values, beyond, unknown_m in zip(
            ends, table[columns].to_numpy(), table[shares].to_numpy(), unknown.to_numpy(), strict=True
        )
    )
    headings = (
        "from km",
        "to km",
        "TQI, mm",
        *(f"{named(name).name}, mm" for name in channels),
        *(f"% beyond {_beyond(name)}" for name in shares),
    )
    return PageTable(headings, rows, numbers=frozenset(range(len(headings))), caption=caption)


def _share(share: float, unknown_m: float) -> str:
    """Return a share of the known length in percent, and how much is not known."""
    percentage = NONE if math.isnan(share) else f"{100.0 * share:.0f}"
    return f"{percentage} ({unknown_m:.0f} m unknown)" if unknown_m > 0.0 else percentage


def _beyond(column: str) -> str:
    """Return channel and level of a column of shares as they are read."""
    name = column.removeprefix("share_beyond_")
    channel, _, level = name.partition("_mm_")
    if not level:  # computed over a base: ``warp_over_18.9_m_alert``
        channel, _, level = name.partition("_m_")
        channel += " m"
    return f"{channel.replace('cross_level', 'cross-level')}, {level}".replace("_", " ")


def _bar(table: pd.DataFrame, rated: list[str], places: PagePlaces) -> ColourBar:
    """Return a row of coloured sections for each of the rated columns."""
    starts, ends = table["from_m"].to_numpy(), table["to_m"].to_numpy()
    names = [f"km {a} to {b}" for a, b in zip(places.written(starts), places.written(ends), strict=True)]
    rows = []
    for column in rated:
        values = table[column].to_numpy()
        step, edges = colour_steps(values)
        cells = tuple(
            BarCell(float(a), float(b), int(k), f"{name}: {digits(value)} mm")
            for a, b, k, name, value in zip(starts, ends, step, names, values, strict=True)
        )
        rows.append(BarRow(_label(column), cells, f"{digits(edges[0], 2)} to {digits(edges[-1], 2)} mm and more"))
    first = table[rated[0]].to_numpy()
    worst = int(np.nanargmax(first))
    description = (
        f"Coloured bars of {', '.join(row.label for row in rows)} along the line; the greatest {_label(rated[0])} is "
        f"{digits(float(first[worst]))} mm at {names[worst]}. The table has them all."
    )
    return ColourBar(tuple(rows), tuple(places.written(bar_places(starts[0], ends[-1], SECTION_M))), description)


def bar_places(start_m: float, end_m: float, section_m: float) -> Array:
    """Return the places written below a bar, evenly from its first section to its last, m: at ends of sections where
    their number has a divisor that leaves enough of them.
    """
    sections = max(round((end_m - start_m) / section_m), 1)
    stretches = max(k for k in range(1, _MOST_PLACES + 1) if sections % k == 0)
    if stretches < min(_FEWEST_PLACES, sections):
        stretches = _PLACES
    return np.linspace(start_m, end_m, stretches + 1)


def colour_steps(values: Array) -> tuple[Array, Array]:
    """Return the colour of each value, 0 to the last, -1 where it is not known; and the edges between colours."""
    finite = values[np.isfinite(values)]
    low = float(finite.min())
    high = max(float(np.quantile(finite, _WORST_SHARE)), _DARK * low)
    edges = np.linspace(low, high, _STEPS + 1)[:-1] if high > low else np.array([low])
    step = np.searchsorted(edges, values, side="right") - 1
    return np.where(np.isfinite(values), np.clip(step, 0, _STEPS - 1), -1), edges
