"""Rows of a receiver's tables that are no measurements of their own: held ones, and interpolated ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.recording.findings import Finding
from trackfg.recording.interpolated_rows import interpolated_rows
from trackfg.recording.model import GNSS_COLUMNS, GNSS_SPEED_COLUMNS, GNSS_SPEED_TABLE, Recording
from trackfg.recording.receiver_epochs import held_rows

_HELD = {"gnss": "gnss-held", GNSS_SPEED_TABLE: "gnss-speed-held"}
_INTERPOLATED = {"gnss": "gnss-interpolated", GNSS_SPEED_TABLE: "gnss-speed-interpolated"}
"""Codes of the findings, by table."""


class UnmeasuredRows(NamedTuple):
    """The rows (n,) of a table that are no measurements, and a warning that says so."""

    rows: np.ndarray
    finding: Finding


def unmeasured_in(recording: Recording) -> dict[str, UnmeasuredRows]:
    """Return the rows of a receiver's tables that are held, or in tables without such interpolated, by table."""
    held = held_in(recording)
    unmeasured = {name: _held(name, rows) for name, rows in held.items()}
    speeds = recording.others.get(GNSS_SPEED_TABLE)
    for name, table, columns in (
        ("gnss", recording.gnss, list(GNSS_COLUMNS[1:3])),
        (GNSS_SPEED_TABLE, speeds, [GNSS_SPEED_COLUMNS[1]]),
    ):
        if table is None or name in held:
            continue
        rows = interpolated_rows(table["t_s"].to_numpy(), table[columns].to_numpy())
        if rows.any():
            unmeasured[name] = _interpolated(name, rows)
    return unmeasured


def held_in(recording: Recording) -> dict[str, np.ndarray]:
    """Return which rows of a receiver's tables repeat the values of an earlier row, by table that has such rows.

    Speeds at the times of the positions are held as these are, unless they change by themselves.
    """
    gnss, speeds = recording.gnss, recording.others.get(GNSS_SPEED_TABLE)
    held = {}
    if gnss is not None and len(gnss):
        place = gnss[list(GNSS_COLUMNS[1:3])].to_numpy()
        held["gnss"] = held_rows(gnss["t_s"].to_numpy(), gnss[list(GNSS_COLUMNS[1:])].to_numpy(), place)
    if speeds is not None and len(speeds):
        t, measured = speeds["t_s"].to_numpy(), speeds[list(GNSS_SPEED_COLUMNS[1:])].to_numpy()
        if gnss is not None and np.array_equal(t, gnss["t_s"]):
            both = np.concatenate([gnss[list(GNSS_COLUMNS[1:])].to_numpy(), measured], axis=1)
            held[GNSS_SPEED_TABLE] = held_rows(t, both, place)
        else:
            held[GNSS_SPEED_TABLE] = held_rows(t, measured)
    return {name: rows for name, rows in held.items() if rows.any()}


def _held(name: str, rows: np.ndarray) -> UnmeasuredRows:
    message = "repeat the values of the row above while the vehicle moves"
    hint = "leave out rows that repeat the one above, as trackfg import does; only the first of them is a measurement"
    return _warning(name, rows, _HELD[name], message, hint)


def _interpolated(name: str, rows: np.ndarray) -> UnmeasuredRows:
    message = "are interpolated, on straight lines between the receiver's measurements"
    hint = "write the receiver's own rows, or leave out those between them, as trackfg import does"
    return _warning(name, rows, _INTERPOLATED[name], message, hint)


def _warning(name: str, rows: np.ndarray, code: str, message: str, hint: str) -> UnmeasuredRows:
    finding = Finding(
        "warning",
        code,
        f"{np.count_nonzero(rows)} of {len(rows)} rows {message}",
        file="recording.toml",
        column=f"{name}.file",
        expected="each measurement once",
        hint=hint,
    )
    return UnmeasuredRows(rows, finding)
