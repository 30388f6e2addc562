"""A comparison holds the scores of every run, a table of them, and the curves of one run of each case.

===================  =========================================================================================
file                 content
===================  =========================================================================================
comparison.json      :class:`About`: what was compared, what was left out and why, and the rows of the table
comparison.parquet   one row per run, estimator, quantity and speed band, columns :data:`SCORE_COLUMNS`
geometry.parquet     the geometry tables of the first run of each case under each other, with ``case, estimator``
                     before and, where there is a truth, ``QUANTITY_error`` behind; the truth is estimator ``truth``.
                     Of a recording that nothing is held against, ``QUANTITY_error`` is the smoother's taken off
positions.parquet    the same runs over time: ``case, estimator, t_s, speed_mps``, errors and sigmas of
                     :func:`trackfg.evaluation.trajectory_errors.trajectory_errors`
===================  =========================================================================================
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from trackfg.errors import BadInputError, counted
from trackfg.evaluation.scores import STATISTICS, margin
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.files.parquet import read_frame, write_parquet
from trackfg.numerics.key_figures import KeyFigures
from trackfg.results.soundness import refuse_empty, refuse_other_than_numbers
from trackfg.results.summary import versions

TRUTH = "truth"
REFERENCE = "smoother"
"""The estimator that all others are held against."""

SCORE_COLUMNS = (
    "case",
    "seed",
    "estimator",
    "quantity",
    "from_kmh",
    "places",
    *STATISTICS,
    "seconds",
    "distance_km",
)
"""``seed`` is 0 for a recording; ``from_kmh`` NaN for the whole run; ``seconds`` is what the estimator took for it."""

_HEAD, _SCORES, _GEOMETRY, _POSITIONS = FILES = (
    "comparison.json",
    "comparison.parquet",
    "geometry.parquet",
    "positions.parquet",
)
_TEXT = ("case", "estimator", "quantity")
"""Columns of texts, in any of the tables."""
COMPARISON_FOLDER = FolderKind("comparison", _HEAD, "trackfg-comparison/", FILES)

Task = Literal[
    "attitude and cross-level", "twist", "versines", "distance and position", "what was withheld", "friction"
]


@dataclass(frozen=True)
class Quantity:
    """``statistic`` is the one that counts: of what has one unknown offset per run, the standard deviation."""

    task: Task
    label: str
    unit: str
    statistic: Literal["rms", "sd"] = "rms"

    @property
    def heading(self) -> str:
        """Return label and unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label


QUANTITIES: dict[str, Quantity] = {
    "cross_level_mm": Quantity("attitude and cross-level", "cross-level, offset removed", "mm", "sd"),
    "roll_mrad": Quantity("attitude and cross-level", "roll, offset removed", "mrad", "sd"),
    "pitch_mrad": Quantity("attitude and cross-level", "pitch, offset removed", "mrad", "sd"),
    "twist_mm": Quantity("twist", "twist", "mm"),
    "versine_level_mm": Quantity("versines", "versine of level", "mm"),
    "versine_alignment_mm": Quantity("versines", "versine of alignment", "mm"),
    "distance_percent": Quantity("distance and position", "distance of each km", "%"),
    "along_track_m": Quantity("distance and position", "place along the track", "m"),
    "speed_kmh": Quantity("distance and position", "speed", "km/h"),
    "east_m": Quantity("distance and position", "east", "m"),
    "north_m": Quantity("distance and position", "north", "m"),
    "withheld_fix_m": Quantity("what was withheld", "fixes, withheld", "m"),
    "withheld_position_m": Quantity("what was withheld", "GNSS positions, withheld", "m"),
    "withheld_way_m": Quantity("what was withheld", "distance within 20 s of tachometer, withheld", "m"),
    "slip_angle_mrad": Quantity("friction", "slip angle", "mrad"),
    "friction": Quantity("friction", "friction", ""),
}
"""What is scored, in the order of the tables."""

BANDED = ("versine_level_mm", "versine_alignment_mm")
BAND_KMH = 5.0
"""What is scored by speed too, and the width of a band."""


class _ComparisonModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _scored(quantity: str) -> str:
    if quantity not in QUANTITIES:
        raise ValueError(f"expected one of {', '.join(QUANTITIES)}")
    return quantity


