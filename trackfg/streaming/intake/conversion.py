"""Conversion of raw rows to canonical ones, a few at a time, by the conversions of the sensors' formats.

Rows come in order, their times on the common clock already. What carries over from batch to batch is in the sensors'
converters: joined, the batches are what reading the whole recording at once gives.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackfg.io.formats.gnss import GnssConverter
from trackfg.io.formats.registry import format_of
from trackfg.io.formats.sensor_format import Converter
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.checkpoint.snapshot import DERIVED
from trackfg.streaming.events import LossReport
from trackfg.streaming.rows import RowTables, described_tables


@dataclass
class Conversion:
    """Makes the tables of one description canonical. ``carried``: what each table's converter carries over, as JSON."""

    description: RecordingDescription
    carried: dict[str, str] = field(default_factory=dict)
    _converters: Mapping[str, Converter] = field(init=False, metadata=DERIVED)

    def __post_init__(self) -> None:
        """Make the converters, each from where it stood."""
        parts = described_tables(self.description)
        self._converters = {name: format_of(part).converter(part) for name, part in parts.items()}
        for name, state in self.carried.items():
            self._converters[name].restore(json.loads(state))

    @property
    def gnss_origin(self) -> Array | None:
        """Latitude (deg), longitude (deg), height (m); None until it is known."""
        gnss = self._converters.get("gnss")
        return gnss.origin if isinstance(gnss, GnssConverter) else None

    def converted(self, raw: RowTables, report: LossReport) -> dict[str, Array]:
        """Return canonical rows; those with impossible or silent values go to the ``report``."""
        tables, parts = {}, described_tables(self.description)
        for name, rows in raw.items():
            rows = self._possible(name, rows, report)
            if rows.shape[0]:
                t, *columns = rows.T
                converted = np.column_stack([t, *self._converters[name](t, columns)])
                if format_of(parts[name]).may_be_silent:
                    measures = np.isfinite(converted).all(axis=1)
                    report.lose("silent", name, t[~measures])
                    converted = converted[measures]
                tables[name] = converted
        states = ((name, converter.state()) for name, converter in self._converters.items())
        self.carried = {name: json.dumps(state) for name, state in states if state is not None}
        return tables

    def _possible(self, name: str, rows: Array, report: LossReport) -> Array:
        part = described_tables(self.description)[name]
        impossible = format_of(part).impossible(part, list(rows.T[1:]))
        if impossible is None:
            return rows
        report.lose(impossible.code, name, rows[impossible.rows, 0])
        return np.asarray(rows[~impossible.rows])
