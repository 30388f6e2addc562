"""The runs of two lines over a year: defects grow month by month until tamping in month 7 takes them away."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import scenario, simulate

LINES, MONTHS, TAMPED_IN = 2, 12, 7
_DEFECTS_AT_M = (60.0, 120.0, 180.0)
_GROWTH_M = 0.0015
"""Growth of a defect in a month, m."""


def write_runs(folder: Path, runs: int, seconds: float) -> Path:
    """Write recordings and the catalogue of them; what is there already stays. Returns the catalogue's path."""
    rows = []
    for number in range(runs):
        line, month = number % LINES, number // LINES % MONTHS + 1
        place = folder / f"line{line + 1}-{number:04d}"
        rows.append({"recording": place.name, "line": f"{line + 1}", "tags": f"month {month}", "run": place.name})
        if not place.exists():
            _write(place, line, month, number, seconds)
    table = folder / "runs.csv"
    pd.DataFrame(rows).to_csv(table, index=False)
    return table


def _write(place: Path, line: int, month: int, number: int, seconds: float) -> None:
    day = number % 28 + 1
    months = month + day / 30.0
    grown = _GROWTH_M * (months - TAMPED_IN if month >= TAMPED_IN else months - 1.0)
    defects = tuple(Defect("dip", at_m=at, size_m=grown, length_m=6.0) for at in _DEFECTS_AT_M)
    plan = replace(scenario("measuring-car"), defects=defects)
    simulate(plan, seed=line + 1, run=number, duration_s=seconds).write(place)
    toml = place / "recording.toml"
    toml.write_text(f"start = 2026-{month:02d}-{day:02d}T03:12:00Z\n{toml.read_text()}")
