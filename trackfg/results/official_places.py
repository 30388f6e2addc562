"""Official places beside the chainages of tables, where the line has them or they are asked for (``--km``)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import pandas as pd
from pydantic import JsonValue, ValidationError

from trackfg.errors import BadInputError
from trackfg.recording.findings import Finding
from trackfg.recording.line_kilometrage import LineKilometrage

if TYPE_CHECKING:
    from trackfg.numerics.chainage.kilometrage import Kilometrage
    from trackfg.results.result import Result

KM_COLUMN = "km"
"""Heads the column of official places."""

_OUTSIDE_M = 2000.0
"""Distance, m, from which a run lies outside a kilometrage: more than a mile, which is the longest between posts."""

_HINT = "Hint: add it to recording.toml (docs/kilometrage.md) and smooth again"


def shown_kilometrage(result: Result, wanted: bool | None) -> LineKilometrage | None:
    """Return the kilometrage of a result's line where official places are ``wanted``; with None, where it has one.

    Raises :class:`BadInputError` where they are wanted and its recording has none.
    """
    given = None if result.summary.run is None else result.summary.run.kilometrage
    return line_kilometrage(result) if wanted else given if wanted is None else None


def line_kilometrage(result: Result) -> LineKilometrage:
    """Return the kilometrage of a result's line. Raises :class:`BadInputError` where its recording has none."""
    given = None if result.summary.run is None else result.summary.run.kilometrage
    if given is None:
        what = f"{result.summary.recording_id}: its recording says nothing of the line's kilometrage"
        raise BadInputError(f"{what}: expected [kilometrage]. {_HINT}")
    return given


def unplaced(chainage: pd.Series, given: LineKilometrage) -> tuple[Finding, ...]:
    """Return a warning where chainages that count from a run's start lie outside the kilometrage of its line."""
    placed = [entry.chainage_m for entry in (*given.equation, *given.post)]
    low, high = float(chainage.min()), float(chainage.max())
    begin, end = min(placed, default=low), high if given.end_chainage_m is None else given.end_chainage_m
    if max(begin - high, low - end) < _OUTSIDE_M:
        return ()
    counted = f"chainage counts from the start of the run, {round(low)} to {round(high)} m"
    extent = f"begins at {begin:.0f} m" if begin > high else f"ends at {end:.0f} m"
    hint = "give fixes, a map (--map), or in [kilometrage] an equation for the place where the run begins, chainage 0"
    what = f"{counted}, but [kilometrage] {extent}: official places are not where the run was"
    return (Finding("warning", "kilometrage", what, hint=hint),)


def kilometrage_of_map(
    name: str, configuration: Mapping[str, JsonValue], wanted: bool | None = True
) -> LineKilometrage | None:
    """Return the kilometrage of a map, by its configuration: that of the first run that has one.

    None where official places are not ``wanted``, and with None where no run has one. Raises :class:`BadInputError`
    where they are wanted and no run has one.
    """
    if wanted is False:
        return None
    for settings in configuration.values():
        if isinstance(settings, dict) and "kilometrage" in settings:
            try:
                return LineKilometrage.model_validate_json(json.dumps(settings["kilometrage"]))
            except ValidationError as error:
                raise BadInputError(f"map {name!r}: its kilometrage is damaged: {error.errors()[0]['msg']}") from error
    if wanted is None:
        return None
    what = f"map {name!r}: no run in it says anything of the line's kilometrage"
    raise BadInputError(f"{what}: expected [kilometrage] in one of the recordings. {_HINT}, and build the map anew")


def with_km(table: pd.DataFrame, kilometrage: Kilometrage | None, *, of: str = "chainage_m") -> pd.DataFrame:
    """Return the table with the official places of its column ``of``, as text, in a column ``km`` after that.

    Without a kilometrage it is the table as it is.
    """
    if kilometrage is None:
        return table
    column = list(table.columns).index(of)
    shown = table.copy(deep=False)
    shown.insert(column + 1, KM_COLUMN, pd.Series(kilometrage.written(table[of].to_numpy()), table.index, dtype="str"))
    return shown
