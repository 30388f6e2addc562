"""Trends of a track as tables, in memory and in a folder: rates, steps, and when limits are reached.

=====================================  ===========================================================================
file                                   a row per
=====================================  ===========================================================================
trends.csv, steps.csv, reached.csv     trend; step; trend and limit
cells.parquet, sections.parquet        cell of 0.25 m; section of 200 m
values.parquet, section_values.parquet run and cell; run and section
trends.json                            the first three again, what rates are per, and what was left out
=====================================  ===========================================================================
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.files.parquet import read_frame, write_parquet
from trackfg.files.small_file import json_of
from trackfg.numerics.key_figures import Outlined
from trackfg.results.soundness import refuse_empty, refuse_other_than_numbers

FORMAT = "trackfg-trends/1"
_HEAD = "trends.json"
_FOR_PEOPLE = ("trends", "steps", "reached")
_PER = ("month", "mt")
_LARGE = ("cells", "sections", "values", "section_values")

TRENDS_FOLDER = FolderKind(
    "folder of trends",
    _HEAD,
    "trackfg-trends/",
    (_HEAD, *(f"{name}.csv" for name in _FOR_PEOPLE), *(f"{name}.parquet" for name in _LARGE)),
)

TEXTS = ("quantity", "last_step", "date", "limit", "reached_on", "earliest", "latest")
"""Columns that are texts; all others are numbers."""
PLACE = ("from_m", "to_m", "at_m", "quantity")
"""Columns that say where a trend, a step or a limit reached is, and of what."""


def columns_of(per: str) -> dict[str, tuple[str, ...]]:
    """Return the columns of the tables of trends, steps and limits reached, with rates per month or million tonnes."""
    rate = f"rate_mm_per_{per}"
    return {
        "trends": (*PLACE, rate, f"{rate}_sd", "value_mm", "value_mm_sd", "runs", "last_step"),
        "steps": (*PLACE, "date", "step_mm", "step_mm_sd", "runs_after"),
        "reached": (*PLACE, "limit", "limit_mm", "value_mm", rate, "reached_on", "earliest", "latest"),
    }


@dataclass(frozen=True, repr=False)
class Trends(Outlined):
    """The tables of the module's docstring; docs/trends.md has their columns.

    ``per``: what rates are per, ``month`` or ``mt``, a million tonnes. ``cells`` and ``sections`` have every quantity's
    rate and its value at the last date, with sigmas, of sections those of the standard deviation; ``values`` and
    ``section_values`` what every run says. ``left_out``: runs that are not recognised on the map, and limits that
    nothing is held against, with the reason. ``doubts``: runs that count, but seem to be of another track, likewise.
    """

    trends: pd.DataFrame
    steps: pd.DataFrame
    reached: pd.DataFrame
    cells: pd.DataFrame
    sections: pd.DataFrame
    values: pd.DataFrame
    section_values: pd.DataFrame
    per: str = "month"
    left_out: dict[str, str] = field(default_factory=dict)
    doubts: dict[str, str] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        """Return the unit of rates, in words."""
        return f"mm per {'million tonnes' if self.per == 'mt' else self.per}"

    def left_out_by_reason(self) -> Iterator[tuple[list[str], str]]:
        """Yield the names of what was left out for one reason, and that."""
        for reason in dict.fromkeys(self.left_out.values()):
            yield [name for name, why in self.left_out.items() if why == reason], reason

    def as_json(self) -> str:
        """Return trends, steps, dates of limits, and what was left out, as JSON."""
        tables = {
            name: json.loads(getattr(self, name).to_json(orient="records", double_precision=15)) for name in _FOR_PEOPLE
        }
        content = {"format": FORMAT, "per": self.per, **tables, "left_out": self.left_out, "doubts": self.doubts}
        return json.dumps(content, indent=2, allow_nan=False)

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write it, replacing earlier trends in one step. Raises :class:`BadInputError` where something else is."""
        folder = Path(folder)
        TRENDS_FOLDER.refuse_foreign(folder)
        with replaced_folder(folder) as new:
            for name in _FOR_PEOPLE:
                getattr(self, name).to_csv(new / f"{name}.csv", index=False)
            for name in _LARGE:
                write_parquet(getattr(self, name), new / f"{name}.parquet")
            (new / _HEAD).write_text(self.as_json() + "\n", encoding="utf-8")
        return folder

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Trends:
        """Read trends, of ``values`` the rows at places of trends alone: all of a long line take gigabytes.

        Raises :class:`BadInputError` if the folder holds none.
        """
        content = TRENDS_FOLDER.read(Path(folder))
        try:
            head = json_of(content[_HEAD])
            small = {name: _table_of(content[f"{name}.csv"]) for name in _FOR_PEOPLE}
            places = small["trends"]["at_m"].to_numpy(dtype=np.float64)
            large = {name: read_frame(content[f"{name}.parquet"]) for name in _LARGE if name != "values"}
            values = _rows_at(content["values.parquet"], places)
            trends = cls(
                **small,
                **large,
                values=values,
                per=head.get("per", "month"),
                left_out=head["left_out"],
                doubts=head.get("doubts", {}),
            )
            trends.refuse_unsound()
        except (ValueError, TypeError, KeyError, OSError) as error:
            raise BadInputError(f"{folder}: not a readable trackfg folder of trends: {error}") from error
        return trends

    def refuse_unsound(self) -> None:
        """Raise ``ValueError`` for a table without its columns, places or dates, and for numbers that are none."""
        if self.per not in _PER:
            raise ValueError(f"{_HEAD}: per is {self.per!r:.40}: expected one of {', '.join(_PER)}")
        for key, reasons in (("left_out", self.left_out), ("doubts", self.doubts)):
            if not (isinstance(reasons, dict) and all(isinstance(why, str) for why in reasons.values())):
                raise ValueError(f"{_HEAD}: {key}: expected a reason for each name")
        for name, columns in columns_of(self.per).items():
            refuse_other_than_numbers(f"{name}.csv", getattr(self, name), columns, TEXTS)
        for name in ("cells", "sections"):
            table = getattr(self, name)
            ends = ("", "_sd", f"_per_{self.per}", f"_per_{self.per}_sd")
            quantities = [str(column).removesuffix("_runs") for column in table if str(column).endswith("_runs")]
            columns = ("chainage_m", *(f"{quantity}{end}" for quantity in quantities for end in ends))
            refuse_other_than_numbers(f"{name}.parquet", table, columns, ())
            refuse_empty(f"{name}.parquet", table, "chainage_m")
        if self.cells.empty:
            raise ValueError("cells.parquet: has no row; expected one for each cell")
        for name in ("values", "section_values"):
            table = getattr(self, name)
            quantities = [f"{quantity}{end}" for quantity in set(self.trends["quantity"]) for end in ("", "_sd")]
            refuse_other_than_numbers(
                f"{name}.parquet", table, ("run", "date", "chainage_m", *quantities), ("run", "date")
            )
            if table["date"].dtype.kind != "M" or table["date"].isna().any():
                raise ValueError(f"{name}.parquet: column 'date': expected a date in each row")


def _table_of(content: bytes) -> pd.DataFrame:
    table = pd.read_csv(io.BytesIO(content), dtype="str", keep_default_na=False)
    numbers = {str(name): pd.to_numeric(table[name]) for name in table if name not in TEXTS}
    return table.assign(**numbers)


def _rows_at(content: bytes, places: np.ndarray) -> pd.DataFrame:
    """Return the rows of a table at chainages, read in parts, on this thread alone (:mod:`trackfg.files.parquet`)."""
    table = pq.ParquetFile(io.BytesIO(content))
    wanted = pa.array(places)
    parts = [part.filter(pc.is_in(part["chainage_m"], wanted)) for part in table.iter_batches(use_threads=False)]
    rows: pd.DataFrame = pa.Table.from_batches(parts, table.schema_arrow).to_pandas()
    return rows
