"""Read the balises of a recording: which one was passed when, and where each is planned to be.

An id is text: 17, 17.0 in a column of numbers and " 17" are the same one. A place without chainage or without sigma is
not known; it is surveyed. A table of places may name one balise in several rows that say the same.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.checks import columns as checks
from trackfg.checks.columns import ColumnPlace
from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import real_path
from trackfg.io.table_file import open_table, text_column
from trackfg.recording import canonical
from trackfg.recording.description import Balises
from trackfg.recording.findings import Finding, errors
from trackfg.recording.model import BALISE_COLUMNS

_MOST_LETTERS = 200
"""Of an id: those of Eurobalises have some ten digits."""

PLACE_COLUMNS = BALISE_COLUMNS[1:]
"""``id, chainage_m, chainage_sd_m``: a table of places in memory, NaN where one is not known."""


def read_balises(folder: Path, part: Balises) -> tuple[pd.DataFrame | None, list[Finding]]:
    """Return the passages in order of time with their planned places, as the recording has them; or None and why."""
    table, findings = open_table(folder, part.file, (part.time,))
    if table is None:
        return None, findings
    raw, faults = table.numbers(part.time)
    findings = findings + faults
    ids, faults = _ids(folder, part.file, part.id)
    findings = findings + faults
    places = None
    if part.places is not None or part.chainage in table.columns:
        places, faults = _places(folder, part.places or part.file, part)
        findings = findings + faults
    if raw is not None:
        t = canonical.seconds(part, raw)
        place = ColumnPlace(part.file, part.time)
        findings = findings + checks.not_finite(t, place)
        if np.isfinite(t).all():
            findings = findings + checks.not_increasing(t, place)
    if errors(findings) or raw is None or ids is None:
        return None, findings
    passages = pd.DataFrame({"t_s": canonical.on_common_clock(part, t), "id": ids})
    if places is None:
        return passages.assign(chainage_m=np.nan, chainage_sd_m=np.nan), findings
    return passages.merge(places, on="id", how="left")[list(BALISE_COLUMNS)], findings


def read_places(path: Path) -> pd.DataFrame:
    """Read a table of planned places, columns ``id, chainage_m, sd_m``. Raises :class:`BadInputError`.

    Columns of the answer are :data:`PLACE_COLUMNS`, one row for each id.
    """
    path = real_path(path)  # a link is the user's own, other than one in a recording
    places, findings = _places(path.parent, path.name, Balises(file=path.name))
    if places is None:
        raise BadInputError(str(errors(findings)[0]))
    return places


def balises_written(part: Balises, passages: pd.DataFrame, file: str) -> tuple[Balises, pd.DataFrame]:
    """Return how passages are described and written so that reading gives the same values."""
    columns = {"time": "t_s", "id": "id", "chainage": "chainage_m", "sd": "chainage_sd_m"}
    clock = {"file": file, "places": None, "time_unit": "s", "time_offset_s": 0.0}
    return part.model_copy(update={**columns, **clock}), passages[list(BALISE_COLUMNS)]


def _ids(folder: Path, file: str, column: str) -> tuple[list[str] | None, list[Finding]]:
    ids, findings = text_column(folder, file, column)
    for row, text in enumerate(ids or ()):
        if not 0 < len(text) <= _MOST_LETTERS:
            message = "no id" if not text else f"an id of {len(text)} letters"
            expected, hint = f"1 to {_MOST_LETTERS} letters or digits", "remove the row, or write the id"
            return None, [*findings, ColumnPlace(file, column).at_row(row, "bad-id", message, expected, hint)]
    return ids, findings


def _places(folder: Path, file: str, part: Balises) -> tuple[pd.DataFrame | None, list[Finding]]:
    """Return the places that are planned, one row for each id; or None and why not."""
    table, findings = open_table(folder, file, (part.chainage, part.sd))
    if table is None:
        return None, findings
    ids, faults = _ids(folder, file, part.id)
    chainage, chainage_faults = table.numbers(part.chainage)
    sd, sd_faults = table.numbers(part.sd)
    findings = [*findings, *faults, *chainage_faults, *sd_faults]
    if ids is None or chainage is None or sd is None:
        return None, findings
    for values, name in ((chainage, part.chainage), (sd, part.sd)):
        findings += checks.not_finite(np.where(np.isnan(values), 0.0, values), ColumnPlace(file, name))
    findings += checks.unusable_sigmas(sd, ColumnPlace(file, part.sd))
    rows = pd.DataFrame(dict(zip(PLACE_COLUMNS, (ids, chainage, sd), strict=True)))
    first = rows.groupby("id", sort=False)[list(PLACE_COLUMNS[1:])].transform("first")
    for name, column in zip(PLACE_COLUMNS[1:], (part.chainage, part.sd), strict=True):
        other = (rows[name] != first[name]) & rows[name].notna()
        if other.any():
            i = int(other.to_numpy().argmax())
            message = f"balise {ids[i]!r} has {rows[name].iloc[i]:.10g} here and {first[name].iloc[i]:.10g} further up"
            hint = "give two balises two ids, or correct the row"
            expected = "the same in all rows of one id"
            findings.append(ColumnPlace(file, column).at_row(i, "id-twice", message, expected, hint))
    if errors(findings):
        return None, findings
    return pd.concat([rows[["id"]], first], axis=1).drop_duplicates("id", ignore_index=True), findings
