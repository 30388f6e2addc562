"""Events of a run: what happened on it and when, found by a batch or on a stream."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from operator import attrgetter

import numpy as np
import pandas as pd

from trackfg.errors import printable
from trackfg.results.columns import EVENT_COLUMNS

DOUBT = "sigmas-doubted"
"""The kind of event that names quantities whose sigmas are too small."""


@dataclass(frozen=True)
class Event:
    """An event is one fact about a stretch of a run.

    ``table`` is the table of the recording that it concerns, empty for none. ``t_s`` and ``until_s`` are the first and
    the last time that it concerns, on the run's clock, None where no time could be read. ``rows`` counts rows (or
    lines) of a stream that were not passed on because of it. Where the estimator knows them, the chainage (m) at the
    first time, and the distance (m) that a slip added or a slide hid; with 1-sigma.
    """

    kind: str
    table: str = ""
    t_s: float | None = None
    until_s: float | None = None
    rows: int = 0
    detail: str = ""
    chainage_m: float | None = None
    chainage_m_sd: float | None = None
    distance_removed_m: float | None = None
    distance_removed_m_sd: float | None = None

    def __post_init__(self) -> None:
        """Escape control characters: names come from the input, and must not reach a terminal as they are."""
        for name in ("kind", "table", "detail"):
            text = getattr(self, name)
            if not text.isprintable():
                object.__setattr__(self, name, printable(text))

    @property
    def span_s(self) -> tuple[float, float]:
        """The first and the last time, s; NaN where none could be read."""
        return np.nan if self.t_s is None else self.t_s, np.nan if self.until_s is None else self.until_s

    def __str__(self) -> str:
        where = f"{self.table}: " if self.table else ""
        when = "" if self.t_s is None else f" at t = {self.t_s:.3f} s"
        if self.t_s is not None and self.until_s is not None and self.until_s > self.t_s:
            when = f" from t = {self.t_s:.3f} to {self.until_s:.3f} s"
        count = "" if self.rows == 0 else f", {self.rows} row{'s' if self.rows > 1 else ''}"
        place = "" if self.chainage_m is None else f" at {self.chainage_m:.1f} m"
        removed = "" if self.distance_removed_m is None else f", {self.distance_removed_m:+.2f} m"
        return f"{where}{self.kind}{when}{place}{removed}{count}" + (f": {self.detail}" if self.detail else "")


def doubt_event(
    quantities: Iterable[str],
    reason: str,
    advice: str,
    *,
    t_s: float | None,
    until_s: float | None = None,
    table: str = "",
) -> Event:
    """Return the event that sigmas of ``quantities`` are too small, for a ``reason``, with ``advice`` on what to do.

    ``t_s``: since when, or the time of which all that came before is doubted.
    """
    return Event(DOUBT, table, t_s, until_s, detail=f"{', '.join(quantities)}: {reason}: {advice}")


_TYPES = {field.name: {"str": "str", "int": "int64"}.get(str(field.type), "float64") for field in fields(Event)}


def events_frame(events: Iterable[Event]) -> pd.DataFrame:
    """Return a table of one row per event and one column per field, NaN for what is not known."""
    columns = list(zip(*map(attrgetter(*_TYPES), events), strict=True)) or [()] * len(_TYPES)
    made = zip(_TYPES.items(), columns, strict=True)
    return pd.DataFrame({name: pd.Series(values, dtype=kind) for (name, kind), values in made})


def no_events() -> pd.DataFrame:
    """Return an event table without rows."""
    return pd.DataFrame(
        {name: pd.Series(dtype="str" if name in ("kind", "detail") else "float64") for name in EVENT_COLUMNS}
    )
