"""Latitudes and longitudes in degrees, minutes and seconds, or with the letter of their hemisphere, become degrees.

The letter stands before or behind the number, ``46.95 N`` and ``7°26'18.3"W``, or in the column behind it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.interchange.importing.columns.column_meaning import full_name
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.source_table import SourceTable

_FIRST_CELLS = 100
_HEMISPHERES = {"latitude": "NS", "longitude": "EW"}
"""The letters, that of negative angles last. O, east in German and west in French, is none."""
_NUMBER = r"\d+(?:[.,]\d*)?"
_ANGLE = (
    rf"^(?P<before>[NSEW])?\s*(?P<sign>[+\-\u2212])?\s*(?P<deg>{_NUMBER})\s*(?:[°ºd:]|deg)?\s*"
    rf"(?:(?<![\d.,])(?P<min>{_NUMBER})\s*['\u2032m:]?\s*)?(?:(?<![\d.,])(?P<sec>{_NUMBER})\s*(?:[\"\u2033s]|'')?\s*)?(?P<behind>[NSEW])?$"
)


def with_degrees(table: SourceTable) -> SourceTable:
    """Return a table whose columns of latitude and longitude are numbers of degrees, with the sign of the hemisphere.

    A column of the hemisphere's letters behind one of numbers is left out then. Others stay as they are.
    """
    columns, units, letters = dict[str, pd.Series](), dict(table.units), list[str]()
    for name, behind in zip(table.columns, [*table.columns[1:], None], strict=True):
        kind = meaning(full_name(table, name))
        if kind not in _HEMISPHERES:
            continue
        column, hemisphere = table.frame[name], _HEMISPHERES[kind]
        if pd.api.types.is_string_dtype(column):
            degrees = _read(column, hemisphere)
            if degrees is not None:
                columns[name], units[name] = degrees, "deg"
        elif behind is not None and _are_letters(table.frame[behind], hemisphere) and not (column < 0.0).any():
            south_or_west = table.frame[behind].str.strip().str.upper() == hemisphere[1]
            columns[name] = column.where(~south_or_west.fillna(value=False).astype(bool), -column)
            letters.append(behind)
    if not columns:
        return table
    return replace(table, frame=table.frame.assign(**columns).drop(columns=letters), units=units)


def _are_letters(column: pd.Series, hemisphere: str) -> bool:
    """Return whether all cells that are not empty are letters of these hemispheres."""
    if not pd.api.types.is_string_dtype(column):
        return False
    cells = column.dropna().str.strip().str.upper()
    return len(cells) > 0 and bool(cells.isin(list(hemisphere)).all())


def _read(column: pd.Series, hemisphere: str) -> pd.Series | None:
    """Return written angles (n,) in degrees; None where a cell is none, or none has more than a plain number."""
    cells = column.str.strip()
    if not cells.dropna().iloc[:_FIRST_CELLS].str.fullmatch(_ANGLE).all():
        return None
    parts = cells.str.upper().str.replace("DEG", "°", regex=False).str.extract(_ANGLE, flags=re.IGNORECASE)
    letter = parts["before"].fillna(parts["behind"])
    if letter.dropna().isin(list(hemisphere)).all() and (parts["deg"].notna() | cells.isna()).all():
        numbers = parts[["deg", "min", "sec"]].apply(
            lambda part: pd.to_numeric(part.str.replace(",", ".", regex=False))
        )
        size = numbers["deg"] + numbers["min"].fillna(0.0) / 60.0 + numbers["sec"].fillna(0.0) / 3600.0
        negative = (letter == hemisphere[1]) | parts["sign"].isin(["-", "\u2212"])
        degrees = np.where(negative.fillna(value=False).to_numpy(bool), -1.0, 1.0) * size.to_numpy(
            np.float64, na_value=np.nan
        )
        return pd.Series(degrees, index=column.index)
    return None
