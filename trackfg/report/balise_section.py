"""The section of a page about balises with ids: where each is planned and measured, and which plans are wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import pandas as pd

from trackfg.report.numbers import NONE, with_sd
from trackfg.report.page import PageSection, PageTable, TableRow, Text, folded_if_long
from trackfg.results.result import Result

_BAD: dict[str, Literal["error", "warning"]] = {"wrong": "error", "undecided": "warning"}
_HEADINGS = ("id", "passages", "planned, m", "measured, m", "difference, m", "sigmas", "verdict")


def balise_sections(result: Result) -> Iterator[PageSection]:
    """Yield the section of a run that passed balises with ids; nothing for others."""
    table = result.balises
    if table.empty:
        return
    counts = ", ".join(f"{count} {verdict}" for verdict, count in table["verdict"].value_counts().items())
    rows = tuple(_row(row) for _, row in table.iterrows())
    blocks = folded_if_long(PageTable(_HEADINGS, rows, numbers=frozenset(range(1, 6))), "balises")
    yield PageSection("balises", "Balises", (Text(f"{len(table)} balises: {counts}."), *blocks))


def _row(row: pd.Series) -> TableRow:
    pairs = (_measure(row[name], row[f"{name}_sd"]) for name in ("planned_m", "measured_m", "difference_m"))
    sigmas = float(row["sigmas"])
    cells = (str(row["id"]), f"{row['passes']:.0f}", *pairs, NONE if math.isnan(sigmas) else f"{sigmas:+.1f}")
    verdict = str(row["verdict"])
    return TableRow((*cells, verdict), mark=_BAD.get(verdict, ""))


def _measure(value: float, sd: float) -> str:
    return f"{value:.3f}" if math.isnan(sd) and math.isfinite(value) else with_sd(value, sd, "")
