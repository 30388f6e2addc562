"""What a receiver says of its positions: that a row has none, and the dilution of precision.

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
    r"(^|\.)((fix|gps|gnss|gga)[\s_-]?(quality|qual|type|mode|status|valid|ok)|(quality|fix|valid|gnssfixok|status\.status)$)",
    re.I,
)
"""Names of what a receiver says of a position, also at the end of a path in a message."""
_DILUTION = re.compile(r"(^|\.)(h[\s_-]?dop\b|dop$)", re.I)
"""Names of the (horizontal) dilution of precision."""
_WORDS = ("v", "n", "no", "false", "none", "invalid", "no fix", "nofix", "not valid", "estimated", "dead reckoning")
"""Words without a position: the status V of NMEA, and what programs write for the numbers."""
_ESTIMATED, _HIGHEST_QUALITY = 6.0, 9.0
"""Quality of an estimated position; some receivers have one more than the 8 of NMEA. A percentage goes beyond."""
_IN_THREE_DIMENSIONS = 3.0
"""Type of a fix in three dimensions: where it occurs, 1 is no position, and not one without corrections."""


def state_column(table: SourceTable) -> str | None:
    """Return the column of what a receiver says of its positions; None where the table has none."""
    return table.name_like(_STATE)


def dilution_column(table: SourceTable) -> str | None:
    """Return the column of the dilution of precision; None where the table has none."""
    return table.name_like(_DILUTION)


def without_position(state: pd.Series) -> np.ndarray:
    """Return where a receiver's column of states says that it has measured no position, (n,)."""
    text = state.astype("string").str.strip().str.casefold().str.replace(r"[\s_-]+", " ", regex=True)
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
