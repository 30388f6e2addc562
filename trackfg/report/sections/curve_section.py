"""The section of a page about the curves: where they lie, radius, cant and transitions, each with its sigma."""

from __future__ import annotations

import math

from trackfg.curves import Curve, find_curves
from trackfg.errors import BadInputError, counted
from trackfg.numerics.units import KMH
from trackfg.report.numbers import NONE, digits, with_sd
from trackfg.report.page import PageSection, PageTable, TableRow, Text, folded_if_long
from trackfg.report.sections.places import PagePlaces
from trackfg.results.result import Result
from trackfg.results.verdict import Verdict
from trackfg.results.widening import trusted


def curves_of(result: Result) -> list[Curve]:
    """Return the curves of a result's geometry; none where it has no curvature to find them by."""
    table = result.geometry
    if len(table) < 2 or table["curvature_1pm"].isna().all():
        return []
    try:
        return find_curves(table, base_m=result.summary.geometry.curvature_base_m)
    except BadInputError:  # of another system, without what curves are found by
        return []


def curve_section(curves: list[Curve], result: Result, places: PagePlaces) -> PageSection:
    """Return the table of the curves, in order of chainage."""
    if not curves:
        return PageSection("curves", "Curves", (Text("No curve below a radius of 10 km was found."),))
    rows = tuple(_row(curve, places, _speed_kmh(curve, result), result.summary.verdicts) for curve in curves)
    headings = (
        "no.",
        "begin, km",
        "end, km",
        "sense",
        "radius, m",
        "cant, mm",
        "transition in, m",
        "law in",
        "circle, m",
        "transition out, m",
        "law out",
        "mean speed, km/h",
    )
    table = PageTable(headings, rows, numbers=frozenset((0, 1, 2, 4, 5, 6, 8, 9, 11)))
    note = (
        "Begin and end are those of the transitions, facing increasing chainage; values with 1 sigma. A curve that the "
        "run does not show whole has no end there. The speed is that of the run."
    )
    text = Text(f"{counted(len(curves), 'curve')}. {note}", "note")
    return PageSection("curves", "Curves", (text, *folded_if_long(table, "curves")))


def _row(curve: Curve, places: PagePlaces, speed_kmh: float, verdicts: tuple[Verdict, ...]) -> TableRow:
    begin, end = places.written([curve.btc_m, curve.etc_m])

    def estimate(name: str, column: str) -> str:
        value = getattr(curve, name)
        if trusted(verdicts, column) or math.isnan(value):
            return with_sd(value, curve.sd(name), "")
        return f"{digits(value)} (not trusted)"

    return TableRow(
        (
            str(curve.id),
            begin or NONE,
            end or NONE,
            curve.sense,
            estimate("radius_m", "curvature_1pm"),
            estimate("cant_mm", "cross_level_mm"),
            digits(curve.length_in_m),
            curve.law_in,
            digits(curve.arc_length_m),
            digits(curve.length_out_m),
            curve.law_out,
            digits(speed_kmh),
        )
    )


def _speed_kmh(curve: Curve, result: Result) -> float:
    """Return the mean speed of the run in the circle, km/h; NaN where the run does not show it."""
    table = result.geometry
    inside = table["chainage_m"].between(curve.bcc_m, curve.ecc_m)
    return float(table.loc[inside, "speed_mps"].mean()) / KMH if inside.any() else math.nan
