"""A table of a source, with its columns as they are there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, did_you_mean, printable
from trackfg.numerics.arrays import Array

ROW_NUMBER = "row number"
"""The name by which a mapping means the number of a row, from 0, in a table without such a column."""

_STRAY = 0.1
"""Share of the cells below which text among numbers is a fault of theirs, not another kind of column."""


@dataclass(frozen=True)
class SourceTable:
    """A table has a ``name`` within its source and a frame: numbers as float64 or integers, all else as text.

    ``units`` are those that the source states, by column; ``first_row`` is the number of the first data row in the
    file, counted from 1, for messages; ``start_ns`` is the date at which its times are 0, ns since 1970, where the
    source states it; ``remarks`` is the text above the names; ``notes`` say what reading has assumed.
    """

    name: str
    frame: pd.DataFrame
    units: Mapping[str, str] = field(default_factory=dict)
    first_row: int = 1
    start_ns: int | None = None
    remarks: str = ""
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> list[str]:
        """The names of the columns."""
        return [str(name) for name in self.frame.columns]

    def name_like(self, pattern: re.Pattern[str]) -> str | None:
        """Return the first column in whose name, without blanks around it, the pattern is found; None without any."""
        return next((name for name in self.columns if pattern.search(name.strip())), None)

    def column(self, name: str) -> pd.Series:
        """Return a column. Raises :class:`BadInputError` with the nearest name where there is none of that name."""
        if name not in self.frame.columns:
            if name == ROW_NUMBER:
                return pd.Series(np.arange(len(self.frame)))
            near = did_you_mean(name, self.columns)
            names = ", ".join(self.columns[:30])
            raise BadInputError(
                f"{self.name}: no column {name!r}; expected one of {names}" + (f". Hint: {near}" if near else "")
            )
        return self.frame[name]

    def numbers(self, name: str) -> Array:
        """Return a column as float64 (n,), NaN where a cell is empty. Raises :class:`BadInputError` for text in it."""
        column = self.column(name)
        if pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
            return column.to_numpy(dtype=np.float64, na_value=np.nan)
        if not pd.api.types.is_string_dtype(column):
            raise BadInputError(f"{self.name}: column {name!r} holds {column.dtype}; expected numbers")
        text = column.str.strip()
        wrong = _no_numbers(text)
        if wrong.size:
            self.refuse_stray_text(name)
            raise BadInputError(self._refused_cells(name, wrong))
        values = pd.to_numeric(text, errors="coerce")
        return values.to_numpy(dtype=np.float64, na_value=np.nan)

    def refuse_stray_text(self, name: str) -> None:
        """Raise :class:`BadInputError` with the first cell that is text where most cells of a column are numbers."""
        column = self.column(name)
        if not pd.api.types.is_string_dtype(column):
            return
        text = column.str.strip()
        comma = _no_numbers(text.str.replace(",", ".", regex=False))
        if 0 < comma.size < _STRAY * (text.notna() & (text != "")).sum():
            raise BadInputError(self._refused_cells(name, comma))

    def _refused_cells(self, name: str, wrong: np.ndarray) -> str:
        row, cell = self.first_row + int(wrong[0]), printable(str(self.frame[name].iloc[int(wrong[0])]))[:40]
        more = f" ({wrong.size} such cells)" if wrong.size > 1 else ""
        return (
            f"{self.name}: column {name!r}, row {row}: {cell!r} is not a number{more}; expected a number. "
            "Hint: correct or empty such cells, or state the decimal sign under [[text]] in the mapping"
        )


def column_of(values: np.ndarray) -> np.ndarray | pd.Series | None:
    """Return an array (n,) as a column: dates as ns since 1970, texts and bytes as text, None where it is neither.

    Numbers and truth values stay as they are.
    """
    if values.ndim != 1:
        return None
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]").astype(np.int64)
    if values.dtype.kind in "iufb":
        return values
    if values.dtype.kind not in "SUO" or not all(isinstance(value, str | bytes | None) for value in values):
        return None
    cells = [value.decode("utf-8", "replace") if isinstance(value, bytes) else value for value in values]
    return pd.Series(cells, dtype="string")


def holds_numbers(columns: Mapping[str, np.ndarray | pd.Series] | pd.DataFrame) -> bool:
    """Return whether any of the columns holds numbers: texts alone are no table of a sensor."""
    return any(pd.api.types.is_numeric_dtype(column.dtype) for _, column in columns.items())


def _no_numbers(text: pd.Series) -> np.ndarray:
    """Return the places of cells that hold something other than a number."""
    return np.flatnonzero(pd.to_numeric(text, errors="coerce").isna() & text.notna() & (text != ""))
