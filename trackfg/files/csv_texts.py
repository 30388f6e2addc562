"""Small CSV files that people write by hand or in a spreadsheet are read as texts, and refused where columns shift."""

from __future__ import annotations

import os
import re
import warnings
from io import BytesIO
from typing import Literal

import pandas as pd

from trackfg.files.small_file import read_small


def read_csv_texts(path: str | os.PathLike[str], most_bytes: int) -> pd.DataFrame:
    """Return the table of a CSV file, every cell a text, without columns that have neither a name nor a value.

    Raises ``OSError`` as :func:`~trackfg.files.small_file.read_small`, and ``ValueError`` for what is no such table:
    rows longer than the first would shift their values under other names.
    """
    content = read_small(path, most_bytes)
    table = _texts(content)
    extra = 0 if isinstance(table.index, pd.RangeIndex) else table.index.nlevels
    if extra:  # pandas took the first values of each row for its name
        if (table.iloc[:, -extra:] != "").any(axis=None):
            raise ValueError(
                f"rows of {table.shape[1] + extra} values; expected {table.shape[1]}, as the first row has names. "
                "Hint: a value with a comma goes in quotation marks"
            )
        table = _texts(content, index_col=False)
    unnamed = [name for name in table if re.fullmatch(r"Unnamed: \d+", str(name)) and (table[name] == "").all()]
    table = table.drop(columns=unnamed)
    if table.shape[1] == 1 and (separator := re.search(r"[;\t]", str(table.columns[0]))):
        mark = "semicolons" if separator.group() == ";" else "tabs"
        raise ValueError(f"its columns are parted by {mark}; expected commas")
    return table


def _texts(content: bytes, index_col: Literal[False] | None = None) -> pd.DataFrame:
    """Return the cells of a table; with ``index_col`` False without those beyond the names, which are all empty."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        try:
            return pd.read_csv(BytesIO(content), dtype=str, keep_default_na=False, index_col=index_col)
        except UnicodeDecodeError as error:
            raise ValueError("its text is not UTF-8. Hint: spreadsheets save it as CSV UTF-8") from error
