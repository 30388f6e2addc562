"""The page of a result: is it to be trusted, what was measured, and how it was made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.evaluation.scores import PLACE
from trackfg.geometry.exceedances import Judgement
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.plots.strip_chart import LimitLine
from trackfg.report.balise_section import balise_sections
from trackfg.report.consistency import band_table, coverage_table, error_table, histograms, noise_bars
from trackfg.report.exceedances import exceedance_places, exceedance_section, exceedance_tile
from trackfg.report.geometry_charts import chainage_axis, channels, geometry_strips
from trackfg.report.kilometrage_section import kilometrage_sections
from trackfg.report.motion_charts import SHADES, PathMark, error_strips, motion_strips, path_map
from trackfg.report.numbers import NONE, digits, duration, length, with_sd
from trackfg.report.page import (
    Block,
    Code,
    Columns,
    Drawing,
    Facts,
    Fold,
    Page,
    PageSection,
    PageTable,
    TableRow,
    Text,
    folded_if_long,
)
from trackfg.report.sections.background import Background
from trackfg.report.sections.curve_section import curve_section, curves_of
from trackfg.report.sections.known_line import known_line_sections
from trackfg.report.sections.places import PagePlaces
from trackfg.report.sections.quality import quality_section
from trackfg.report.sections.strip_places import place_rows
from trackfg.report.sections.summary import measured_elsewhere, measured_table, sensor_facts, summary_section
from trackfg.report.truth import Against
from trackfg.results.flatten import leaves
from trackfg.results.official_places import KM_COLUMN, with_km
from trackfg.results.result import Result

if TYPE_CHECKING:
    from trackfg.curves import Curve
    from trackfg.recording.line_kilometrage import LineKilometrage

_BANDED = ("cross_level_mm", "twist_mm", "level_mm", "alignment_mm", "versine_level_mm", "versine_alignment_mm")
_LEVELS = ("error", "warning", "info")
_FINEST_M = 0.01
"""A place is written to centimetres at the finest, and so is its sigma."""


NOTHING_BEHIND = Background()


@dataclass(frozen=True)
class _Along:
    """All that lies along the line: its curves, what the user has behind the map, and how places are written."""

    curves: list[Curve]
    background: Background
    places: PagePlaces

    def marks(self, result: Result) -> list[PathMark]:
        """Return the curves by number and the balises by id, where the run passes them."""
        marks = [
            PathMark("curves", str(curve.id), 0.5 * (curve.bcc_m + curve.ecc_m))
            for curve in self.curves
            if math.isfinite(curve.bcc_m + curve.ecc_m)
        ]
        balises = result.balises
        if not balises.empty:
            passages = balises[balises["measured_m"].notna()]
            marks += [
                PathMark("balises", str(name), float(at))
                for name, at in zip(passages["id"], passages["measured_m"], strict=True)
            ]
        return marks


def result_page(
    result: Result,
    command: str,
    against: Against | None,
    judgement: Judgement | None = None,
    line: LineKilometrage | None = None,
    *,
    limits: Sequence[LimitLine] = (),
    background: Background = NOTHING_BEHIND,
) -> Page:
    """Return the page of a result.

    ``command`` is what made the page; ``against`` the truth, where it is known; ``judgement`` says where the geometry
    exceeds limits, where any were given, and ``limits`` are those that are drawn. Of a ``line`` the page has the
    kilometrage, and official places. ``background`` lies behind the map, and its named points are the stations.
    """
    page = result.summary
    kilometrage = None if line is None else line.kilometrage()
    way = "distance not determined" if page.distance_m is None else length(page.distance_m)
    curves = [] if result.geometry.empty else curves_of(result)
    along = _Along(curves, background, PagePlaces(kilometrage))
    track = _track(result, against, (judgement, tuple(limits)), along)
    headlines = () if judgement is None else (exceedance_tile(judgement),)
    if page.solver is None:
        sections = [
            measured_elsewhere(result, headlines),
            *track,
            _findings(result),
            *kilometrage_sections(result, line),
        ]
        subtitle = f"{way}, measured by another system, imported by trackfg {_version(result)}"
        return Page("result", page.recording_id, subtitle, (*sections, _made(result, command)))
    sections = [
        summary_section(result, page.solver, headlines),
        *track,
        _findings(result),
        *kilometrage_sections(result, line),
        *balise_sections(result),
        *known_line_sections(result, along.places),
        _events(result, kilometrage),
        _motion(result, against),
        _consistency(result, against),
        _map(result, against, along),
        _made(result, command),
    ]
    subtitle = f"{way} in {duration(page.duration_s)}, smoothed by trackfg {_version(result)}"
    return Page("result", page.recording_id, subtitle, tuple(sections))


def _version(result: Result) -> str:
    return result.summary.versions.get("trackfg", "")


def _findings(result: Result) -> PageSection:
    findings = sorted(result.summary.findings, key=lambda finding: _LEVELS.index(finding.level))
    if not findings:
        return PageSection(
            "findings", "Data quality", (Text("Reading the recording found nothing to report.", "good"),), "Data"
        )
    rows = tuple(
        TableRow(
            (
                finding.level,
                finding.place or NONE,
                finding.message + (f"; expected {finding.expected}" if finding.expected else ""),
                finding.hint or NONE,
            ),
            mark="error" if finding.level == "error" else "warning" if finding.level == "warning" else "",
        )
        for finding in findings
    )
    return PageSection("findings", "Data quality", (PageTable(("level", "where", "what", "hint"), rows),), "Data")


def _events(result: Result, kilometrage: Kilometrage | None) -> PageSection:
    events = with_km(result.events, kilometrage)
    if events.empty:
        return PageSection("events", "Events", (Text("None."),))
    counts = ", ".join(f"{kind}: {number}" for kind, number in events["kind"].value_counts().items())
    rows = TableRow.plain(
        (
            event["kind"],
            f"{event['start_s']:.1f}",
            f"{event['end_s'] - event['start_s']:.1f}" if event["end_s"] > event["start_s"] else NONE,
            *([event[KM_COLUMN]] if KM_COLUMN in event else []),
            with_sd(event["chainage_m"], max(event["chainage_m_sd"], _FINEST_M), ""),
            with_sd(event["distance_removed_m"], event["distance_removed_m_sd"], ""),
            event["detail"],
        )
        for event in events.to_dict("records")
    )
    place = ("km", "chainage, m") if KM_COLUMN in events else ("chainage, m",)
    headings = ("event", "start, s", "duration, s", *place, "distance removed, m", "detail")
    table = PageTable(headings, rows, numbers=frozenset(range(1, len(headings) - 1)))
    return PageSection("events", "Events", (Text(f"{counts}."), *folded_if_long(table, "events")))


def _track(
    result: Result,
    against: Against | None,
    limits: tuple[Judgement | None, tuple[LimitLine, ...]],
    along: _Along,
) -> Iterator[PageSection]:
    """Yield what the run says of the track: exceedances, quality, curves, then the strips and their errors."""
    judgement, lines = limits
    curves, places = along.curves, along.places
    if result.geometry.empty:
        text = "The run says nothing of the track: there is no geometry. docs/results.md says when that is so."
        yield PageSection("geometry", "Track geometry", (Text(text),))
        return
    if judgement is not None:
        yield exceedance_section(judgement, result)
    if len(result.geometry) > 1:
        yield quality_section(result, judgement, places)
        yield curve_section(curves, result, places)
    errors = _errors(result, against)
    chainage = result.geometry["chainage_m"].to_numpy()
    _, scale = chainage_axis(chainage)
    rows = place_rows(result, curves, along.background.stations(result), exceedance_places(judgement), scale)
    strips, error_chart = geometry_strips(
        result, errors, judgement, limits=lines, rows=rows, official=places.axis(chainage, scale)
    )
    shown = (Drawing(strips, note=_conventions(result)), measured_table(result))
    yield PageSection("geometry", "Track geometry", shown, "Geometry")
    if against is None or error_chart is None:
        return
    blocks: tuple[Block, ...] = (
        Text(
            "Estimate less truth, where the vehicle was: at the true place of each row, so that an error of the "
            "chainage is not counted as one of the geometry."
        ),
        error_table(errors),
        Fold("By speed", (band_table(errors, [name for name in _BANDED if name in errors]),)),
        Drawing(error_chart, note="Bands: 95 % of the sigmas that the result claims, about zero."),
    )
    yield PageSection("errors", "Errors of the geometry", blocks, "Errors")


def _conventions(result: Result) -> str:
    c = result.summary.geometry
    sure = digits(float(result.geometry["chainage_m_sd"].max()))
    return (
        f"Left and right facing {c.facing}. Positive: up, to the left, left rail higher, uphill. Level and alignment "
        f"in the band {c.band_m[0]:g}-{c.band_m[1]:g} m, twist on {c.twist_base}, versines on a chord of "
        f"{c.chord_m:g} m, curvature over {c.curvature_base_m:g} m, gradient over {c.gradient_base_m:g} m, cross-level "
        f"on {c.cross_level_base_m:g} m. Bands: 95 % (1.96 sigma). 1 sigma of the chainage up to {sure} m. A wide view "
        "is drawn by its extremes, so that no peak is lost; a narrow one shows every row."
    )


def _errors(result: Result, against: Against | None) -> pd.DataFrame:
    """Return the errors of the geometry, in the order of its chart; no columns where there are none."""
    if against is None or result.geometry.empty:
        return pd.DataFrame()
    errors = against.geometry_errors
    shown = [channel.column for channel in channels(result.geometry) if f"{channel.column}_sd" in errors]
    return errors[[*PLACE, *(name for column in shown for name in (column, f"{column}_sd"))]]


def _motion(result: Result, against: Against | None) -> PageSection:
    blocks: list[Block] = [Drawing(motion_strips(result), note=f"Bands: 95 % (1.96 sigma). {SHADES}")]
    if against is not None:
        errors = against.trajectory_errors
        chart = error_strips(errors, result.events)
        if chart is not None:
            start = "" if against.knows_its_start else " Places count from the true start: no fix said where it is."
            note = f"Estimate less truth; bands: 95 % of the claimed sigmas, about zero. {SHADES}{start}"
            blocks += [Drawing(chart, title="Errors of the trajectory", note=note), error_table(errors)]
    return PageSection("motion", "Attitude, speed and position", tuple(blocks), "Motion")


def _consistency(result: Result, against: Against | None) -> PageSection:
    blocks: list[Block] = [sensor_facts(result)]
    if result.summary.noise_ratios:
        note = (
            "Of the residuals of each group of factors, 1 is right. Above 2 (red) the noise is larger than assumed and "
            "the sigmas are too small; far below 1 a bound was cautious."
        )
        blocks.append(
            Drawing(noise_bars(result.summary.noise_ratios), title="Residuals against their sigmas", note=note)
        )
    else:
        blocks.append(Text("No group of factors has enough redundancy to judge its own noise."))
    if against is not None:
        errors = _errors(result, against)
        for title, table in (("geometry", errors), ("trajectory", against.trajectory_errors)):
            chart = histograms(table)
            if chart is not None:
                note = (
                    "Bars: the share of rows. Line: a normal distribution, which sigmas that are right follow over "
                    "many runs. Rows of one run depend on each other, so that one run may stand beside it."
                )
                blocks += [Drawing(chart, title=f"Error over sigma: {title}", note=note), coverage_table(table)]
    return PageSection("consistency", "Are the sigmas right?", tuple(blocks), "Sigmas")


def _map(result: Result, against: Against | None, along: _Along) -> PageSection:
    behind = along.background
    truth = None if against is None else against.trajectory
    chart = path_map(result, truth, along.marks(result), behind.lines, behind.points)
    circles = "Circles with km are chainages, those with numbers the curves of the table."
    note = f"Local coordinates, equal scales. {circles}"
    return PageSection("map", "Map of the path", (Drawing(chart, note=note),), "Map")


def _made(result: Result, command: str) -> PageSection:
    page = result.summary
    versions = Facts(tuple(page.versions.items()))
    default = dict(leaves(SmoothConfig().model_dump(mode="json")))
    settings = list(leaves(page.configuration))
    changed = [(key, value) for key, value in settings if value != default.get(key)]
    origin = (
        "All settings are the defaults."
        if not changed
        else "Other than the defaults: " + ", ".join(f"{key} = {_setting(value)}" for key, value in changed)
    )
    blocks: tuple[Block, ...] = (
        Text("This page was made by"),
        Code(command),
        Text(f"from what trackfg {'import' if page.solver is None else 'smooth'} wrote with these versions:"),
        versions,
        Text(origin + "." if changed else origin),
        Fold("All settings", (Columns(tuple(_settings(settings, default))),)),
    )
    return PageSection("made", "How it was made", blocks, "Made")


def _settings(settings: Iterable[tuple[str, Any]], default: Mapping[str, Any]) -> Iterator[PageTable]:
    """Yield a table for each section of the settings; what differs from its default is marked."""
    for section, keys in groupby(settings, key=lambda setting: setting[0].partition(".")[0]):
        rows = tuple(
            TableRow(
                (key.partition(".")[2], _setting(value), _setting(default.get(key))),
                mark="own" if value != default.get(key) else "",
            )
            for key, value in keys
        )
        yield PageTable(("setting", "value", "default"), rows, caption=section)


def _setting(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_setting(item) for item in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else NONE if value is None else str(value)
