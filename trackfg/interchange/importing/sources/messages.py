"""Messages of any type become tables: a column for each number or text, named by its path (``twist.linear.x``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd

from trackfg.interchange.importing.proposal import GNSS_SD_M
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import as_ns

STAMP = "stamp_ns"
"""The column of times, ns since 1970."""
SIGMAS = ("sd_east_m", "sd_north_m", "sd_up_m")
"""Columns that a covariance of positions becomes."""
_STAMPS = ("header", "timestamp", "stamp", "time")
"""Fields of a message that are, or hold, the time of its measurement."""
_BARE = (("data",), ("value",))
"""Fields of messages that are one number, which their topic names."""
_NS = ("nsec", "nanosec", "nsecs")
_UNITS_NS = (1_000_000_000, 1_000_000, 1_000, 1)
"""Seconds, and what is below them, as numbers of a message may count its time."""
_NEAR_NS = 600_000_000_000
"""A time that a message states as one number or text is about when it was received, ns, else it is none of this clock.
Time zones are further apart.
"""
_OLDEST_NS = 1_000_000_000_000_000_000
"""Of September 2001: what counts less does not count from 1970, and its unit is not known."""
_DEPTH = 8
"""Messages are nested no deeper."""


class MessageTables:
    """A table for each topic, with the columns of its first message; what later ones do not have is NaN or missing."""

    def __init__(self) -> None:
        self._names: dict[str, tuple[str, ...]] = {}
        self._stamps: dict[str, list[int]] = {}
        self._rows: dict[str, list[tuple[float | str | None, ...]]] = {}

    def take(self, topic: str, stamp_ns: int, cells: Mapping[str, float | str]) -> None:
        """Take up a message that has numbers."""
        names = self._names.setdefault(topic, tuple(cells))
        self._stamps.setdefault(topic, []).append(stamp_ns)
        self._rows.setdefault(topic, []).append(tuple(cells.get(name) for name in names))

    def tables(self) -> Iterator[SourceTable]:
        """Yield the tables of topics with numbers or changing texts."""
        for topic, names in self._names.items():
            cells = zip(*self._rows[topic], strict=True)
            columns = {name: _column(values) for name, values in zip(names, cells, strict=True)}
            # A text that is the same in all messages, such as the name of a frame, measures nothing.
            columns = {
                name: values
                for name, values in columns.items()
                if isinstance(values, np.ndarray) or (values != values.iloc[0]).any()
            }
            if columns:
                frame = pd.DataFrame(columns)
                if tuple(columns) in _BARE:
                    frame.columns = pd.Index([topic.rpartition("/")[2]])
                frame.insert(0, STAMP, np.array(self._stamps[topic], dtype=np.int64))
                yield with_sigmas(SourceTable(topic, frame))


def with_sigmas(table: SourceTable) -> SourceTable:
    """Return a table whose positions of unknown covariance have the usual sigmas of a receiver, with a note of it."""
    if not set(SIGMAS) <= set(table.columns):
        return table
    sd = table.frame[list(SIGMAS)].to_numpy()
    unknown = np.any(~(sd > 0.0), axis=1, keepdims=True)
    if not unknown.any():
        return table
    frame = table.frame.assign(**dict(zip(SIGMAS, np.where(unknown, GNSS_SD_M, sd).T, strict=True)))
    assumed = f"{np.count_nonzero(unknown)} of {unknown.size} positions have no covariance"
    east, north, up = GNSS_SD_M
    note = f"{table.name}: {assumed}: their sigmas are assumed, {east:g}, {north:g} and {up:g} m"
    return replace(table, frame=frame, notes=(*table.notes, note))


def _column(cells: tuple[float | str | None, ...]) -> np.ndarray | pd.Series:
    """Return the cells of a column: text if that of the first message is, else numbers."""
    if isinstance(cells[0], str):
        return pd.Series([cell if isinstance(cell, str) else None for cell in cells], dtype="string")
    return np.array([np.nan if cell is None or isinstance(cell, str) else cell for cell in cells])


def fields_of(message: Any) -> Mapping[str, Any]:
    """Return the fields of a message by name, be it decoded from JSON or a class; none of anything else."""
    if isinstance(message, dict):
        return message
    return vars(message) if hasattr(message, "__dict__") else {}


def measured_ns(message: Any, received_ns: int) -> int:
    """Return the time that a message states, ns since 1970, else when it was received."""
    for name in _STAMPS:
        stamp = fields_of(message).get(name)
        near = next((ns for ns in _read_as_ns(stamp) if ns > _OLDEST_NS and abs(ns - received_ns) < _NEAR_NS), None)
        if near is not None:
            return near
        time = fields_of(fields_of(stamp).get("stamp", stamp))
        part = next((time[name] for name in _NS if name in time), None)
        if part is not None and "sec" in time:
            return int(time["sec"]) * 1_000_000_000 + int(part)
    return received_ns


def _read_as_ns(stamp: Any) -> Iterator[int]:
    """Yield what a number, or a text such as ``2026-05-01T03:12:00Z``, may mean in ns since 1970."""
    if isinstance(stamp, int | float) and not isinstance(stamp, bool) and np.isfinite(stamp):
        yield from (round(stamp * unit) for unit in _UNITS_NS)
    if isinstance(stamp, str):
        try:
            time = datetime.fromisoformat(stamp.strip())
        except ValueError:
            return
        yield as_ns(time if time.tzinfo is not None else time.replace(tzinfo=UTC))


def cells_of(message: Any, prefix: str = "", depth: int = _DEPTH) -> dict[str, float | str]:
    """Return the numbers and texts of a message by their paths, vectors of three as x, y, z, without other arrays."""
    out: dict[str, float | str] = {}
    for name, value in fields_of(message).items():
        path = f"{prefix}{name}"
        if isinstance(value, bool | int | float | np.number):
            out[path] = float(value)
        elif name == "position_covariance":
            out |= dict(zip(SIGMAS, sigmas_of(value), strict=True))
        elif name in _STAMPS:
            continue
        elif isinstance(value, str):
            out[path] = value
        elif _is_vector(value):
            out |= {f"{path}.{axis}": float(part) for axis, part in zip("xyz", value, strict=True)}
        elif depth and not isinstance(value, list | tuple | np.ndarray | bytes):
            out |= cells_of(value, f"{path}.", depth - 1)
    return out


def sigmas_of(covariance: Any) -> tuple[float, ...]:
    """Return the sigmas east, north and up of a covariance of positions, of 9 numbers; 0 where it says nothing."""
    values = np.asarray(covariance, dtype=np.float64).ravel()
    diagonal = values[::4] if values.size == 9 else np.zeros(3)
    return tuple(np.sqrt(np.where(diagonal > 0.0, diagonal, 0.0)).tolist())


def _is_vector(value: Any) -> bool:
    if not isinstance(value, list | tuple | np.ndarray) or len(value) != 3:
        return False
    return all(isinstance(part, int | float | np.number) for part in value)
