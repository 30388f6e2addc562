"""``trackfg map trends`` reads some tables besides results, and shows others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.console import RenderableType
from rich.text import Text

from trackfg.cli.terminal import titled
from trackfg.errors import BadInputError, first_line
from trackfg.files.csv_texts import read_csv_texts

if TYPE_CHECKING:
    from trackfg.mapping.trends.wear import Wear
    from trackfg.numerics.arrays import Array
    from trackfg.results.trends import Trends

_MOST_BYTES = 2**24
"""Size of a table of tonnage, bytes: a row per day of a century has 1 MB."""


def read_tonnage(path: Path) -> Wear:
    """Return the load of a table: the million tonnes ``mt`` that had passed in all at each ``date``, ascending.

    Raises :class:`BadInputError` for a file that is none, with the row.
    """
    from trackfg.mapping.trends.wear import DAY_S, Wear

    try:
        table = read_csv_texts(path, _MOST_BYTES)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: not a readable table of tonnage: {first_line(error)}") from error
    if missing := {"date", "mt"} - set(table):
        raise BadInputError(f"{path}: no column {min(missing)!r}; expected date and mt, million tonnes in all by then")
    dates = pd.to_datetime(table["date"], utc=True, errors="coerce", format="ISO8601")
    mt: Array = np.asarray(pd.to_numeric(table["mt"], errors="coerce"), dtype=np.float64)
    stamps = dates.dt.tz_localize(None).to_numpy(dtype="datetime64[us]")  # in ns, years such as 1000 overflow
    days: Array = np.where(np.isnat(stamps), np.nan, stamps.astype(np.float64) / (1e6 * DAY_S))
    for column, wrong, expected in (
        ("date", np.isnan(days), "a date such as 2026-05-01"),
        ("mt", ~np.isfinite(mt), "million tonnes"),
        ("date", np.diff(days, prepend=-np.inf) <= 0.0, "later dates from row to row"),
        ("mt", np.diff(mt, prepend=-np.inf) < 0.0, "what has passed in all: no less than in the row before"),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise BadInputError(f"{path}: row {row + 1}, column {column}: {table[column][row]!r}; expected {expected}")
    if len(mt) < 2 or mt[-1] == mt[0]:
        raise BadInputError(f"{path}: no load between the first row and the last; expected two rows and more")
    return Wear(days, mt, "mt")


def of_trends(found: Trends) -> Iterator[RenderableType]:
    """Yield tables of trends, of steps, and of when limits are reached."""
    named = (
        (f"Trends, {found.unit}", found.trends, "No trend: the track does not change by more than noise."),
        ("Steps: work on the track, or damage", found.steps, "No step."),
        ("Limits", found.reached, ""),
    )
    for title, rows, without in named:
        if len(rows):
            yield _table(title, rows)
        elif without:
            yield Text(without)
    for names, reason in found.left_out_by_reason():
        yield Text(f"left out: {'; '.join(names)}: {reason}")


def _table(title: str, rows: pd.DataFrame) -> RenderableType:
    table = titled(title)
    for name in rows.columns:
        table.add_column(name.replace("_", " "), justify="left" if rows[name].dtype.kind in "OTU" else "right")
    for row in rows.itertuples(index=False):
        table.add_row(*(f"{value:.2f}" if isinstance(value, float) else str(value) for value in row))
    return table
