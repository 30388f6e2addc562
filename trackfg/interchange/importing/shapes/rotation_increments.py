"""Increments of orientation as quaternions, ``OriInc_q0`` to ``OriInc_q3`` of Xsens, become angles about three axes.

A quaternion (w, x, y, z) that turns the sensor from one sample to the next is the rotation vector whose direction is
that of (x, y, z) and whose length is twice the angle between w and 1 (Xsens, MT Low-Level Communication Protocol:
XDI_DeltaQ).
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from trackfg.interchange.importing.source_table import SourceTable

_PART = re.compile(
    r"(?P<stem>.*?(?:ori\w*?inc|delta_?q(?:uat\w*)?|\bd_?q))[\s_.\[(]*(?:q_?)?(?P<part>[0-4]|[wxyz])[)\]]?",
    re.IGNORECASE,
)
_PARTS = ("0123", "wxyz", "1234")
_SMALL, _UNIT = 0.9, 1e-3
"""Least w of a turn from one sample to the next, half a turn in 0.9 rad, and what rounding makes of a length of 1."""


def with_angles(table: SourceTable) -> SourceTable:
    """Return a table with three columns ``delta_angle``, rad, in place of increments as quaternions."""
    groups: dict[str, dict[str, str]] = {}
    for name in table.columns:
        if (match := _PART.fullmatch(name.strip())) and pd.api.types.is_numeric_dtype(table.frame[name]):
            groups.setdefault(match["stem"], {})[match["part"].casefold()] = name
    for parts in groups.values():
        order = next((order for order in _PARTS if set(parts) == set(order)), None)
        if order is None:
            continue
        names = [parts[part] for part in order]
        turns = np.stack([table.numbers(name) for name in names], axis=1)
        known = np.isfinite(turns).all(axis=1)
        if not known.any() or not _are_small(turns[known]):
            continue
        angles = np.full((len(turns), 3), np.nan)
        angles[known] = Rotation.from_quat(turns[known], scalar_first=True).as_rotvec()
        columns = {f"delta_angle_{axis}": part for axis, part in zip("xyz", angles.T, strict=True)}
        frame = table.frame.drop(columns=names).assign(**columns)
        return replace(table, frame=frame, units={**table.units, **dict.fromkeys(columns, "rad")})
    return table


def _are_small(turns: np.ndarray) -> bool:
    """Return whether quaternions (n, 4) are of length 1, and turn little from one sample to the next."""
    lengths = np.linalg.norm(turns, axis=1)
    return bool((np.abs(lengths - 1.0) < _UNIT).all() and (turns[:, 0] > _SMALL).all())
