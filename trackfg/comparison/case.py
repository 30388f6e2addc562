"""A case of a comparison, what one run of it gave, and what every kind of case does with its estimators."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pandas as pd

from trackfg.comparison.table import QUANTITIES, SCORE_COLUMNS, Basis, Difference
from trackfg.comparison.withholding import Withheld
from trackfg.errors import TrackfgError

Progress = Callable[[str, float], None]

CaseKind = Literal["scenario", "recording", "alone", "withheld", "friction"]
"""What is compared: estimators of a railway recording, simulated or read, one ``alone`` that nothing is held against,
and the same with a part of its measurements ``withheld``; or of a car's tyre friction.
"""

_Input = TypeVar("_Input")
_Output = TypeVar("_Output")


@dataclass(frozen=True)
class Case:
    """A run to be made: of a scenario or a friction drive by its seed, or of the recording in ``folder``.

    ``name`` is that of the table. Where measurements are ``withheld``, ``seed`` is the part of them.
    """

    name: str
    kind: CaseKind = "scenario"
    seed: int = 0
    duration_s: float | None = None
    folder: Path = Path()
    withheld: Withheld | None = None


@dataclass(frozen=True)
class CaseRun:
    """The outcome of one run. ``seconds`` that each estimator took; ``left_out``: why others could not.

    ``scores`` with :data:`trackfg.comparison.table.SCORE_COLUMNS` (empty without a truth); ``geometry`` and
    ``positions`` as in :mod:`trackfg.comparison.table`, where they are kept: always without a truth.
    """

    case: Case
    summary: str
    duration_s: float
    distance_km: float
    basis: Basis
    seconds: Mapping[str, float]
    left_out: Mapping[str, str]
    scores: pd.DataFrame = field(default_factory=pd.DataFrame)
    geometry: pd.DataFrame = field(default_factory=pd.DataFrame)
    positions: pd.DataFrame = field(default_factory=pd.DataFrame)
    differences: tuple[Difference, ...] = ()


def run_all(
    known: Mapping[str, Callable[[_Input], _Output]], given: _Input, show: Progress
) -> tuple[dict[str, _Output], dict[str, float], dict[str, str]]:
    """Run estimators on one input; return what each gives, the seconds that it took, and why the others gave nothing.

    ``show(name, fraction)`` is called before each.
    """
    given_back: dict[str, _Output] = {}
    seconds: dict[str, float] = {}
    left_out: dict[str, str] = {}
    for number, (name, run) in enumerate(known.items()):
        show(name, number / len(known))
        start = time.perf_counter()
        try:
            given_back[name] = run(given)
        except TrackfgError as error:
            left_out[name] = str(error)
        else:
            seconds[name] = time.perf_counter() - start
    show("scores", 1.0)
    return given_back, seconds, left_out


def score_table(case: Case, scores: pd.DataFrame, seconds: Mapping[str, float], km: float) -> pd.DataFrame:
    """Return the scores of one run with :data:`trackfg.comparison.table.SCORE_COLUMNS`; ``km`` is its length."""
    scores = scores[scores["quantity"].isin(QUANTITIES) & (scores["places"] > 0)]
    table = scores.assign(case=case.name, seed=case.seed, seconds=scores["estimator"].map(seconds), distance_km=km)
    return table.reindex(columns=list(SCORE_COLUMNS)).reset_index(drop=True)


def joined(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate the tables that have rows; a column that one of them lacks is NaN there."""
    kept = [table.dropna(axis="columns", how="all") for table in tables if len(table)]
    return pd.concat(kept, ignore_index=True) if kept else pd.DataFrame()


def largest_distance_km(trajectories: Iterable[pd.DataFrame]) -> float:
    """Return the length of the longest of some trajectories, km; NaN of none."""
    return max(map(distance_km, trajectories), default=np.nan)


def distance_km(trajectory: pd.DataFrame) -> float:
    """Return the length of a trajectory, to and fro, km."""
    return 1e-3 * float(trajectory["chainage_m"].diff().abs().sum())


def with_first_column(name: str, value: str, table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with this column in front."""
    table = table.drop(columns=name, errors="ignore")
    table.insert(0, name, value)
    return table
