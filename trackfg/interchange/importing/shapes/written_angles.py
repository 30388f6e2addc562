"""Latitudes and longitudes in degrees, minutes and seconds, or with the letter of their hemisphere, become degrees.

The letter stands before or behind the number, ``46.95 N`` and ``7°26'18.3"W``, or in the column behind it. Degrees,
minutes and seconds may be a column each.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
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

_PARTS = (
    re.compile(r"\+?/?-?(d|deg|degrees?|grad|degr[eé]s?|°)", re.IGNORECASE),
    re.compile(r"m|min|minutes?|minuten?|['\u2032]", re.IGNORECASE),
    re.compile(r"s|sec|seconds?|sek|sekunden?|secondes?|[\"\u2033]|''", re.IGNORECASE),
)
"""The last word of the name, or the unit, of a column of degrees, of minutes and of seconds."""
_SIXTY = 60.0
_METRES_PERHAPS = 2
_REPEATED = re.compile(r"\.\d$")
"""What a name gets that comes again, as where only units differ."""
_WORDS = re.compile(r"[\s_.(\[]+|(?<=[a-z])(?=[A-Z])")


def with_degrees(table: SourceTable) -> SourceTable:
    """Return a table whose columns of latitude and longitude are numbers of degrees, with the sign of the hemisphere.

    A column of the hemisphere's letters behind one of numbers is left out then. Others stay as they are.
    """
    table = _with_joined_parts(table)
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


def _with_joined_parts(table: SourceTable) -> SourceTable:
    """Return a table with one column of degrees in place of those of degrees, minutes and perhaps seconds.

    Raises :class:`BadInputError` for degrees of 0 without a letter of the hemisphere behind the parts: 0 has no sign.
    """
    frame, units = table.frame, dict(table.units)
    for kind, letters in _HEMISPHERES.items():
        names = _parts_of_angle(table, kind)
        if len(names) == 1:
            continue
        degrees, *smaller = (table.numbers(name) for name in names)
        size = np.abs(degrees) + sum(part / _SIXTY ** (i + 1) for i, part in enumerate(smaller))
        behind = table.columns.index(names[-1]) + 1
        has_letter = behind < len(table.columns) and _are_letters(table.frame[table.columns[behind]], letters)
        if not has_letter and (zero := np.flatnonzero(degrees == 0.0)).size:
            raise BadInputError(
                f"{table.name}: column {names[0]!r}, row {table.first_row + int(zero[0])}: 0 degrees beside minutes "
                f"have no sign; expected a letter of {letters} behind them. Hint: export decimal degrees"
            )
        frame = frame.assign(**{names[0]: np.where(degrees < 0.0, -size, size)}).drop(columns=list(names[1:]))
        units = {name: unit for name, unit in units.items() if name not in names} | {names[0]: "deg"}
    return table if frame is table.frame else replace(table, frame=frame, units=units)


def _parts_of_angle(table: SourceTable, kind: str) -> tuple[str, ...]:
    """Return the columns of degrees, minutes and seconds of the first angle of a kind; of degrees alone one name.

    Their names are equal but for the part, which may be the unit; ``m`` without seconds behind it may be metres.
    """
    first = next((i for i, name in enumerate(table.columns) if meaning(full_name(table, name)) == kind), None)
    if first is None:
        return ("",)
    names = table.columns[first : first + len(_PARTS)]
    stems = [_stem_of_part(table, name, part) for name, part in zip(names, _PARTS, strict=False)]
    count = next((i for i, stem in enumerate(stems) if stem is None or stem != stems[0]), len(stems))
    if count == _METRES_PERHAPS and _unit_of_part(table, names[1]) == "m":
        count = 1
    return tuple(names[:count]) or ("",)


def _stem_of_part(table: SourceTable, name: str, part: re.Pattern[str]) -> str | None:
    """Return the name of a column of numbers without the part of an angle that it says to be; None where it says none.

    Minutes and seconds are below 60.
    """
    column = table.frame[name]
    if not pd.api.types.is_numeric_dtype(column):
        return None
    if part is not _PARTS[0] and not column.dropna().between(0.0, _SIXTY).all():
        return None
    stem = _REPEATED.sub("", name).strip(" )]")
    word = _last_word(stem)
    if part.fullmatch(word):
        return stem[: -len(word)].strip(" _.([").casefold()
    return stem.casefold() if part.fullmatch(_unit_of_part(table, name)) else None


def _last_word(name: str) -> str:
    return _WORDS.split(name)[-1]


def _unit_of_part(table: SourceTable, name: str) -> str:
    return (table.units.get(name) or _last_word(_REPEATED.sub("", name).strip(" )]"))).strip("[]() ").casefold()


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
