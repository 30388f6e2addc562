"""NI TDMS files of measuring labs: each group is a table on the times of its waveforms."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.files.libraries import library
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, readable, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable, column_of


class Tdms(SourceFormat):
    """Channels of one group and one time track make a table; the time is a channel of its own, or the waveform's."""

    key = "tdms"
    title = "NI TDMS (.tdms)"

    def recognises(self, path: Path) -> bool:
        """Return whether the file begins as TDMS files do."""
        return starts_with(path, b"TDSm")

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read every group with numbers; ``time_s`` is the waveform's time where the group has one."""
        nptdms = library("nptdms", "tdms")
        library("nptdms.log", "tdms").log_manager.set_level(logging.ERROR)  # a damaged file gets one message, ours
        tables = []
        with readable(path, "a TDMS file"), nptdms.TdmsFile.open(path) as file:
            for group in file.groups():
                tables += _group(group)
        return refuse_empty(in_usual_shape_of_types(tables), path, "group with rows of numbers")


def _group(group: Any) -> list[SourceTable]:
    by_length: dict[int, dict[str, np.ndarray | pd.Series]] = {}
    units: dict[str, str] = {}
    times: dict[int, dict[str, np.ndarray]] = {}
    for channel in group.channels():
        values = channel[:]
        column = column_of(values) if len(values) else None
        if column is None:
            continue
        by_length.setdefault(len(values), {})[channel.name] = column
        units[channel.name] = str(channel.properties.get("unit_string", ""))
        if len(values) not in times and "wf_increment" in channel.properties:
            times[len(values)] = _times(channel)
    tables = []
    for rows, columns in by_length.items():
        name = group.name if len(by_length) == 1 else f"{group.name}/{rows} rows"
        time_columns = times.get(rows, {})
        tables.append(
            SourceTable(name, pd.DataFrame({**time_columns, **columns}), {"time_s": "s", "time_ns": "ns", **units})
        )
    return tables


def _times(channel: Any) -> dict[str, np.ndarray]:
    """Return the times of a waveform: on the calendar where it says when it began, since groups begin at their own."""
    offset, increment = (float(channel.properties.get(f"wf_{name}", 0.0)) for name in ("start_offset", "increment"))
    seconds = offset + increment * np.arange(len(channel))
    start = channel.properties.get("wf_start_time")
    start_ns = 0 if start is None else int(np.datetime64(start, "ns").astype(np.int64))
    if start_ns <= 0:  # LabVIEW writes 1904 where there is none
        return {"time_s": seconds}
    return {"time_ns": start_ns + np.round(seconds * 1e9).astype(np.int64)}
