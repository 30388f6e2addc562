"""What a receiver says of its positions: that a row has none, its quality, and the dilution of precision.

Two scales of numbers are in use. The quality of NMEA's GGA (NMEA 0183): 0 no position, 1 to 5 measured ones, 6
estimated by dead reckoning. The type or mode of a fix (NMEA GSA, UBX NAV-PVT, MAVLink, gpsd): 0 and 1 no position that
is measured, 2 and 3 in two and three dimensions. ``NavSatStatus`` of ROS has -1 without a position, and 0 with one.
"""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from trackfg.interchange.importing.source_table import SourceTable

_STATE = re.compile(
    r"(^|\.)((fix|gps|gnss|gga|pos(ition)?)[\s_-]?(quality|qual|type|mode|status|valid|ok)|(gps|gnss)[\s_(]*fix\)?$|"
    r"(quality|fix|valid|gnssfixok|status\.status)$)",
    re.I,
)
"""Names of what a receiver says of a position, also at the end of a path in a message."""
_DILUTION = re.compile(r"(^|\.)(h[\s_-]?dop\b|dop$)", re.I)
"""Names of the (horizontal) dilution of precision."""
_WORDS = ("v", "n", "no", "false", "none", "invalid", "no fix", "nofix", "not valid", "estimated", "dead reckoning")
"""Words without a position: the status V of NMEA, and what programs write for the numbers."""
_ESTIMATED, _HIGHEST_QUALITY = 6.0, 9.0
"""Quality of an estimated position; some receivers have one more than the 8 of NMEA. A percentage goes beyond."""
RANGE_SD_M = 3.0
"""Error of one range, m: with the dilution of precision it gives a sigma where the receiver states none (GPS SPS
Performance Standard 2020, single frequency)."""
UNKNOWN_HEIGHT_SD_M = 1000.0
"""Sigma of the height 0 where a source has none, m: no railway is as high as five of it."""
RANGE_SD_BY_QUALITY_M = {2: 1.0, 4: 0.05, 5: 0.5}
"""The same by quality: with corrections of code (2), carrier phase with its ambiguities fixed (4) or not (5). A ZED-F9P
has 1.0 m of 2 and 0.01 m of 4 by its data sheet, under an open sky. That of other positions is :data:`RANGE_SD_M`."""
HIGHEST_MEASURED = 5
"""Highest quality of a measurement; estimated, typed or simulated positions, 6 and above, are none."""
_WORDS_OF_QUALITY = {
    5: r"\bfloat",
    4: r"\brtk|\b(?:narrow|wide|l1) int",
    2: r"\bd ?g(?:ps|nss)|\b(?:psr ?)?diff|\bsbas",
}
"""Words for a quality, of programs and of NovAtel's position types. The first one holds: ``RTK float`` is 5."""
_IN_THREE_DIMENSIONS = 3.0
"""Type of a fix in three dimensions: where it occurs, 1 is no position, and not one without corrections."""


def state_column(table: SourceTable) -> str | None:
    """Return the column of what a receiver says of its positions; None where the table has none."""
    return table.name_like(_STATE)


def dilution_column(table: SourceTable) -> str | None:
    """Return the column of the dilution of precision; None where the table has none."""
    return table.name_like(_DILUTION)


def quality_column(table: SourceTable) -> str | None:
    """Return the column whose qualities mark positions that are better than usual; None where the table has none."""
    names = [name for name in table.columns if _STATE.search(name.strip())]
    return next((name for name in names if (range_sd_m(table.column(name)) != RANGE_SD_M).any()), None)


def range_sd_m(state: pd.Series) -> np.ndarray:
    """Return the error of one range (n,), m, by a receiver's column of qualities: NMEA's numbers, or words.

    Numbers in a column of another name than a quality's, and those of a percentage, mean nothing.
    """
    number = pd.to_numeric(state, errors="coerce").to_numpy(np.float64, na_value=np.nan)
    sd = np.full(len(state), RANGE_SD_M)
    if np.isnan(number).all():
        text = _plain(state)
        for quality, words in reversed(_WORDS_OF_QUALITY.items()):
            sd[text.str.contains(words).fillna(value=False).to_numpy(bool)] = RANGE_SD_BY_QUALITY_M[quality]
    elif "qual" in str(state.name).casefold() and np.nanmax(number) <= _HIGHEST_QUALITY:
        for quality, range_sd in RANGE_SD_BY_QUALITY_M.items():
            sd[number == quality] = range_sd
    return sd


def without_position(state: pd.Series) -> np.ndarray:
    """Return where a receiver's column of states says that it has measured no position, (n,)."""
    text = _plain(state)
    number = pd.to_numeric(state.astype("string").str.strip(), errors="coerce").to_numpy(np.float64, na_value=np.nan)
    lost = np.array(text.isin(_WORDS) | text.isna() | (text == "") | (number < 0.0))
    name, highest = str(state.name).casefold(), np.nanmax(number, initial=-np.inf)
    if name.endswith("status.status") or (number < 0.0).any():
        return lost
    lost |= number == 0.0
    if "qual" in name and highest <= _HIGHEST_QUALITY:
        lost |= number == _ESTIMATED
    if ("type" in name or "mode" in name) and (number == _IN_THREE_DIMENSIONS).any():
        lost |= number == 1.0
    return lost


def _plain(state: pd.Series) -> pd.Series:
    """Return the words of a column in small letters, with single blanks between them."""
    return state.astype("string").str.strip().str.casefold().str.replace(r"[\s_-]+", " ", regex=True)
