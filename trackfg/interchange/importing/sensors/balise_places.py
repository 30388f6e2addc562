"""Where the balises of a source are planned, as a table of places has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import read_stations
from trackfg.recording.description import Balises

if TYPE_CHECKING:
    from trackfg.numerics.chainage.kilometrage import Kilometrage
    from trackfg.numerics.chainage.km_notation import Bare

COLUMNS = Balises(file="")
"""Names of columns that a mapping need not state, and that the recording gets."""


def planned_places(
    table: SourceTable, keys: Mapping[str, Any], unit: Bare, kilometrage: Kilometrage | None
) -> pd.DataFrame | None:
    """Return the places in a table, row by row: id, chainage and sigma, m; None where it has no chainage.

    ``keys`` are those of ``[balises]``; ``sd`` may be a number. Raises :class:`BadInputError` with column and row.
    """
    chainage = keys.get("chainage", COLUMNS.chainage)
    if not {"chainage", "places"} & set(keys) and chainage not in table.columns:
        return None
    sd = keys.get("sd", COLUMNS.sd)
    if isinstance(sd, bool) or not isinstance(sd, str | int | float):
        raise BadInputError(f"[balises]: {sd!r} is no column; expected a name or a number")
    return pd.DataFrame(
        {
            COLUMNS.id: table.column(keys.get("id", COLUMNS.id)),
            COLUMNS.chainage: read_stations(table, chainage, unit, kilometrage),
            COLUMNS.sd: table.numbers(sd) if isinstance(sd, str) else np.full(len(table.frame), float(sd)),
        }
    )
