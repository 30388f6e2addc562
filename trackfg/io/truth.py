"""The truth of a recording. Only comparisons and reports read it; no estimator does."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from trackfg.checks import columns
from trackfg.checks.columns import ColumnPlace
from trackfg.errors import BadInputError
from trackfg.io.description_reader import locate, read_description
from trackfg.io.table_file import open_table
from trackfg.numerics import units
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Truth
from trackfg.recording.findings import raise_first


def has_truth(path: Path | str) -> bool:
    """Return whether the recording declares a truth. Raises :class:`BadInputError` for an unreadable description."""
    read = read_description(path)
    raise_first(list(read.findings))
    return "truth" in read.parts


def read_truth(path: Path | str) -> pd.DataFrame:
    """Return the truth table of a recording: ``t_s`` and whatever trajectory columns it has. For comparisons only.

    Columns may hold NaN where the truth is not known. Raises :class:`BadInputError` where there is no truth.
    """
    truth, folder = _truth_part(path)
    table = _all_columns(folder, truth.file, truth.time)
    t = table.pop(truth.time).to_numpy() * units.to_si("time", truth.time_unit) + truth.time_offset_s
    raise_first([
        *columns.not_finite(t, ColumnPlace(truth.file, truth.time)),
        *columns.not_increasing(t, ColumnPlace(truth.file, truth.time)),
    ])  # fmt: skip
    table.insert(0, "t_s", t)
    return table


def read_truth_geometry(path: Path | str) -> pd.DataFrame | None:
    """Return the true geometry, by ``chainage_m``, or None where the recording has a truth without geometry.

    Raises :class:`BadInputError` where there is no truth at all, or the table is unusable.
    """
    truth, folder = _truth_part(path)
    if truth.geometry is None:
        return None
    table = _all_columns(folder, truth.geometry, "chainage_m")
    raise_first(columns.not_finite(table["chainage_m"].to_numpy(), ColumnPlace(truth.geometry, "chainage_m")))
    return table


def _truth_part(path: Path | str) -> tuple[Truth, Path]:
    folder, toml = locate(path)
    read = read_description(path)
    raise_first(list(read.findings))
    truth = read.parts.get("truth")
    if not isinstance(truth, Truth):
        raise BadInputError(f"{toml}: the recording has no [truth]; expected one to compare with")
    return truth, folder


def _all_columns(folder: Path, file: str, key: str) -> pd.DataFrame:
    """Return every column of a table. Raises :class:`BadInputError` where one is not numeric or ``key`` is missing."""
    table, findings = open_table(folder, file, [key])
    if table is not None:
        table, findings = open_table(folder, file, table.columns)
    raise_first(findings)
    assert table is not None  # or a finding says why not
    read: dict[str, Array | None] = {}
    for name in dict.fromkeys((key, *table.columns)):
        read[name], faults = table.numbers(name)
        raise_first(faults)
    return pd.DataFrame(read)
