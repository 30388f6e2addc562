"""A sensor format has what files, checks, streams and memory must know of the table of one kind of sensor.

A sensor is a part of ``recording.toml`` (a model of :mod:`trackfg.recording.description`) and a :class:`SensorFormat`:
its columns as recorded and in memory, what they must satisfy, and the conversion from the one to the other. Reader,
writer, ``trackfg check`` and the intake of streams go through :data:`trackfg.io.formats.registry.FORMATS` and know no
sensor by name. The same conversion makes a whole table and the rows of a stream, a few at a time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import Table
from trackfg.recording.findings import Finding, Section

Part = TypeVar("Part", bound=Table)

TIME_COLUMN = "t_s"
"""Of every table in memory: seconds on the recording's clock."""


class ReadColumns(NamedTuple):
    """The columns of a table as far as they could be read: ``t`` (n,), s on the sensor's clock, and by name."""

    t: Array | None
    named: Mapping[str, Array | None]


class Impossible(NamedTuple):
    """Rows of a stream that no vehicle can produce, marked in ``rows`` (n,), and the ``code`` they are reported by."""

    code: str
    rows: np.ndarray


class WrittenTable(NamedTuple):
    """A table to be written, and the keys of the part that then describe it (its file and time are the writer's)."""

    keys: Mapping[str, Any]
    table: pd.DataFrame


class Converter(ABC):
    """The conversion of one sensor's rows, in order, to SI, body axes and metres."""

    @abstractmethod
    def __call__(self, t: Array, columns: Sequence[Array]) -> tuple[Array, ...]:
        """Return the data columns in canonical form, from times on the common clock (n,), s, and the columns as
        recorded.
        """

    def state(self) -> Any:
        """Return the state that carries over from batch to batch, as JSON values; None where each row stands for
        itself.
        """
        return None

    def restore(self, state: Any) -> None:
        """Go on from a :meth:`state`. Raises ``ValueError`` where the rows stand for themselves."""
        if state is not None:
            raise ValueError(f"{type(self).__name__} carries nothing over, but the state has {state!r}")


class RowsAlone(Converter):
    """A conversion in which each row stands for itself: a function of the columns as recorded."""

    def __init__(self, convert: Callable[[Sequence[Array]], tuple[Array, ...]]) -> None:
        self._convert = convert

    def __call__(self, t: Array, columns: Sequence[Array]) -> tuple[Array, ...]:
        """Return the data columns in canonical form."""
        return self._convert(columns)


class SensorFormat(ABC, Generic[Part]):
    """The table of one kind of sensor.

    ``key`` is the part's name in ``recording.toml``, ``model`` its class, ``canonical`` the columns in memory, the time
    first. With ``several`` the key holds a list, one table per sensor. If a sensor ``may_be_silent``, empty cells are
    no fault, and rows without a value are left out.
    """

    key: ClassVar[str]
    model: ClassVar[type[Table]]
    canonical: ClassVar[tuple[str, ...]]
    several: ClassVar[bool] = False
    may_be_silent: ClassVar[bool] = False

    @abstractmethod
    def columns(self, part: Part) -> tuple[str, ...]:
        """Return the columns as recorded, without the time."""

    @abstractmethod
    def converter(self, part: Part) -> Converter:
        """Return a conversion that has seen no row yet."""

    @abstractmethod
    def written(self, part: Part, table: pd.DataFrame) -> WrittenTable:
        """Return the canonical ``table`` as it is written, so that reading gives the same values."""

    def table_name(self, part: Part, number: int) -> str:
        """Return the name of the sensor's table in memory and in a stream; ``number`` counts from 1 in a list."""
        return f"{self.key}/{number}" if self.several else self.key

    def on_common_clock(self, part: Part, t: Array) -> Array:
        """Return times on the sensor's clock (n,), s, on that of the recording."""
        return canonical.on_common_clock(part, t)

    def with_even_times(self, part: Part, read: ReadColumns) -> tuple[Array | None, list[Finding]]:
        """Return the times (n,), s, on the sensor's clock, those of packets of samples spread, and what was found."""
        return read.t, []

    def gap_limits_s(self, limits: CheckLimits) -> tuple[float, float | None] | None:
        """Return the silences between rows that are doubtful and an error, s; None where rows come at any times."""
        return None

    def value_faults(self, part: Part, read: ReadColumns) -> list[Finding]:
        """Return errors for values that make the table unusable. By default none."""
        return []

    def doubts(self, part: Part, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
        """Return what cannot be true in the canonical ``table``; ``section`` is the part's in the file. By default
        nothing.
        """
        return []

    def impossible(self, part: Part, columns: Sequence[Array]) -> Impossible | None:
        """Return the rows of a stream to be left out before the conversion, or None where nothing can be decided."""
        return None
