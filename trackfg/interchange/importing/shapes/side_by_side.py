"""Tables that a file has beside each other, each with times of its own, become tables of their own.

Programs that export channels of several rates write them so: ``Time_IMU, gyro_x, ..., Time_Wheel, v``. Shorter ones end
in empty cells, and what stands in one row was not measured at one time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.columns.time_columns import time_columns, times_in
from trackfg.interchange.importing.source_table import SourceTable

_ELSEWHERE = 0.1
"""Share of a clock's span by which its rows are at other times than those of the clock beside it, from which on it has
rows of its own: clocks of one table differ by milliseconds, rates by a factor."""


def parted(table: SourceTable) -> list[SourceTable]:
    """Return the tables that stand beside each other in one; the ``table`` itself where its rows have one time each.

    Each begins with its column of times, or those of date and time of day, and is named after the first of them.
    """
    blocks = [*_blocks(table)]
    if len(blocks) < 2:
        return [table]
    rows = [_filled_rows(table.frame[names]) for names in blocks]
    if len(set(rows)) < 2:
        return [table]
    parts = [
        replace(table, name=f"{table.name}/{names[0]}", frame=table.frame[names].iloc[:count].infer_objects())
        for names, count in zip(blocks, rows, strict=True)
    ]
    clocks = [_seconds(part) for part in parts]
    longest = clocks[int(np.argmax(rows))]
    if longest is None or not any(_is_elsewhere(clock, longest) for clock in clocks):
        return [table]
    return [*parts[:1], *(replace(part, notes=()) for part in parts[1:])]


def _blocks(table: SourceTable) -> Iterator[list[str]]:
    """Yield the columns of each block: those of its times, and those behind them until the next ones."""
    block = list[str]()
    for name in table.columns:
        if table.frame[name].isna().all():
            continue
        is_time = meaning(name) == "time"
        if is_time and any(meaning(other) != "time" for other in block):
            yield block
            block = []
        block.append(name)
    yield block


def _filled_rows(frame: pd.DataFrame) -> int:
    """Return up to which row a block has values."""
    return int(np.flatnonzero(frame.notna().any(axis=1))[-1]) + 1 if len(frame.columns) else 0


def _seconds(part: SourceTable) -> np.ndarray | None:
    """Return the times of a block, s since its first row; None where not every row has one."""
    columns = time_columns(part)
    if columns is None or columns[0] != part.columns[0] or part.frame[columns[0]].isna().any():
        return None
    try:
        times = times_in(part, columns)
    except BadInputError:
        return None
    since = times.since(times.first_ns)
    return np.asarray(since - since[0])


def _is_elsewhere(clock: np.ndarray | None, longest: np.ndarray) -> bool:
    if clock is None or not clock[-1] > 0.0:
        return False
    return bool(np.abs(clock - longest[: clock.size]).max() > _ELSEWHERE * clock[-1])
