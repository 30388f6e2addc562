"""A baseline gives back the smoother's tables, as far as the paper's system has them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.files.parquet import write_parquet
from trackfg.numerics.arrays import Array
from trackfg.results.columns import EVENT_COLUMNS, GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.events import no_events
from trackfg.results.summary import versions

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_TRAJECTORY, _GEOMETRY, _EVENTS, _HEAD = FILES = (
    "trajectory.parquet",
    "geometry.parquet",
    "events.csv",
    "baseline.json",
)
STEP_M = 0.25
"""The step of a baseline's geometry, m: that of the smoother's unless it is set, so that rows can be compared."""
TRAJECTORY_S = 0.1
"""The step of a baseline's trajectory, s: the default of the smoother's results."""

GNSS_CLOCK = "gnss_clock_offset_s"
"""The parameter that says by how much the stamps of GNSS are early: positions were measured so much later, s."""

_FORMAT = "trackfg-baseline/1"
BASELINE_FOLDER = FolderKind("baseline's result", _HEAD, "trackfg-baseline/", FILES)


@dataclass(frozen=True)
class BaselineResult:
    """The tables have the columns of :mod:`trackfg.results.result`, NaN where the system says nothing.

    ``parameters`` are those it ran with, and what it estimated of the sensors: :data:`GNSS_CLOCK`.

    Raises ``ValueError`` for other columns.
    """

    name: str
    trajectory: pd.DataFrame
    geometry: pd.DataFrame = field(default_factory=lambda: filled(GEOMETRY_COLUMNS, {}))
    events: pd.DataFrame = field(default_factory=no_events)
    parameters: dict[str, float | str | bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for table, columns in (
            (self.trajectory, TRAJECTORY_COLUMNS),
            (self.geometry, GEOMETRY_COLUMNS),
            (self.events, EVENT_COLUMNS),
        ):
            if tuple(table.columns[: len(columns)]) != columns:
                raise ValueError(f"{self.name}: columns {list(table.columns)}: expected {list(columns)}")

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write the tables, and ``baseline.json`` with name and parameters, replacing an earlier one in one step.

        Raises :class:`BadInputError` if ``folder`` holds anything but a baseline's result.
        """
        folder = Path(folder)
        BASELINE_FOLDER.refuse_foreign(folder)
        about = {"format": _FORMAT, "name": self.name, "parameters": self.parameters, "versions": versions()}
        with replaced_folder(folder) as new:
            write_parquet(self.trajectory, new / _TRAJECTORY)
            write_parquet(self.geometry, new / _GEOMETRY)
            self.events.to_csv(new / _EVENTS, index=False)
            (new / _HEAD).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        return folder


def recorded(parameters: DataclassInstance) -> dict[str, float | str | bool]:
    """Return the parameters of a run as ``baseline.json`` has them.

    Fields of a nested dataclass are joined to its name by ``_``, items of a tuple by ``-``; None is left out.
    """
    flat: dict[str, float | str | bool] = {}
    for field_ in fields(parameters):
        value = getattr(parameters, field_.name)
        if is_dataclass(value) and not isinstance(value, type):
            flat |= {f"{field_.name}_{name}": part for name, part in recorded(value).items()}
        elif isinstance(value, tuple):
            flat[field_.name] = "-".join(map(str, value))
        elif value is not None:
            flat[field_.name] = value
    return flat


def filled(columns: tuple[str, ...], known: dict[str, np.ndarray]) -> pd.DataFrame:
    """Return a table of what is known, the other columns NaN. Raises ``ValueError`` for an unknown name."""
    if unknown := sorted(set(known) - set(columns)):
        raise ValueError(f"{', '.join(unknown)}: not among {', '.join(columns)}")
    rows = len(next(iter(known.values()))) if known else 0
    return pd.DataFrame({name: known.get(name, np.full(rows, np.nan)) for name in columns})


def resampled_trajectory(t: Array, known: Mapping[str, Array | None]) -> pd.DataFrame:
    """Return a trajectory at every :data:`TRAJECTORY_S`: columns (n,) at times ``t`` (n,), s, interpolated linearly.

    Columns that are None or not among ``known`` are NaN. Raises ``ValueError`` for times that do not grow, and for
    columns of another length.
    """
    if not (np.diff(t) > 0.0).all():
        raise ValueError(f"t, row {int(np.argmin(np.diff(t) > 0.0)) + 2}: expected times that grow")
    for column, values in known.items():
        if values is not None and len(values) != len(t):
            raise ValueError(f"{column}: {len(values)} values at {len(t)} times; expected as many")
    clock = np.arange(t[0], t[-1], TRAJECTORY_S)
    at = {column: np.interp(clock, t, values) for column, values in known.items() if values is not None}
    return filled(TRAJECTORY_COLUMNS, {"t_s": clock, **at})