ScoredQuantity = Annotated[str, AfterValidator(_scored)]
"""A key of :data:`QUANTITIES`."""
Basis = Literal["truth", "repeatability", "withheld", "smoother"]
"""What estimates are held against: the truth, the first run, measurements that were withheld from them, or, where no
score is meant, the smoother's.
"""


class ComparedCase(_ComparisonModel):
    """A scenario with its seeds, or a recording. Where measurements are withheld, the ``seeds`` are their parts."""

    name: str
    summary: str = ""
    basis: Basis = "truth"
    seeds: tuple[int, ...] = (0,)
    duration_s: FiniteFloat
    distance_km: FiniteFloat


class LeftOut(_ComparisonModel):
    """An estimator that cannot use a case, and why."""

    case: str
    estimator: str
    reason: str


class Row(_ComparisonModel):
    """One estimator, quantity and speed band of a case, over its runs.

    ``error``: the mean over runs of each run's statistic, in the quantity's unit; ``error_margin``: half its 95 %
    interval; ``largest`` of all; ``coverage``: the share of errors within 1.96 of the claimed sigmas; ``to_smoother``:
    the geometric mean over runs of error over the smoother's error in the same run, above 1 where the smoother is
    better, and ``to_smoother_interval`` its 95 % interval. None where there is no such thing.
    """

    case: str
    task: Task
    quantity: ScoredQuantity
    statistic: Literal["rms", "sd"]
    from_kmh: float | None
    estimator: str
    runs: int
    error: float
    error_margin: float | None
    largest: float | None
    coverage: float | None
    to_smoother: float | None
    to_smoother_interval: tuple[float, float] | None
    seconds_per_km: float | None

    @property
    def beats_the_smoother(self) -> bool:
        """Return whether it is better, by chance or not."""
        return self.to_smoother is not None and self.to_smoother < 1.0


class Difference(_ComparisonModel):
    """The rms difference of an estimator from the smoother over a kilometre of a case, in the quantity's unit, its mean
    over the run removed where the quantity has one unknown offset.
    """

    case: str
    estimator: str
    quantity: ScoredQuantity
    from_km: float
    rms: float


