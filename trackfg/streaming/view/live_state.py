"""The newest minutes of a stream, as messages for a page: all of it for one that opens, and what came since."""

from __future__ import annotations

import json
import math
import threading
from collections import Counter, deque
from typing import Any

import numpy as np
import pandas as pd

from trackfg.streaming.run import StreamStep

OVER_TIME = ("t_s", "chainage_m", "speed_mps", "speed_mps_sd", "chainage_m_sd", "roll_rad", "roll_rad_sd")
"""Columns of filtered rows that a page shows over time; ``delay_s`` besides."""

OVER_PLACE = tuple(
    f"{name}{end}"
    for name in ("curvature_1pm", "cross_level_mm", "twist_mm", "level_mm", "alignment_mm")
    for end in ("", "_sd")
)
"""Columns of the geometry that it shows over the chainage."""

_ROWS_OVER_TIME = 1200
"""Filtered rows that are kept: ten minutes of two keyframes a second."""
_ROWS_OVER_PLACE = 2000
"""Rows of the geometry that are kept: a kilometre at every second cell of 0.25 m."""
_EVERY_CELL = 2
_EVENTS = 200
_UPDATES = 200
"""Messages that are kept for pages that fall behind; a page further behind gets everything."""


class LiveState:
    """The state that a page shows. ``watch`` is called by the stream, the rest by the threads that serve pages."""

    def __init__(self, title: str, lag_s: float) -> None:
        self._about = {"title": title, "lag_s": lag_s}
        self._changed = threading.Condition()
        self._time: deque[list[float | None]] = deque(maxlen=_ROWS_OVER_TIME)
        self._place: deque[list[float | None]] = deque(maxlen=_ROWS_OVER_PLACE)
        self._events: deque[dict[str, Any]] = deque(maxlen=_EVENTS)
        self._updates: deque[str] = deque(maxlen=_UPDATES)
        self._count, self._cells = 0, 0
        self._done: float | None = None
        self._kinds: Counter[str] = Counter()
        self._ended = False

    def watch(self, step: StreamStep) -> None:
        """Take in what a batch of rows led to."""
        rows = _rows(step.estimates.filtered, OVER_TIME, 1)
        for row in rows:
            row.append(None if step.delay_s is None else round(step.delay_s, 3))
        geometry = step.estimates.geometry
        cells = _rows(geometry.iloc[-self._cells % _EVERY_CELL :], ("chainage_m", *OVER_PLACE), _EVERY_CELL)
        self._cells += len(geometry)
        events = [
            {"t_s": event.t_s, "kind": event.kind, "chainage_m": event.chainage_m, "text": str(event)}
            for event in step.events
        ]
        self._kinds.update(event.kind for event in step.events)
        self._publish(rows, cells, events, step.done)

    def end(self) -> None:
        """Publish that the stream has ended."""
        self._ended = True
        self._publish([], [], [], 1.0)

    def _publish(self, rows: list[Any], cells: list[Any], events: list[Any], done: float | None) -> None:
        with self._changed:
            self._time.extend(rows)
            self._place.extend(cells)
            self._events.extend(events)
            self._done = done
            self._updates.append(json.dumps(self._content(rows, cells, events), allow_nan=False))
            self._count += 1
            self._changed.notify_all()

    def _content(self, rows: list[Any], cells: list[Any], events: list[Any]) -> dict[str, Any]:
        content = {"time": rows, "place": cells, "events": events, "done": self._done, "kinds": dict(self._kinds)}
        return {**content, "ended": self._ended}

    def everything(self) -> tuple[int, str]:
        """Return the number of messages so far, and one message that holds the content of all."""
        with self._changed:
            whole = self._content(list(self._time), list(self._place), list(self._events))
            columns = {"time": [*OVER_TIME, "delay_s"], "place": ["chainage_m", *OVER_PLACE]}
            message = {"about": self._about, "columns": columns, "whole": whole}
            return self._count, json.dumps(message, allow_nan=False)

    def since(self, count: int, wait_s: float) -> tuple[int, list[str]] | None:
        """Return the messages after the first ``count``, waiting for one; None where these are no longer kept."""
        with self._changed:
            self._changed.wait_for(lambda: self._count > count, wait_s)
            missing = self._count - count
            if missing > len(self._updates):
                return None
            return self._count, list(self._updates)[len(self._updates) - missing :]

    @property
    def ended(self) -> bool:
        """Return whether the stream is over."""
        return self._ended


def _rows(table: pd.DataFrame, columns: tuple[str, ...], every: int) -> list[list[float | None]]:
    """Return rows with eight digits, None where a value is not known."""
    if not len(table):
        return []
    values = np.column_stack([table[name].to_numpy(dtype=np.float64) for name in columns])[::every]
    return [[float(f"{x:.8g}") if math.isfinite(x) else None for x in row] for row in values.tolist()]
