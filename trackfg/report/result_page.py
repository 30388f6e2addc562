"""The page of a result: is it to be trusted, what was measured, and how it was made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.evaluation.scores import PLACE
from trackfg.geometry.exceedances import Judgement
from trackfg.numerics.kilometrage import Kilometrage
from trackfg.report.balise_section import balise_sections
from trackfg.report.consistency import band_table, coverage_table, error_table, histograms, noise_bars
from trackfg.report.exceedances import exceedance_section
from trackfg.report.flatten import leaves
from trackfg.report.geometry_charts import channels, geometry_strips
from trackfg.report.kilometrage_section import kilometrage_sections
from trackfg.report.motion_charts import SHADES, error_strips, motion_strips, path_map
from trackfg.report.numbers import NONE, digits, duration, length, percent, with_sd
from trackfg.report.page import (
    Block,
    Code,
    Drawing,
    Facts,
    Fold,
    Page,
    PageSection,
    PageTable,
    TableRow,
    Text,
    Tile,
    Tiles,
)
from trackfg.report.truth import Against
from trackfg.results.official_places import KM_COLUMN, with_km
from trackfg.results.result import Result
from trackfg.results.summary import Estimate, Solver, Summary, VectorEstimate
from trackfg.results.verdict import causes, opinions

if TYPE_CHECKING:
    from trackfg.recording.line_kilometrage import LineKilometrage

_DEG_PER_HOUR = math.degrees(1.0) * 3600.0
"""From rad/s to deg/h."""
_MANY_EVENTS = 25
"""A table of more events is folded."""
_BANDED = ("cross_level_mm", "twist_mm", "level_mm", "alignment_mm", "versine_level_mm", "versine_alignment_mm")
_LEVELS = ("error", "warning", "info")


def result_page(
    result: Result,
    command: str,
    against: Against | None,
    judgement: Judgement | None = None,
    line: LineKilometrage | None = None,
) -> Page:
    """Return the page of a result.

    ``command`` is what made the page; ``against`` the truth, where it is known; ``judgement`` says where the geometry
    exceeds limits, where any were given. Of a ``line`` the page has the kilometrage, and official places.
    """
    page = result.summary
    kilometrage = None if line is None else line.kilometrage()
    way = "distance not determined" if page.distance_m is None else length(page.distance_m)
    if page.solver is None:
        sections = [_measured_elsewhere(result), _findings(result), *kilometrage_sections(result, line)]
        sections += _geometry(result, against, judgement)
        subtitle = f"{way}, measured by another system, imported by trackfg {_version(result)}"
        return Page("result", page.recording_id, subtitle, (*sections, _made(result, command)))
    sections = [_summary(result, page.solver), _findings(result), *kilometrage_sections(result, line)]
    sections += _geometry(result, against, judgement)
    sections += [
        *balise_sections(result),
        _events(result, kilometrage),
        _motion(result, against),
        _consistency(result, against),
        _map(result, against),
    ]
    sections.append(_made(result, command))
    subtitle = f"{way} in {duration(page.duration_s)}, smoothed by trackfg {_version(result)}"
    return Page("result", page.recording_id, subtitle, tuple(sections))


def _measured_elsewhere(result: Result) -> PageSection:
    """Return the summary of a geometry that was not smoothed here."""
    tile = Tile("length", length(result.summary.distance_m), _extent(result))
    return PageSection("summary", "Summary", (Tiles((tile,)), _measured(result)))


def _summary(result: Result, solver: Solver) -> PageSection:
    page = result.summary
    squares = 2.0 * solver.cost / solver.degrees_of_freedom if solver.degrees_of_freedom > 0 else math.nan
    tiles = [
        Tile("length", length(page.distance_m), _extent(result)),
        Tile("duration", duration(page.duration_s), f"{page.keyframes} keyframes"),
        Tile("mean speed", _mean_speed(page)),
        Tile("squared residual per degree of freedom", digits(squares), "1 is right; less: cautious"),
        Tile("wheel scale", _estimate(page.wheel_scale), "true over nominal distance"),
        Tile("computed in", f"{sum(page.timings_s.values()):.1f} s", _per_km(result)),
    ]
    verdict = (
        Text(f"The solver converged: {solver.reason} ({solver.iterations} iterations).", "good")
        if solver.converged
        else Text(f"The solver did not converge: {solver.reason}. Do not trust the sigmas.", "warning")
    )
    facts = (
        ("recording", page.recording_id),
        ("clock offset of the tachometer", _estimate(page.clock_offset_s, "s")),
        ("gyro bias x, y, z at the end", _vector(page.gyro_bias_radps, _DEG_PER_HOUR, "deg/h")),
        ("accelerometer bias x, y, z at the end", _vector(page.accel_bias_mps2, 1000.0, "mm/s²")),
        ("cost", f"{solver.cost:.1f} at {solver.degrees_of_freedom} degrees of freedom"),
        ("time by stage", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in page.timings_s.items())),
    )
    blocks: list[Block] = [
        verdict,
        *_verdicts(page),
        Tiles(tuple(tiles)),
        Facts(tuple((k, v) for k, v in facts if v != NONE)),
    ]
    if not result.geometry.empty:
        blocks.append(_measured(result))
    return PageSection("summary", "Summary", tuple(blocks))


def _verdicts(page: Summary) -> Iterator[PageTable]:
    """Return what can be believed, the worst first, and why; nothing for results of older versions."""
    found = page.verdicts
    if found:
        rows = (
            TableRow((one.verdict, ", ".join(one.quantities)), mark="" if one.verdict == "trusted" else "warning")
            for one in opinions(found)
        )
        yield PageTable(("verdict", "quantities"), tuple(rows), caption="Can the sigmas be trusted?")
        reasons = (TableRow((cause.reason, ", ".join(cause.quantities), cause.hint)) for cause in causes(found))
        yield PageTable(("what is seen", "concerns", "what to do"), tuple(reasons), caption="Why?")


def _extent(result: Result) -> str:
    if result.geometry.empty:
        return "no geometry"
    first, last = result.geometry["chainage_m"].iloc[[0, -1]]
    return f"chainage {first / 1000.0:.3f} – {last / 1000.0:.3f} km"


def _mean_speed(page: Summary) -> str:
    if page.distance_m is None or page.duration_s <= 0.0:
        return NONE
    return f"{3.6 * page.distance_m / page.duration_s:.1f} km/h"


def _per_km(result: Result) -> str:
    if not result.summary.distance_m:
        return ""
    return f"{1000.0 * sum(result.summary.timings_s.values()) / result.summary.distance_m:.2f} s per km"


def _version(result: Result) -> str:
    return result.summary.versions.get("trackfg", "")


def _measured(result: Result) -> PageTable:
    rows = []
    for channel in channels(result.geometry):
        values = channel.scale * result.geometry[channel.column].to_numpy()
        known = values[np.isfinite(values)]
        sigmas = channel.scale * result.geometry.get(f"{channel.column}_sd", pd.Series(dtype=float)).to_numpy()
        sigmas = sigmas[np.isfinite(sigmas)]
        typical, poor = np.quantile(sigmas, [0.5, 0.95]) if sigmas.size else (math.nan, math.nan)
        low, high = (known.min(), known.max()) if known.size else (math.nan, math.nan)
        cells = (digits(low), digits(high), digits(typical), digits(poor), percent(known.size / values.size))
        rows.append(TableRow((channel.label.replace("\n", " "), channel.unit, *cells)))
    return PageTable(
        ("quantity", "unit", "least", "greatest", "1 sigma, median", "1 sigma, 95 % below", "of the length"),
        tuple(rows),
        numbers=frozenset(range(2, 7)),
        caption="What was measured",
    )


def _findings(result: Result) -> PageSection:
    found = sorted(result.summary.findings, key=lambda finding: _LEVELS.index(finding.level))
    if not found:
        return PageSection(
            "findings", "Data quality", (Text("Reading the recording found nothing to report.", "good"),)
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
        for finding in found
    )
    return PageSection("findings", "Data quality", (PageTable(("level", "where", "what", "hint"), rows),))


def _events(result: Result, kilometrage: Kilometrage | None) -> PageSection:
    events = with_km(result.events, kilometrage)
    if events.empty:
        return PageSection("events", "Events", (Text("None."),))
    counts = ", ".join(f"{number} {kind}" for kind, number in events["kind"].value_counts().items())
    rows = tuple(
        TableRow(
            (
                event["kind"],
                f"{event['start_s']:.1f}",
                f"{event['end_s'] - event['start_s']:.1f}" if event["end_s"] > event["start_s"] else NONE,
                *([event[KM_COLUMN]] if KM_COLUMN in event else []),
                _measure(event["chainage_m"], event["chainage_m_sd"]),
                _measure(event["distance_removed_m"], event["distance_removed_m_sd"]),
                event["detail"],
            )
        )
        for event in events.to_dict("records")
    )
    place = ("km", "chainage, m") if KM_COLUMN in events else ("chainage, m",)
    headings = ("event", "start, s", "duration, s", *place, "distance removed, m", "detail")
    table = PageTable(headings, rows, numbers=frozenset(range(1, len(headings) - 1)))
    blocks: tuple[Block, ...] = (Text(f"{counts}."), table)
    if len(rows) > _MANY_EVENTS:
        blocks = (Text(f"{counts}."), Fold(f"All {len(rows)} events", (table,)))
    return PageSection("events", "Events", blocks)


def _measure(value: float, sd: float) -> str:
    return with_sd(value, sd, "") if math.isfinite(value) else NONE


def _geometry(result: Result, against: Against | None, judgement: Judgement | None) -> Iterator[PageSection]:
    if result.geometry.empty:
        text = "The run says nothing of the track: there is no geometry. docs/results.md says when that is so."
        yield PageSection("geometry", "Track geometry", (Text(text),))
        return
    errors = _errors(result, against)
    strips, error_chart = geometry_strips(result, errors, judgement)
    c = result.summary.geometry
    sure = digits(float(result.geometry["chainage_m_sd"].max()))
    note = (
        f"Left and right facing {c.facing}. Positive: up, to the left, left rail higher, uphill. Level and alignment "
        f"in the band {c.band_m[0]:g}-{c.band_m[1]:g} m, twist on {c.twist_base}, versines on a chord of "
        f"{c.chord_m:g} m, curvature over {c.curvature_base_m:g} m, gradient over {c.gradient_base_m:g} m, cross-level "
        f"on {c.cross_level_base_m:g} m. Bands: 95 % (1.96 sigma). 1 sigma of the chainage up to {sure} m. A wide view "
        "is drawn by its extremes, so that no peak is lost; a narrow one shows every row."
    )
    yield PageSection("geometry", "Track geometry", (Drawing(strips, note=note),))
    if judgement is not None:
        yield exceedance_section(judgement)
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
    yield PageSection("errors", "Errors of the geometry", blocks)


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
            note = f"Estimate less truth; bands: 95 % of the claimed sigmas, about zero. {SHADES}"
            blocks += [Drawing(chart, title="Errors of the trajectory", note=note), error_table(errors)]
    return PageSection("motion", "Attitude, speed and position", tuple(blocks))


def _consistency(result: Result, against: Against | None) -> PageSection:
    blocks: list[Block] = []
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
    return PageSection("consistency", "Are the sigmas right?", tuple(blocks))


def _map(result: Result, against: Against | None) -> PageSection:
    chart = path_map(result, None if against is None else against.trajectory)
    note = "Local coordinates, equal scales. Circles are chainages."
    return PageSection("map", "Map of the path", (Drawing(chart, note=note),))


def _made(result: Result, command: str) -> PageSection:
    page = result.summary
    versions = Facts(tuple(page.versions.items()))
    default = dict(leaves(SmoothConfig().model_dump(mode="json")))
    settings = list(leaves(page.configuration))
    changed = [(key, value) for key, value in settings if value != default.get(key)]
    rows = tuple(
        TableRow((key, _setting(value), _setting(default.get(key))), mark="own" if value != default.get(key) else "")
        for key, value in settings
    )
    said = (
        "All settings are the defaults."
        if not changed
        else "Other than the defaults: " + ", ".join(f"{key} = {_setting(value)}" for key, value in changed)
    )
    blocks: tuple[Block, ...] = (
        Text("This page was made by"),
        Code(command),
        Text(f"from what trackfg {'import' if page.solver is None else 'smooth'} wrote with these versions:"),
        versions,
        Text(said + "." if changed else said),
        Fold("All settings", (PageTable(("setting", "value", "default"), rows),)),
    )
    return PageSection("made", "How it was made", blocks)


def _setting(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_setting(item) for item in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else NONE if value is None else str(value)


def _estimate(estimate: Estimate | None, unit: str = "") -> str:
    return NONE if estimate is None else with_sd(estimate.value, estimate.sd, unit)


def _vector(estimate: VectorEstimate | None, scale: float, unit: str) -> str:
    if estimate is None:
        return NONE
    sds: tuple[float | None, ...] = (None,) * 3 if estimate.sd is None else tuple(scale * sd for sd in estimate.sd)
    pairs = zip(estimate.value, sds, strict=True)
    return ", ".join(with_sd(scale * value, sd, "") for value, sd in pairs) + f" {unit}"
