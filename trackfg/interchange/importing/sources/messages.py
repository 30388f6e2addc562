"""Messages of any type become tables: each number in them is a column, named by its path (``twist.linear.x``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable

STAMP = "stamp_ns"
"""The column of times, ns since 1970."""
SIGMAS = ("sd_east_m", "sd_north_m", "sd_up_m")
"""Columns that a covariance of positions becomes; 0 where it is unknown."""
_STAMPS = ("header", "timestamp", "stamp", "time")
"""Fields of a message that are, or hold, the time of its measurement."""
_BARE = (("data",), ("value",))
"""Fields of messages that are one number, which their topic names."""
_NS = ("nsec", "nanosec", "nsecs")
_DEPTH = 8
"""Messages are nested no deeper."""


class MessageTables:
    """A table for each topic, with the columns of its first message; what later ones do not have is NaN."""

    def __init__(self) -> None:
        self._names: dict[str, tuple[str, ...]] = {}
        self._stamps: dict[str, list[int]] = {}
        self._rows: dict[str, list[tuple[float, ...]]] = {}

    def take(self, topic: str, stamp_ns: int, numbers: Mapping[str, float]) -> None:
        """Take up a message that has numbers."""
        names = self._names.setdefault(topic, tuple(numbers))
        self._stamps.setdefault(topic, []).append(stamp_ns)
        self._rows.setdefault(topic, []).append(tuple(numbers.get(name, np.nan) for name in names))

    def tables(self) -> Iterator[SourceTable]:
        """Yield the tables of topics with numbers."""
        for topic, names in self._names.items():
            if names:
                columns = [topic.rpartition("/")[2]] if names in _BARE else list(names)
                frame = pd.DataFrame(np.array(self._rows[topic], dtype=np.float64), columns=columns)
                frame.insert(0, STAMP, np.array(self._stamps[topic], dtype=np.int64))
                yield SourceTable(topic, frame)


def fields_of(message: Any) -> Mapping[str, Any]:
    """Return the fields of a message by name, be it decoded from JSON or a class; none of anything else."""
    if isinstance(message, dict):
        return message
    return vars(message) if hasattr(message, "__dict__") else {}


def measured_ns(message: Any, received_ns: int) -> int:
    """Return the time that a message states, ns since 1970, else when it was received."""
    for name in _STAMPS:
        stamp = fields_of(message).get(name)
        time = fields_of(fields_of(stamp).get("stamp", stamp))
        part = next((time[name] for name in _NS if name in time), None)
        if part is not None and "sec" in time:
            return int(time["sec"]) * 1_000_000_000 + int(part)
    return received_ns


def numbers_of(message: Any, prefix: str = "", depth: int = _DEPTH) -> dict[str, float]:
    """Return the numbers of a message by their paths, vectors of three as x, y, z; other arrays are left out."""
    out: dict[str, float] = {}
    for name, value in fields_of(message).items():
        path = f"{prefix}{name}"
        if isinstance(value, bool | int | float | np.number):
            out[path] = float(value)
        elif name == "position_covariance":
            out |= dict(zip(SIGMAS, sigmas_of(value), strict=True))
        elif name not in _STAMPS and _is_vector(value):
            out |= {f"{path}.{axis}": float(part) for axis, part in zip("xyz", value, strict=True)}
        elif name not in _STAMPS and depth and not isinstance(value, list | tuple | np.ndarray | str | bytes):
            out |= numbers_of(value, f"{path}.", depth - 1)
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
