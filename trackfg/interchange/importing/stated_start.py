"""The date at which a clock from a zero of its own counts 0, as lines above a table state it."""

from __future__ import annotations

import re
from datetime import datetime, tzinfo
from typing import NamedTuple

from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import as_ns

_DATE = re.compile(
    r"\b(?:(?P<y>20\d\d)-(?P<m>\d\d)-(?P<d>\d\d)|(?P<D>\d{1,2})\.(?P<M>\d{1,2})\.(?P<Y>20\d\d))[T,;\t ]{1,3}"
    r"(?P<clock>\d{1,2}:\d\d:\d\d(?:[.,]\d{1,6})?)\s?(?P<zone>Z\b|UTC\b|GMT\b|[+-]\d\d:?\d\d)?"
)
"""A date with a time of day; one with slashes has its day first or its month."""


class StatedStart(NamedTuple):
    """A date as ISO 8601 writes it, and its offset from UTC; None where none is stated."""

    date: str
    offset: str | None

    def ns(self, zone: tzinfo) -> int:
        """Return it in ns since 1970; ``zone`` is where it was written unless its offset is stated."""
        if self.offset is not None:
            return as_ns(datetime.fromisoformat(f"{self.date}{self.offset}"))
        return as_ns(datetime.fromisoformat(self.date).replace(tzinfo=zone))


def stated_start(table: SourceTable) -> StatedStart | None:
    """Return the one date with a time of day that lines above a table state; None without any, or with several."""
    dates = {_start_of(match) for match in _DATE.finditer(table.remarks)} - {None}
    return dates.pop() if len(dates) == 1 else None


def _start_of(match: re.Match[str]) -> StatedStart | None:
    year, month, day = (int(match[a] or match[b]) for a, b in ("yY", "mM", "dD"))
    hour, _, rest = match["clock"].replace(",", ".").partition(":")
    date = f"{year}-{month:02d}-{day:02d}T{hour:0>2}:{rest}"
    offset = None if match["zone"] is None else re.sub("UTC|GMT|Z", "+00:00", match["zone"])
    try:
        datetime.fromisoformat(f"{date}{offset or ''}")
    except ValueError:
        return None
    return StatedStart(date, offset)
