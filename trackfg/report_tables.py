"""What the command line shows, as rich tables: one function per table."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from trackfg.findings import Finding
from trackfg.results import Estimate, Result, VectorEstimate

if TYPE_CHECKING:
    from trackfg.check import CheckReport

_COLOUR = {"error": "bold red", "warning": "yellow", "info": "cyan"}


def outages(scores: pd.DataFrame) -> RenderableType:
    """The table of :func:`trackfg.evaluate.score_outages`."""
    table = _table("Horizontal error at the withheld positions, m")
    for heading in ("outage, s", "positions", "rms", "max", "mean 1 sigma", "straight line, rms"):
        table.add_column(heading, justify="right")
    for start, end, positions, *errors in scores.itertuples(index=False, name=None):
        every = math.isnan(start)
        table.add_row(
            "all" if every else f"{start:.0f} - {end:.0f}",
            str(positions),
            *(f"{error:.2f}" for error in errors),
            style="bold" if every else "",
        )
    return table


def scenarios(summaries: Mapping[str, str]) -> RenderableType:
    """Name and one line of each scenario."""
    table = _table("Scenarios")
    table.add_column("name", no_wrap=True)
    table.add_column("what it is")
    for name, text in summaries.items():
        table.add_row(Text(name), Text(text))
    return table


def findings(found: Sequence[Finding]) -> RenderableType:
    """Worst first, each with its place and mend; a line where there is none."""
    if not found:
        return Text("Nothing to report: the recording is sound.")
    table = _table("Findings", show_lines=True)
    for heading in ("", "where", "what", "mend"):
        table.add_column(heading, overflow="fold")
    for finding in sorted(found, key=lambda one: list(_COLOUR).index(one.level)):
        expected = f"; expected {finding.expected}" if finding.expected else ""
        table.add_row(
            Text(finding.level, style=_COLOUR[finding.level]),
            Text(finding.place),
            Text(finding.message + expected),
            Text(finding.mend or ""),
        )
    return table


def estimates(values: Mapping[str, Any]) -> RenderableType:
    """What the data say by themselves, one row per value."""
    table = _table("Estimated from the data")
    table.add_column("quantity", no_wrap=True)
    table.add_column("value")
    for name, value in _leaves(values):
        table.add_row(Text(name), Text(_text(value)))
    return table


def check_json(report: CheckReport) -> str:
    """Findings and estimates as JSON."""
    content = {"findings": [asdict(finding) for finding in report.findings], "estimates": report.estimates}
    return json.dumps(content, indent=2)


def summary(result: Result) -> RenderableType:
    """The run in a dozen lines."""
    page = result.summary
    rows = {
        "recording": page.recording_id,
        "length": f"{page.duration_s:.1f} s, {page.distance_m:.1f} m",
        "solver": f"{page.solver.reason} ({page.solver.iterations} iterations, {page.keyframes} keyframes)",
        "cost": f"{page.solver.cost:.1f} at {page.solver.degrees_of_freedom} degrees of freedom",
        "wheel scale": _estimate(page.wheel_scale),
        "clock offset": _estimate(page.clock_offset_s, "s"),
        "gyro bias": _vector(page.gyro_bias_radps, math.degrees(1.0) * 3600.0, "deg/h"),
        "accelerometer bias": _vector(page.accel_bias_mps2, 1000.0, "mm/s^2"),
        "events": _counts(result.events["kind"]),
        "findings": _counts(finding.level for finding in page.findings),
        "time": ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in page.timings_s.items()),
    }
    table = _table("Summary", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for name, value in rows.items():
        if value:
            table.add_row(name, Text(value))
    return table


def _table(title: str, **options: Any) -> Table:
    return Table(title=title, title_justify="left", title_style="bold", **options)


def _estimate(estimate: Estimate | None, unit: str = "") -> str:
    return f"{estimate.value:.6f} ± {estimate.sd:.6f} {unit}".rstrip() if estimate else ""


def _vector(estimate: VectorEstimate, scale: float, unit: str) -> str:
    pairs = zip(estimate.value, estimate.sd, strict=True)
    return ", ".join(f"{scale * value:.2f} ± {scale * sd:.2f}" for value, sd in pairs) + f" {unit}"


def _counts(values: Iterable[str]) -> str:
    counted = pd.Series(list(values), dtype="str").value_counts()
    return ", ".join(f"{number} {value}" for value, number in counted.items()) or "none"


def _leaves(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_text(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
