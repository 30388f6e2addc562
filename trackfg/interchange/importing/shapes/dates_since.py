"""Times since a date that their unit states, ``seconds since 2026-05-01``, become dates."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable

_SINCE = re.compile(
    r"(\w+) since (\d{4}-\d{1,2}-\d{1,2}(?:[T ][\d:.]+)?)(?: ?(?:Z|UTC|[+-]?0{1,2}:?00))?", re.IGNORECASE
)
"""Times of the conventions for climate and forecast (CF), which netCDF follows."""
_NS_OF = {
    **dict.fromkeys(("day", "days", "d"), 86_400_000_000_000),
    **dict.fromkeys(("hour", "hours", "hr", "h"), 3_600_000_000_000),
    **dict.fromkeys(("minute", "minutes", "min"), 60_000_000_000),
    **dict.fromkeys(("second", "seconds", "sec", "s"), 1_000_000_000),
    **dict.fromkeys(("millisecond", "milliseconds", "msec", "ms"), 1_000_000),
    **dict.fromkeys(("microsecond", "microseconds", "us"), 1_000),
    **dict.fromkeys(("nanosecond", "nanoseconds", "ns"), 1),
}
"""Their units, ns."""


def with_dates(table: SourceTable) -> SourceTable:
    """Return a table with times since a date, ``seconds since 2026-05-01``, as ns since 1970."""
    for name, unit in table.units.items():
        match = _SINCE.fullmatch(unit.strip())
        ns = None if match is None else _NS_OF.get(match[1].casefold())
        if match is None or ns is None:
            continue
        zero = pd.Timestamp(match[2]).value
        values = table.frame[name].to_numpy()
        since = values * ns if values.dtype.kind in "iu" else np.round(values * float(ns))
        units = {other: stated for other, stated in table.units.items() if other != name}
        return replace(table, frame=table.frame.assign(**{name: zero + since.astype(np.int64)}), units=units)
    return table
