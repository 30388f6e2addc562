"""The estimates of a stream are tables: filtered rows, smoothed rows and rows of the geometry; and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.columns import GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.events import Event
from trackfg.streaming.tables.smoothed_tables import Tables

NO_TRAJECTORY = pd.DataFrame(columns=list(TRAJECTORY_COLUMNS), dtype=np.float64)
NO_GEOMETRY = pd.DataFrame(columns=["t_s", *GEOMETRY_COLUMNS], dtype=np.float64)


class Estimates(NamedTuple):
    """``filtered``: a row per new keyframe, from the rows up to it. ``smoothed``: rows of the trajectory, ``geometry``:
    rows of the geometry table, of what the lag is over for. Columns as in a result, and of geometry ``t_s``, when the
    place was passed; tables may be empty. ``events``: what else became known.
    """

    filtered: pd.DataFrame
    smoothed: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[Event, ...] = ()


NO_ESTIMATES = Estimates(NO_TRAJECTORY, NO_TRAJECTORY, NO_GEOMETRY)


class PassOutput(NamedTuple):
    """The pieces of the smoothed tables, and the events, that a relinearisation pass led to."""

    pieces: list[Tables]
    events: tuple[Event, ...]


def estimates_of(filtered: Sequence[Array], outputs: Sequence[PassOutput]) -> Estimates:
    """Return the estimates of filtered rows (17,), whose columns are those of a trajectory, and of passes, in order."""
    smoothed = _joined([piece.trajectory for output in outputs for piece in output.pieces], NO_TRAJECTORY)
    geometry = _joined([piece.geometry for output in outputs for piece in output.pieces], NO_GEOMETRY)
    return Estimates(
        _table(filtered), smoothed, geometry, tuple(event for output in outputs for event in output.events)
    )


def _table(rows: Sequence[Array]) -> pd.DataFrame:
    return pd.DataFrame(np.stack(rows), columns=NO_TRAJECTORY.columns) if rows else NO_TRAJECTORY


def _joined(tables: list[pd.DataFrame], none: pd.DataFrame) -> pd.DataFrame:
    filled = [table for table in tables if len(table)]
    if not filled:
        return none
    return filled[0] if len(filled) == 1 else pd.concat(filled, ignore_index=True)
