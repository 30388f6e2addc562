"""A stream from its beginning to its end, and its tables."""

from __future__ import annotations

import pandas as pd

from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.run import run_stream
from trackfg.streaming.sinks.sink import Callback
from trackfg.streaming.sources.source import Source
from trackfg.streaming.stream_counts import StreamCounts


def tables_of(source: Source, smoother: FixedLagSmoother) -> tuple[dict[str, pd.DataFrame], StreamCounts]:
    """All that the stream gave, by table, without those that have no part; and what has come through."""
    parts: dict[str, list[pd.DataFrame]] = {}
    counts = run_stream(source, smoother, Callback(lambda name, rows: parts.setdefault(name, []).append(rows)))
    return {name: pd.concat(rows, ignore_index=True) for name, rows in parts.items()}, counts
