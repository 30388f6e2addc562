"""Official places beside the chainages of a result's tables."""

from __future__ import annotations

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.numerics.kilometrage import Kilometrage
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.result import Result

KM_COLUMN = "km"
"""Heads the column of official places."""


def line_kilometrage(result: Result) -> LineKilometrage:
    """Return the kilometrage of a result's line. Raises :class:`BadInputError` where its recording has none."""
    given = None if result.summary.run is None else result.summary.run.kilometrage
    if given is None:
        raise BadInputError(
            f"{result.summary.recording_id}: its recording says nothing of the line's kilometrage: expected "
            "[kilometrage]. Hint: add it to recording.toml (docs/kilometrage.md) and smooth again"
        )
    return given


def with_km(table: pd.DataFrame, kilometrage: Kilometrage) -> pd.DataFrame:
    """Return the table with the official places of ``chainage_m``, as text, in a column ``km`` after it."""
    after = table.columns.get_loc("chainage_m")
    assert isinstance(after, int)
    shown = table.copy(deep=False)
    shown.insert(after + 1, KM_COLUMN, kilometrage.written(table["chainage_m"].to_numpy()))
    return shown
