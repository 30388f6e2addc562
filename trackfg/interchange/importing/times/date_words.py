"""Dates with words in them, in the languages of loggers and spreadsheets, become dates as English programs write them.

``Fr, 14. März 2026 03:12:00`` becomes ``14 Mar 2026 03:12:00``: months are English and short, days of the week and the
points of ordinal numbers are left out, and a time of day stands behind its date.
"""

from __future__ import annotations

import re

import pandas as pd

_MONTHS = {
    "Jan": "jan januar january januari janvier janv jän jänner gen gennaio ene enero sty januára января янв",
    "Feb": "feb februar february februari février fevrier févr fev fevr febbraio febrero lut február февраля фев",
    "Mar": "mar märz maerz mär mrz march mars maart mrt marzo března марта мар",
    "Apr": "apr april avril avr aprile abril abr kwi апреля апр",
    "May": "may mai maj mei mag maggio mayo maja мая май",
    "Jun": "jun juni june juin juin giu giugno junio cze июня июн",
    "Jul": "jul juli july juillet juil lug luglio julio lip июля июл",
    "Aug": "aug august augusti augustus août aout ago agosto sie августа авг",
    "Sep": "sep sept september septembre septembrie set settembre septiembre wrz сентября сен",
    "Oct": "oct okt oktober october octobre ott ottobre octubre paź октября окт",
    "Nov": "nov november novembre noviembre lis ноября ноя",
    "Dec": "dec dez december dezember décembre decembre déc dic dicembre diciembre gru декабря дек",
}
_SHORT = {word: month for month, words in _MONTHS.items() for word in words.split()}
"""English, German, French, Italian, Spanish, Dutch, Swedish, Polish and Russian, in full and as they are shortened."""
_WORD = re.compile(r"[^\W\d_]{3,}\.?")
_WEEKDAY = re.compile(r"^[^\W\d_]{2,}[.,]\s+(?=\d)")
"""A day of the week before the date; one without a point or comma behind it is that of ``ctime``."""
_ORDINAL = re.compile(r"(?<=^\d)\.\s*(?=[A-Z])|(?<=^\d\d)\.\s*(?=[A-Z])")
_TIME_FIRST = re.compile(r"^(\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?(?: ?[AaPp][Mm])?)\s+(\d.*)$")


def in_english(text: pd.Series) -> pd.Series:
    """Return written times (n,) with their words in English, and the date first; others as they are."""
    first = str(text.iloc[0])
    if _TIME_FIRST.match(first):
        text = text.str.replace(_TIME_FIRST, r"\2 \1", regex=True)
    if not any(word.rstrip(".").casefold() in _SHORT for word in _WORD.findall(first)):
        return text
    text = text.str.replace(_WEEKDAY, "", regex=True).str.replace(_WORD, _in_english, regex=True)
    return text.str.replace(_ORDINAL, " ", regex=True)


def _in_english(match: re.Match[str]) -> str:
    """Return the English word for that of a month, another word as it is."""
    return _SHORT.get(match[0].rstrip(".").casefold(), match[0])
