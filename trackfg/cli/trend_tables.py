"""Tables, JSON and files of ``trackfg map trends``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from rich.console import RenderableType
from rich.text import Text

from trackfg.cli.tables import records
from trackfg.cli.terminal import titled
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.files.parquet import write_parquet

if TYPE_CHECKING:
    from trackfg.mapping.trends.trends import Trends

_HEAD = "trends.json"
_FOR_PEOPLE = ("trends", "steps", "reached")
_LARGE = ("cells", "sections", "values", "section_values")

TRENDS_FOLDER = FolderKind(
    "folder of trends",
    _HEAD,
    "trackfg-trends/",
    (_HEAD, *(f"{name}.csv" for name in _FOR_PEOPLE), *(f"{name}.parquet" for name in _LARGE)),
)


def write(found: Trends, folder: Path) -> None:
    """Write all tables into a folder, which is replaced in one step."""
    with replaced_folder(folder) as new:
        for name in _FOR_PEOPLE:
            getattr(found, name).to_csv(new / f"{name}.csv", index=False)
        for name in _LARGE:
            write_parquet(getattr(found, name), new / f"{name}.parquet")
        (new / _HEAD).write_text(as_json(found) + "\n", encoding="utf-8")


def as_json(found: Trends) -> str:
    """Return trends, steps, dates of limits, and what was left out, as JSON."""
    tables = {name: records(getattr(found, name)) for name in _FOR_PEOPLE}
    return json.dumps({"format": "trackfg-trends/1", **tables, "left_out": found.left_out}, indent=2, allow_nan=False)


def of_trends(found: Trends) -> Iterator[RenderableType]:
    """Yield tables of trends, of steps, and of when limits are reached."""
    named = (
        ("Trends, mm per month", found.trends, "No trend: the track does not change by more than noise."),
        ("Steps: work on the track, or damage", found.steps, "No step."),
        ("Limits", found.reached, ""),
    )
    for title, rows, without in named:
        if len(rows):
            yield _table(title, rows)
        elif without:
            yield Text(without)
    for name, reason in found.left_out.items():
        yield Text(f"left out: {name}: {reason}")


def _table(title: str, rows: pd.DataFrame) -> RenderableType:
    table = titled(title)
    for name in rows.columns:
        table.add_column(name.replace("_", " "), justify="left" if rows[name].dtype.kind in "OTU" else "right")
    for row in rows.itertuples(index=False):
        table.add_row(*(f"{value:.2f}" if isinstance(value, float) else str(value) for value in row))
    return table
