"""The first section of a result's page: what can be trusted, and the run in figures."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from trackfg.errors import counted
from trackfg.numerics.units import DEG_PER_H, KMH
from trackfg.report.geometry_charts import channels
from trackfg.report.numbers import NONE, decimals, digits, duration, fixed, length, percent, with_sd, with_unit
from trackfg.report.page import Block, Facts, PageSection, PageTable, Signature, TableRow, Text, Tile, Tiles
from trackfg.results.result import Result
from trackfg.results.summary import Estimate, Solver, Summary, VectorEstimate
from trackfg.results.verdict import NOT_TRUSTED, Verdict, causes, opinions
from trackfg.results.widening import trusted

_SIGNED = ("Checked by", "Date", "Signature")
"""What is filled in by hand on the first sheet of paper."""


def measured_elsewhere(result: Result, headlines: tuple[Tile, ...] = ()) -> PageSection:
    """Return the summary of a geometry that was not smoothed here, below ``headlines``."""
    tiles = (*headlines, Tile("length", length(result.summary.distance_m), _extent(result)))
    text = "Another system measured this geometry: what its sigmas are worth is not known here."
    return PageSection("summary", "Summary", (Text(text), Tiles(tiles), measured_table(result)))


def summary_section(result: Result, solver: Solver, headlines: tuple[Tile, ...] = ()) -> PageSection:
    """Return the run in figures, below ``headlines``, the verdict, and what each quantity can be trusted for."""
    page, worst_m = result.summary, float(result.trajectory["chainage_m_sd"].max())
    place = with_unit(worst_m, "m", 2) if trusted(page.verdicts, "chainage_m") else NOT_TRUSTED
    tiles = (
        *headlines,
        Tile("length", length(page.distance_m), _extent(result)),
        Tile("measured", _begun(page), f"{duration(page.duration_s)}, {_mean_speed(page)}"),
        Tile("place, 1 sigma", place, "at worst, along the track"),
        Tile("wheel scale", _estimate(page.wheel_scale), "true over nominal distance"),
    )
    blocks: tuple[Block, ...] = (Tiles(tiles), _verdict(page, solver), *_trust(page), Signature(_SIGNED))
    return PageSection("summary", "Verdict", blocks)


def sensor_facts(result: Result) -> Facts:
    """Return what the run says of its sensors and of the solver."""
    page = result.summary
    solver = page.solver
    cost, squares = NONE, NONE
    if solver is not None:
        cost = f"{solver.cost:.1f} at {solver.degrees_of_freedom} degrees of freedom, {page.keyframes} keyframes"
        if solver.degrees_of_freedom > 0:
            squares = f"{digits(2.0 * solver.cost / solver.degrees_of_freedom)}; 1 is right, less is cautious"
    facts = (
        ("recording", page.recording_id),
        *((f"scale of {name}", _estimate(scale)) for name, scale in page.further_scales.items()),
        ("clock offset of the tachometer", _estimate(page.clock_offset_s, "s")),
        ("clock offset of positions", _estimate(page.gnss_clock_offset_s, "s")),
        ("speeds of the receiver too high by", _estimate(page.gnss_speed_offset_mps, "m/s")),
        ("clock offset of the receiver's speeds", _estimate(page.gnss_speed_clock_offset_s, "s")),
        ("gyro bias x, y, z at the end", _vector(page.gyro_bias_radps, 1.0 / DEG_PER_H, "deg/h")),
        ("accelerometer bias x, y, z at the end", _vector(page.accel_bias_mps2, 1000.0, "mm/s²")),
        ("why the solver stopped", NONE if solver is None else solver.reason),
        ("cost", cost),
        ("squared residual per degree of freedom", squares),
        ("computed in", f"{sum(page.timings_s.values()):.1f} s{_per_km(result)}"),
        ("time by stage", ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in page.timings_s.items())),
    )
    return Facts(tuple((name, value) for name, value in facts if value != NONE))


def measured_table(result: Result) -> PageTable:
    """Return what was measured: extremes and sigmas of each channel, and of how much of the length."""
    rows, verdicts = [], result.summary.verdicts
    for channel in channels(result.geometry):
        values = channel.scale * result.geometry[channel.column].to_numpy()
        finite = values[np.isfinite(values)]
        sigmas = channel.scale * result.geometry.get(f"{channel.column}_sd", pd.Series(dtype=float)).to_numpy()
        sigmas = sigmas[np.isfinite(sigmas)]
        typical, poor = np.quantile(sigmas, [0.5, 0.95]) if sigmas.size else (math.nan, math.nan)
        low, high = (finite.min(), finite.max()) if finite.size else (math.nan, math.nan)
        places = decimals(float(np.fmin(typical, max(abs(low), abs(high)) / 100.0)))
        ends = (NONE if math.isnan(value) else fixed(value, places) for value in (low, high))
        sds = (digits(typical), digits(poor)) if trusted(verdicts, channel.column) else (NOT_TRUSTED, NOT_TRUSTED)
        cells = (*ends, *sds, percent(finite.size / values.size))
        rows.append(TableRow((channel.label.replace("\n", " "), channel.unit, *cells)))
    return PageTable(
        ("quantity", "unit", "least", "greatest", "1 sigma, median", "1 sigma, 95 % below", "of the length"),
        tuple(rows),
        numbers=frozenset(range(2, 7)),
        caption="What was measured",
    )


def _verdict(page: Summary, solver: Solver) -> Text:
    """Return one sentence: whether the solver converged, and what cannot be trusted as it is."""
    if not solver.converged:
        return Text(f"The solver did not converge: {solver.reason}. Do not trust the sigmas.", "warning")
    converged = f"The solver converged in {counted(solver.iterations, 'iteration')}."
    doubted = [_named(page.verdicts, status) for status in ("not_trusted", "widened")]
    sentences = [
        f"{what}: {', '.join(names)}."
        for what, names in zip(("Not to be trusted", "Trusted with widened sigmas"), doubted, strict=True)
        if names
    ]
    if page.verdicts and not sentences:
        sentences = ["Every quantity can be trusted within its sigmas."]
    bad = sum(finding.level != "info" for finding in page.findings)
    sentences += [f"Reading the data found {counted(bad, 'thing')} to look at."] if bad else []
    return Text(" ".join([*sentences, converged]), "warning" if doubted[0] else "good")


def _named(verdicts: tuple[Verdict, ...], status: str) -> list[str]:
    return [verdict.name for verdict in verdicts if verdict.status == status]


def _trust(page: Summary) -> Iterator[PageTable]:
    """Yield what can be trusted, the worst first, and why; nothing for results of older versions."""
    verdicts = page.verdicts
    if verdicts:
        rows = (
            TableRow(
                (opinion.verdict, ", ".join(opinion.quantities)), mark="" if opinion.verdict == "trusted" else "warning"
            )
            for opinion in opinions(verdicts)
        )
        yield PageTable(("verdict", "quantities"), tuple(rows), caption="Can the sigmas be trusted?")
        why = causes(verdicts, page.findings)
        reasons = (TableRow((cause.reason, ", ".join(cause.quantities), cause.hint)) for cause in why)
        yield PageTable(("what is seen", "concerns", "what to do"), tuple(reasons), caption="Why?")


def _extent(result: Result) -> str:
    if result.geometry.empty:
        return "no geometry"
    first, last = result.geometry["chainage_m"].iloc[[0, -1]]
    return f"chainage {first / 1000.0:.3f} – {last / 1000.0:.3f} km"


def _mean_speed(page: Summary) -> str:
    if page.distance_m is None or page.duration_s <= 0.0:
        return "mean speed not determined"
    return f"{page.distance_m / page.duration_s / KMH:.1f} km/h"


def _begun(page: Summary) -> str:
    """Return when the run began, as its recording has it."""
    start = None if page.run is None else page.run.start_utc
    return "no date" if start is None else f"{start:%Y-%m-%d %H:%M} UTC"


def _per_km(result: Result) -> str:
    if not result.summary.distance_m:
        return ""
    return f", {1000.0 * sum(result.summary.timings_s.values()) / result.summary.distance_m:.2f} s per km"


def _estimate(estimate: Estimate | None, unit: str = "") -> str:
    return NONE if estimate is None else with_sd(estimate.value, estimate.sd, unit)


def _vector(estimate: VectorEstimate | None, scale: float, unit: str) -> str:
    if estimate is None:
        return NONE
    sds: tuple[float | None, ...] = (None,) * 3 if estimate.sd is None else tuple(scale * sd for sd in estimate.sd)
    pairs = zip(estimate.value, sds, strict=True)
    return ", ".join(with_sd(scale * value, sd, "") for value, sd in pairs) + f" {unit}"