class About(_ComparisonModel):
    """``comparison.json``. ``estimators``: a line on each; ``seconds`` that everything took; ``differences`` of a
    recording without a truth.
    """

    format: Literal["trackfg-comparison/1"] = "trackfg-comparison/1"
    versions: dict[str, str] = Field(default_factory=lambda: versions())
    seconds: FiniteFloat
    cases: tuple[ComparedCase, ...]
    estimators: dict[str, str]
    left_out: tuple[LeftOut, ...]
    rows: tuple[Row, ...]
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True, repr=False)
class Comparison(KeyFigures):
    """A comparison has the scores of estimators on the same recordings, and the curves of one run of each case.

    Attributes
    ----------
    about
        What was compared, what was left out and why.
    scores
        One row per run, estimator, quantity and speed band; ``from_kmh`` is NaN for the whole run.
    geometry
        The geometry tables of the first run of each case under each other, with ``case`` and ``estimator``.
    positions
        The errors of the same runs over time, likewise.

    Examples
    --------
    >>> from trackfg.comparison import Comparison, cases_of, compare
    >>> folder = compare(cases_of(["run1"]), peers=False).write("comparison1")
    >>> "smoother" in set(Comparison.read(folder).scores["estimator"])
    True
    """

    about: About
    scores: pd.DataFrame
    geometry: pd.DataFrame
    positions: pd.DataFrame

    def key_figures(self) -> dict[str, str]:
        """Return the cases, the estimators and the number of scores."""
        return {
            "cases": ", ".join(case.name for case in self.about.cases) or "no case",
            "runs": counted(sum(len(case.seeds) for case in self.about.cases), "run"),
            "estimators": counted(len(self.about.estimators), "estimator"),
            "scores": f"{len(self.scores)} scores",
        }

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write it, replacing an earlier one in one step. Raises :class:`BadInputError` if ``folder`` holds anything
        but a comparison.
        """
        folder = Path(folder)
        COMPARISON_FOLDER.refuse_foreign(folder)
        with replaced_folder(folder) as new:
            (new / _HEAD).write_text(self.about.model_dump_json(indent=2) + "\n", encoding="utf-8")
            write_parquet(self.scores, new / _SCORES)
            write_parquet(self.geometry, new / _GEOMETRY)
            write_parquet(self.positions, new / _POSITIONS)
        return folder

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Comparison:
        """Read a comparison. Raises :class:`BadInputError` if it is not one."""
        content = COMPARISON_FOLDER.read(Path(folder))
        try:
            about = About.model_validate_json(content[_HEAD])
            tables = {name: read_frame(content[name]) for name in (_SCORES, _GEOMETRY, _POSITIONS)}
            refuse_other_than_numbers(_SCORES, tables[_SCORES], SCORE_COLUMNS, _TEXT)
            _refuse_other_than_curves(_GEOMETRY, tables[_GEOMETRY], "chainage_m")
            _refuse_other_than_curves(_POSITIONS, tables[_POSITIONS], "t_s")
        except (ValidationError, ValueError, OSError) as error:
            raise BadInputError(f"{folder}: not a readable trackfg comparison: {error}") from error
        return cls(about, *tables.values())


def _refuse_other_than_curves(what: str, table: pd.DataFrame, place: str) -> None:
    """Raise ``ValueError`` unless a table has a place in each row, and a column of sigmas for each quantity."""
    if table.empty:
        return
    sigmas = [f"{name}_sd" for name in QUANTITIES if name in table or f"{name}_error" in table]
    refuse_other_than_numbers(what, table, ("case", "estimator", place, *sigmas), _TEXT)
    refuse_empty(what, table, place)


def rows_of(scores: pd.DataFrame) -> tuple[Row, ...]:
    """Return the table of scores with :data:`SCORE_COLUMNS`: cases and quantities in order, the best estimator
    first.
    """
    rows = []
    for case, of_case in scores.groupby("case", sort=False):
        for quantity, meaning in QUANTITIES.items():
            of_quantity = of_case[(of_case["quantity"] == quantity) & (of_case["places"] > 0)]
            for _, of_band in of_quantity.groupby("from_kmh", dropna=False):
                rows += _ranked(str(case), quantity, meaning, of_band)
    return tuple(rows)


def _ranked(case: str, quantity: str, meaning: Quantity, scores: pd.DataFrame) -> list[Row]:
    repeated = scores["rms"].isna().all()  # two runs compared have a standard deviation and nothing else
    statistic = "sd" if repeated else meaning.statistic
    by_estimator = {name: runs.set_index("seed") for name, runs in scores.groupby("estimator", sort=False)}
    rows = []
    for name, runs in by_estimator.items():
        error = runs[statistic]
        ratio, interval = None, None
        if name != REFERENCE and REFERENCE in by_estimator:
            ratio, interval = _ratio(error, by_estimator[REFERENCE][statistic])
        rows.append(
            Row(
                case=case,
                task=meaning.task,
                quantity=quantity,
                statistic=statistic,
                from_kmh=_known(scores["from_kmh"].iloc[0]),
                estimator=str(name),
                runs=len(runs),
                error=float(error.mean()),
                error_margin=_known(margin(error.to_numpy())),
                largest=_known(runs["max"].max()),
                coverage=_known(runs["coverage"].mean()),
                to_smoother=ratio,
                to_smoother_interval=interval,
                seconds_per_km=_known((runs["seconds"] / runs["distance_km"]).mean()),
            )
        )
    return sorted(rows, key=lambda row: row.error)


def _ratio(error: pd.Series[float], reference: pd.Series[float]) -> tuple[float | None, tuple[float, float] | None]:
    """Return geometric mean over the runs that both have, and its 95 % interval."""
    both = pd.concat([error, reference], axis=1, join="inner").to_numpy(dtype=np.float64)
    both = both[(both > 0.0).all(axis=1)]
    if len(both) == 0:
        return None, None
    logs = np.log(both[:, 0] / both[:, 1])
    middle, half = float(logs.mean()), margin(logs)
    interval = None if np.isnan(half) else (float(np.exp(middle - half)), float(np.exp(middle + half)))
    return float(np.exp(middle)), interval


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
