"""A result is what ``trackfg smooth`` gives back, in memory and as a folder.

==================  ==========================================================================================
file                content
==================  ==========================================================================================
trajectory.parquet  one row per instant of a uniform clock, columns :data:`TRAJECTORY_COLUMNS`
geometry.parquet    one row per 0.25 m of chainage, columns :data:`GEOMETRY_COLUMNS`, with lasers :data:`RAIL_COLUMNS`
                    too, of another system perhaps some of :data:`BAND_COLUMNS`; the file's metadata (key ``trackfg``)
                    hold :class:`GeometryConventions`
covariance.parquet  joint covariance of the errors of chainage and cross-level (:mod:`trackfg.output.place_covariance`)
events.csv          one row per event, columns :data:`EVENT_COLUMNS`
summary.json        :class:`Summary`
balises.csv         of a run that passed balises with ids: where each is planned and measured, columns
                    :data:`BALISE_COLUMNS`
passages.parquet    of such a run: how far apart it measured its fixes, with the joint covariance
                    (:mod:`trackfg.results.balise_passages`)
==================  ==========================================================================================

Columns carry their unit as suffix; the 1-sigma of column ``x`` is column ``x_sd``, in the same unit.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from pydantic import ValidationError

from trackfg.errors import BadInputError, TrackfgError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.files.parquet import read_frame, write_parquet
from trackfg.numerics.key_figures import KeyFigures
from trackfg.results.balise_passages import BalisePassages
from trackfg.results.columns import (
    BALISE_COLUMNS,
    BAND_COLUMNS,
    EVENT_COLUMNS,
    GEOMETRY_COLUMNS,
    RAIL_COLUMNS,
    TRAJECTORY_COLUMNS,
)
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.soundness import refuse_unsound
from trackfg.results.summary import Summary

_REPORT = "this is an error of trackfg: please report it, with the recording if you can"
_EVENT_TEXT = ("kind", "detail")
_BALISE_TEXT = ("id", "verdict")
_EVENT_TYPES = {name: "str" if name in _EVENT_TEXT else "float64" for name in EVENT_COLUMNS}
_BALISE_TYPES = {name: "str" if name in _BALISE_TEXT else "float64" for name in BALISE_COLUMNS}
_TRAJECTORY, _GEOMETRY, _COVARIANCE, _EVENTS, _SUMMARY = FILES = (
    "trajectory.parquet",
    "geometry.parquet",
    "covariance.parquet",
    "events.csv",
    "summary.json",
)


_BALISES, _PASSAGES = OPTIONAL_FILES = ("balises.csv", "passages.parquet")
GEOMETRY_FILES = (_GEOMETRY, _SUMMARY)
"""Files that :func:`read_geometry` reads."""
_FAULTS = (ValueError, TypeError, KeyError, ArithmeticError, OSError)
"""What reading a damaged file raises."""
RESULT_FOLDER = FolderKind("result", _SUMMARY, "trackfg-result/", FILES, OPTIONAL_FILES)


@cache
def _no_balises() -> pd.DataFrame:
    """Return the table without rows that results have copies of: to make one takes longer than to fill it."""
    return pd.DataFrame({name: pd.Series(dtype=kind) for name, kind in _BALISE_TYPES.items()})


@dataclass(frozen=True, repr=False)
class Result(KeyFigures):
    """The smoothed run, or a geometry that another system measured, which has no trajectory and no solver.

    Raises
    ------
    ValueError
        If a table has other columns than the contract's.

    Examples
    --------
    >>> import trackfg
    >>> result = trackfg.Result.read("out1")
    >>> result.geometry.columns[:2].tolist(), len(result.geometry) > 1000
    (['chainage_m', 'chainage_m_sd'], True)
    >>> result.write("again").name
    'again'
    """

    trajectory: pd.DataFrame
    """A row per instant of a uniform clock; docs/results.md has its columns, s, m, m/s, rad."""
    geometry: pd.DataFrame
    """A row per 0.25 m of chainage, or whatever ``geometry.step_m`` of the settings is."""
    events: pd.DataFrame
    """Standstills, slips and slides, gaps, fixes."""
    summary: Summary
    """What the solver did, what the sigmas are worth, calibration."""
    covariance: PlaceCovariance = field(default_factory=PlaceCovariance.none)
    """Joint covariance of chainage and cross-level errors along the run."""
    balises: pd.DataFrame = field(default_factory=lambda: _no_balises().copy())
    """A row per balise that was passed."""
    passages: BalisePassages = field(default_factory=BalisePassages.none)
    """What a survey by several runs needs of the passages."""

    def __post_init__(self) -> None:
        _refuse_other_columns(self.trajectory, TRAJECTORY_COLUMNS)
        _refuse_other_columns(self.geometry, _geometry_columns(self.geometry))
        _refuse_other_columns(self.events, EVENT_COLUMNS)
        _refuse_other_columns(self.balises, BALISE_COLUMNS)

    def key_figures(self) -> dict[str, str]:
        """Return the length, whether it is to be trusted, and how much there is of each table."""
        page = self.summary
        doubted = [verdict.quantity for verdict in page.verdicts if verdict.status != "trusted"]
        trust = "all trusted" if not doubted else f"sigmas widened or not trusted: {', '.join(doubted)}"
        distance = "distance not determined" if page.distance_m is None else f"{page.distance_m:.1f} m"
        return {
            "result": page.recording_id,
            "length": f"{page.duration_s:.1f} s, {distance}",
            "solver": "converged" if page.converged else "not converged",
            **({"verdict": trust} if page.verdicts else {}),
            "trajectory": f"trajectory {len(self.trajectory)} rows",
            "geometry": f"geometry {len(self.geometry)} rows",
            "events": f"events {len(self.events)} rows",
        }

    def geometry_for(self, purpose: str) -> pd.DataFrame:
        """Return the geometry. Raises :class:`BadInputError` that names the ``purpose`` where there is none."""
        if len(self.geometry) < 2:
            raise BadInputError(
                f"{self.summary.recording_id}: the result has no track geometry; expected it for {purpose}. Hint: it "
                "comes from a sensor that follows the track (rigid = true in [imu]) or displacement sensors, in motion"
            )
        return self.geometry

    @property
    def has_rails(self) -> bool:
        """Return whether the geometry has each rail by itself and the gauge."""
        return _has_rails(self.geometry)

    def refuse_unsound(self) -> None:
        """Raise ``ValueError`` for a table with unsound numbers (:mod:`trackfg.results.soundness`), for a smoothed run
        without a trajectory, and for a joint covariance that is none.
        """
        if self.trajectory.empty and self.summary.solver is not None:
            raise ValueError(f"{_TRAJECTORY}: has no rows: expected those of a run that was smoothed")
        refuse_unsound(_TRAJECTORY, self.trajectory, ascending="t_s", complete=True)
        _refuse_unsound_geometry(self.geometry, self.summary)
        refuse_unsound(_EVENTS, self.events.drop(columns=list(_EVENT_TEXT)), ascending=None, complete=False)
        self.covariance.refuse_unsound()
        self.passages.refuse_unsound()
        numbers = self.balises.drop(columns=list(_BALISE_TEXT))
        refuse_unsound(_BALISES, numbers, ascending=None, complete=False, sigmas=False)

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write the result, replacing an earlier one in one step (:mod:`trackfg.files.atomic_folder` says how).

        Killed at any moment, it leaves the old result, whole, or none where there was none. Raises
        :class:`BadInputError` if ``folder`` holds anything but a result, and :class:`TrackfgError` for unsound numbers
        (:meth:`refuse_unsound`).
        """
        folder = Path(folder)
        RESULT_FOLDER.refuse_foreign(folder)
        try:
            self.refuse_unsound()
        except ValueError as error:
            raise TrackfgError(
                f"{folder}: nothing is written, for it would be wrong: {error}. Hint: {_REPORT}"
            ) from error
        with replaced_folder(folder) as new:
            write_parquet(self.trajectory, new / _TRAJECTORY)
            write_parquet(self._geometry_file(), new / _GEOMETRY)
            write_parquet(self.covariance.to_frame(), new / _COVARIANCE)
            self.events.to_csv(new / _EVENTS, index=False)
            if len(self.passages):
                self.balises.to_csv(new / _BALISES, index=False)
                write_parquet(self.passages.to_frame(), new / _PASSAGES)
            (new / _SUMMARY).write_text(self.summary.model_dump_json(indent=2) + "\n", encoding="utf-8")
        return folder

    def _geometry_file(self) -> pa.Table:
        table = pa.Table.from_pandas(self.geometry, preserve_index=False)
        conventions = self.summary.geometry.model_dump_json()
        return table.replace_schema_metadata({**(table.schema.metadata or {}), "trackfg": conventions})

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Result:
        """Read a result, also while another process replaces it. Raises :class:`BadInputError` if it is not one."""
        folder = Path(folder)
        content = RESULT_FOLDER.read(folder)
        try:
            result = cls(
                trajectory=read_frame(content[_TRAJECTORY]),
                geometry=read_frame(content[_GEOMETRY]),
                events=_csv(content[_EVENTS], _EVENT_TYPES),
                summary=_read_summary(content[_SUMMARY]),
                covariance=PlaceCovariance.from_frame(read_frame(content[_COVARIANCE])),
                **_of_balises(content),
            )
            result.refuse_unsound()
        except _FAULTS as error:
            raise BadInputError(f"{folder}: not a readable trackfg result: {error}") from error
        return result


