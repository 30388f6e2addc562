"""The date at which a clock from a zero of its own counts 0, where other tables have dates."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question, asked
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stated_start import stated_start
from trackfg.interchange.importing.times.clock import Times
from trackfg.interchange.importing.times.reading import times_by_keys
from trackfg.interchange.importing.times.zones import is_zone, states_zone

_STATES_ZONE = re.compile(r"utc|gmt|gps|gnss")
"""Names of times of day that a receiver writes."""
_FIRST_ROWS = 100
"""Rows that show whether a table has dates."""


def propose_start(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Ask for the date at which a clock counts 0 that has none beside others that have.

    Where lines above its table state it, the zone is asked if they do not.
    """
    if any(table.start_ns is not None for table in tables):
        return
    clocks = list(_clocks(proposal, tables))
    undated = [(section, table) for section, table, times in clocks if times.have_own_zero]
    if not undated or not any(times.ns is not None for *_, times in clocks):
        return
    starts = [(section, table, start) for section, table in undated if (start := stated_start(table)) is not None]
    if not starts:
        table = undated[0][1].name
        text = f"Date and time at which {table} counts 0, with its zone, as 2026-05-01T03:12:00+02:00"
        expected = "a date with its zone, such as 2026-05-01T03:12:00Z"
        question = Question("start", text, "", accepts=lambda answer: _date(answer) is not None, expected=expected)
        proposal.sections["start"] = _date(asked(ask, question))
    elif all(start.offset is None for *_, start in starts):
        zone = next((section["time_zone"] for section, *_ in clocks if "time_zone" in section), None)
        text = f"Time zone of {starts[0][2].date}, at which {starts[0][1].name} counts 0 (UTC, Europe/Zurich, ...)"
        expected = "a zone such as Europe/Zurich"
        question = Question("time_zone", text, "UTC", accepts=is_zone, expected=expected)
        starts[0][0]["time_zone"] = zone or asked(ask, question)


def clocks_of(proposal: Proposal, tables: Sequence[SourceTable]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the sections whose times are dates, and those whose times of day, in text, state no zone."""
    clocks = list(_clocks(proposal, tables))
    dated = [section for section, _, times in clocks if times.ns is not None]
    of_day = [section for section, table, times in clocks if times.zone is not None and _is_clock(table, section)]
    return dated, of_day


def _is_clock(table: SourceTable, section: dict[str, Any]) -> bool:
    """Return whether times are written as times of day whose zone neither they nor their column's name state."""
    name = section["time"]
    if not isinstance(name, str) or "time_zone" in section or _STATES_ZONE.search(name.casefold()):
        return False
    cells = table.frame[name].dropna()
    return bool(pd.api.types.is_string_dtype(cells) and len(cells) and not states_zone(str(cells.iloc[0]).strip()))


def _clocks(proposal: Proposal, tables: Sequence[SourceTable]) -> Iterator[tuple[dict[str, Any], SourceTable, Times]]:
    """Yield each section, its table, the gyro's of two, and its first times as far as these can be read."""
    named = {table.name: table for table in tables}
    for section in (part for part in proposal.sensors if "time" in part):
        table = named.get(section["file"] if isinstance(section["file"], str) else section["file"][0])
        if table is None:
            continue
        part = replace(table, frame=table.frame.head(_FIRST_ROWS))
        try:
            yield section, table, times_by_keys(part, section)
        except BadInputError:  # reading it whole says so
            continue


def _date(answer: str) -> datetime | None:
    """Return the date of an answer; None where it is none, or in no zone."""
    try:
        date = datetime.fromisoformat(answer.strip())
    except ValueError:
        return None
    return None if date.tzinfo is None else date.astimezone(UTC)
