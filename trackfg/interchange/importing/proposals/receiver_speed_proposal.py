"""Which column is the receiver's own speed, and which its accuracy: beside its positions, else by its name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from trackfg.interchange.importing.columns.column_meaning import has_axes_beside, kind_in, stem_of
from trackfg.interchange.importing.columns.written_units import unit_in
from trackfg.interchange.importing.proposals.questions import Proposal
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.recording.description import RECEIVER_SPEED_SD_MPS

_ACCURACY = re.compile(
    r"^s[\s_]?acc$|(speed|vel\w*|geschw\w*)[\s_]?(acc|sd|std|sigma|err|uncert|genau)|^sd[\s_]?(speed|vel)"
)
"""Names of a speed's accuracy; u-blox calls it ``sAcc``."""
_OF_A_RECEIVER = re.compile(r"gps|gnss|ground|sog|gspeed|location")
"""Names that only a receiver's speed has."""
NAMED_AFTER_RECEIVERS = re.compile(r"gps|gnss")
"""Names of speeds and distances, or of their tables, that no wheel gives."""
NOT_MEASURED = re.compile(
    r"vert|delta|clipping|(^|[\s_])dt$|climb|wind|limit|soll|(^|[\s_])set|target|permit|max|avg|mean|engine"
)
"""Names of speeds that are none of the vehicle's at the time: of limits, set values, changes and statistics."""
_OTHER = re.compile(r"wheel|whl|rad(?!ar|ius)|axle|achse|tach|odo|obd|ecu|\bcan\b|radar|doppler|rpm")
"""Names of speeds that no receiver measures."""
_KNOWN = 0.5
"""Share of the rows with a speed that have an accuracy above 0, from which on it is one: phones write 0 or -1."""


def propose_receiver_speed(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    """Add the section of the receiver's speeds where the table of its positions has some, or without positions a table
    has a speed that is named after GPS or GNSS.
    """
    gnss = proposal.sections.get("gnss", {})
    for table in tables:
        if table.name == gnss.get("file", table.name) and _add_speed(proposal, table, gnss):
            return


def _add_speed(proposal: Proposal, table: SourceTable, gnss: dict[str, Any]) -> bool:
    """Add the section of a table's speeds, beside that of positions if there is one; return whether it has any."""
    used = proposal.sections.get("tach", {}).get("column")
    numbers = [name for name in table.columns if name != used and pd.api.types.is_numeric_dtype(table.frame[name])]
    accuracies = [name for name in numbers if _ACCURACY.search(name.casefold())]
    names = [name for name in numbers if name not in accuracies and _is_speed(table, name)]
    if not gnss:
        names = [name for name in names if NAMED_AFTER_RECEIVERS.search(f"{stem_of(table.name)} {name}".casefold())]
    name = next((one for one in names if _OF_A_RECEIVER.search(one.casefold())), next(iter(names), None))
    if name is None or not (table.numbers(name) > 0.0).any():  # a phone writes -1 where it knows none
        return False
    clock = {key: gnss[key] for key in gnss if key.startswith(("time", "tick", "wraps", "valid"))}
    section: dict[str, Any] = {"file": table.name, **(clock or proposal.times_of(table)), "column": name}
    unit = unit_in(table.units.get(name) or name, "speed")
    if unit is None:
        proposal.assumed["gnss_speed.unit"] = f"Unit of {name}"
    section["unit"] = unit or "m/s"
    accuracy = next((one for one in accuracies if _is_known(table, name, one)), None)
    if accuracy is not None:
        section["sd"] = accuracy
    else:
        proposal.reasons["gnss_speed.unit"] = f"sigmas of {RECEIVER_SPEED_SD_MPS:g} m/s are assumed (sd_mps)"
    proposal.sections["gnss_speed"] = section
    return True


def _is_speed(table: SourceTable, name: str) -> bool:
    """Return whether a column holds speeds that a receiver may have measured."""
    text = name.casefold()
    of_receiver = (
        _OF_A_RECEIVER.search(text) is not None and unit_in(table.units.get(name) or name, "speed") is not None
    )
    means = kind_in(table, name) == "speed" or of_receiver
    return means and not (_OTHER.search(text) or NOT_MEASURED.search(text) or has_axes_beside(table, name))


def _is_known(table: SourceTable, speed: str, accuracy: str) -> bool:
    """Return whether most speeds have this accuracy."""
    known = table.numbers(speed) > 0.0
    return bool(np.mean(table.numbers(accuracy)[known] > 0.0) > _KNOWN)