def _read_summary(content: bytes) -> Summary:
    """Return the summary of a file. Raises ``ValueError`` with the first fault, in a line."""
    try:
        return Summary.model_validate_json(content)
    except ValidationError as error:
        faults = error.errors(include_url=False)
        fault = next((other for other in faults if other["loc"] == ("format",)), faults[0])
        if fault["loc"] == ("format",):
            expected = Summary.model_fields["format"].default
            hint = "Hint: use the newest trackfg, or smooth the recording again"
            raise ValueError(f"{_SUMMARY} has the format {fault['input']!r}; expected {expected!r}. {hint}") from error
        place = ".".join(str(part) for part in fault["loc"])
        raise ValueError(f"{_SUMMARY}{', ' if place else ''}{place}: {fault['msg']}") from error


def read_geometry(folder: Path) -> tuple[pd.DataFrame, Summary]:
    """Return geometry and summary of a result, without what else is in it. Raises :class:`BadInputError`."""
    content = RESULT_FOLDER.read(folder, GEOMETRY_FILES)
    try:
        geometry = read_frame(content[_GEOMETRY])
        summary = _read_summary(content[_SUMMARY])
        _refuse_other_columns(geometry, _geometry_columns(geometry))
        _refuse_unsound_geometry(geometry, summary)
    except _FAULTS as error:
        raise BadInputError(f"{folder}: not a readable trackfg result: {error}") from error
    return geometry, summary


