"""From raw rows to canonical ones, a few at a time, by the conversions of the sensors' formats.

Rows come in order, their times on the common clock already. What carries over from batch to batch is in the sensors'
converters: joined, the batches are what reading the whole recording at once gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trackfg.io.formats.gnss import GnssConverter
from trackfg.io.formats.registry import format_of
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.events import LossReport
from trackfg.streaming.rows import RowTables, described_tables


class Conversion:
    """The tables of one description, made canonical."""

    def __init__(self, description: RecordingDescription) -> None:
        self._parts = described_tables(description)
        self._converters = {name: format_of(part).converter(part) for name, part in self._parts.items()}

    @property
    def gnss_origin(self) -> Array | None:
        """Latitude (deg), longitude (deg), height (m); None until it is known."""
        gnss = self._converters.get("gnss")
        return gnss.origin if isinstance(gnss, GnssConverter) else None

    def converted(self, raw: RowTables, report: LossReport) -> dict[str, Array]:
        """Canonical rows; those with impossible positions or speeds go to the ``report``."""
        tables = {}
        for name, rows in raw.items():
            rows = self._possible(name, rows, report)
            if rows.shape[0]:
                t, *columns = rows.T
                converted = np.column_stack([t, *self._converters[name](t, columns)])
                if format_of(self._parts[name]).may_be_silent:
                    converted = converted[np.isfinite(converted).all(axis=1)]
                tables[name] = converted
        return tables

    def _possible(self, name: str, rows: Array, report: LossReport) -> Array:
        part = self._parts[name]
        impossible = format_of(part).impossible(part, list(rows.T[1:]))
        if impossible is None:
            return rows
        report.lose(impossible.code, name, rows[impossible.rows, 0])
        return np.asarray(rows[~impossible.rows])

    def state(self) -> dict[str, Any]:
        """What carries over to the next batch, as JSON values."""
        return {name: state for name, one in self._converters.items() if (state := one.state()) is not None}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        for name, converter in self._converters.items():
            converter.restore(state.get(name))