def _has_rails(geometry: pd.DataFrame) -> bool:
    return RAIL_COLUMNS[0] in geometry


def _geometry_columns(geometry: pd.DataFrame) -> tuple[str, ...]:
    """Return the columns that a geometry is to have, with rails and bands if it has some of these."""
    bands = tuple(name for name in geometry if name in BAND_COLUMNS)
    return GEOMETRY_COLUMNS + (RAIL_COLUMNS if _has_rails(geometry) else ()) + bands


def _refuse_other_columns(table: pd.DataFrame, columns: tuple[str, ...]) -> None:
    if tuple(table.columns) != columns:
        raise ValueError(f"columns {list(table.columns)}: expected {list(columns)}")


def _refuse_unsound_geometry(geometry: pd.DataFrame, summary: Summary) -> None:
    smoothed = summary.solver is not None
    refuse_unsound(_GEOMETRY, geometry, ascending="chainage_m", complete=False, sigmas=smoothed)


def _of_balises(content: Mapping[str, bytes]) -> dict[str, Any]:
    """Return what a run that passed balises with ids has besides."""
    if not content.keys() >= set(OPTIONAL_FILES):
        return {}
    passages = BalisePassages.from_frame(read_frame(content[_PASSAGES]))
    return {"balises": _csv(content[_BALISES], _BALISE_TYPES), "passages": passages}


def _csv(content: bytes, types: dict[str, str]) -> pd.DataFrame:
    """Return a table of texts and of numbers, NaN where these have an empty cell."""
    empty = {name: [""] for name, kind in types.items() if kind != "str"}
    return pd.read_csv(io.BytesIO(content), dtype=types, keep_default_na=False, na_values=empty)


def expect_result(given: object, function: str) -> None:
    """Raise ``TypeError`` where a ``function`` is called with something else than a result, such as its folder."""
    if not isinstance(given, Result):
        kind = type(given).__name__
        raise TypeError(f"{function} takes a result, as trackfg.Result.read(folder) gives, not {kind}")
