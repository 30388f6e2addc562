"""The catalogue of a batch is a table of runs, or folders of recordings named one by one or by a pattern.

A table (CSV or Parquet) has the column ``recording`` and, as needed, ``line``, ``map``, ``known_line``, ``settings``,
``tags`` and ``run``. Its paths are relative to the table, those of a pattern to the working directory.
"""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from trackfg.errors import BadInputError, did_you_mean, first_line, printable
from trackfg.files.csv_texts import read_csv_texts
from trackfg.files.parquet import read_parquet
from trackfg.files.small_file import read_small
from trackfg.fleet.places import is_recording, is_url
from trackfg.fleet.store_head import is_store
from trackfg.io.description_reader import FILE_NAME
from trackfg.results.result import RESULT_FOLDER

COLUMNS = ("recording", "line", "map", "known_line", "settings", "tags", "run")
"""Columns of a table; all but the first may be absent or empty."""

_PLACES = ("recording", "map", "known_line", "settings")
"""Columns that hold paths or URLs."""

UNKNOWN_LINE = "unknown"
"""The line of a run whose catalogue names none."""

TABLE_SUFFIXES = (".csv", ".parquet")

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}")
"""The name of a run is the name of a folder on every system."""
_MOST_BYTES = 2**26
"""Size of a table of runs, bytes: 100,000 runs have 30 MB."""
_LONGEST_PLACE = 2**15
"""Length of a path or URL, characters: the longest path of Windows, 32,767, has fewer, that of Linux 4,095 bytes."""
_HASH_DIGITS = 8
"""Hexadecimal digits after a run's name: among 10,000 recordings of one name, two agree with a probability of 1 %."""


@dataclass(frozen=True)
class Run:
    """A recording that is to be smoothed. ``name`` is that of its folder in the store.

    ``map`` is the place of a map, ``known_line`` the path of a file of tracks, ``settings`` that of a TOML file; None
    for none, and for the defaults.
    """

    name: str
    recording: str
    line: str = UNKNOWN_LINE
    map: str | None = None
    known_line: str | None = None
    settings: str | None = None
    tags: str = ""


def read_catalogue(places: Sequence[str], defaults: Mapping[str, str] | None = None) -> list[Run]:
    """Return the runs of tables, of recordings and of patterns; ``defaults`` by column hold where a run says nothing.

    Raises :class:`BadInputError` for a table that is none, with its row, for a pattern that nothing fits, and where two
    runs are of one recording or have one name.
    """
    given = {
        column: _place(text, os.curdir) if column in _PLACES else text for column, text in (defaults or {}).items()
    }
    runs = [run for place in places for run in _runs(place, given)]
    for what, values in (
        ("recording", [_folder(run.recording) for run in runs]),
        ("run", [run.name for run in runs]),
    ):
        if len(set(values)) < len(values):
            twice = next(value for value in values if values.count(value) > 1)
            raise BadInputError(
                f"{what} {printable(twice)!r} is there {values.count(twice)} times: expected one row for each. "
                "Hint: results with other settings or another map go into another store"
            )
    return runs


def _runs(place: str, defaults: Mapping[str, str]) -> Iterable[Run]:
    if place.lower().endswith(TABLE_SUFFIXES) and not is_url(place):
        return _of_table(Path(place), defaults)
    rows = [{**defaults, "recording": path} for path in _matches(place)]
    return [_run(row, os.curdir) for row in rows]


def _matches(pattern: str) -> list[str]:
    """Return the recordings that a pattern matches, sorted, without hidden ones; or the one place that it names.

    What the description or archive of a named place holds is not looked at: its run fails if that is no recording. A
    named folder with recordings in it is refused: no run was meant by it.
    """
    if is_url(pattern):
        return [pattern]
    if os.path.exists(pattern):
        if _holds_recordings(pattern):
            raise BadInputError(
                f"{printable(pattern)}: is no recording, but holds some; expected a recording, a table or a pattern. "
                f"Hint: {printable(os.path.join(pattern, '*'))!r}, in quotes, means those in it"
            )
        fitting = [pattern]
    else:
        matched = {path for path in glob.glob(pattern, recursive=True) if is_recording(path) and not _is_other(path)}
        fitting = sorted(path for path in matched if not _is_part(path, matched))
    recordings = [path for path in fitting if os.path.isdir(path) or path.endswith((".toml", ".zip"))]
    if not recordings:
        raise BadInputError(
            f"{printable(pattern)}: no recording is there; expected a table (.csv, .parquet), a recording, or a pattern"
        )
    return recordings


def _is_part(path: str, matched: set[str]) -> bool:
    """Return whether a path that a pattern matched is the description in a folder that it matched too."""
    folder = _folder(path)
    return folder != path and bool({folder, f"{folder}/"} & matched)


def _folder(recording: str) -> str:
    """Return the folder of a recording that is named by the description in it."""
    return recording.removesuffix(f"/{FILE_NAME}")


def _is_other(path: str) -> bool:
    """Return whether a path is a folder that lies beside recordings and is none: a result, a store, more recordings.

    Any other folder counts as a recording: its run says what is missing in it.
    """
    return RESULT_FOLDER.holds(Path(path)) or is_store(path) or _holds_recordings(path)


def _holds_recordings(path: str) -> bool:
    """Return whether a path is a folder of recordings and is none itself."""
    if os.path.exists(os.path.join(path, FILE_NAME)):
        return False
    return next(glob.iglob(os.path.join(glob.escape(path), "*", FILE_NAME)), None) is not None


def _of_table(path: Path, defaults: Mapping[str, str]) -> list[Run]:
    if not path.exists():
        raise BadInputError(f"{path}: no such file; expected a table of runs, a recording, or a pattern")
    try:
        if path.suffix.lower() == ".csv":
            table = read_csv_texts(path, _MOST_BYTES)
        else:
            columns = read_parquet(pa.BufferReader(read_small(path, _MOST_BYTES)))
            texts = {name: columns[name].cast(pa.string()).fill_null("") for name in columns.column_names}
            table = pa.table(texts).to_pandas()
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: not a readable table of runs: {first_line(error)}") from error
    for column in table.columns:
        if column not in COLUMNS:
            hint = did_you_mean(column, COLUMNS)
            raise BadInputError(
                f"{path}: column {printable(str(column))!r}: expected {', '.join(COLUMNS)}"
                + (f". Hint: {hint}" if hint else "")
            )
    if "recording" not in table:
        raise BadInputError(f"{path}: no column 'recording'; expected the place of a recording in every row")
    runs = []
    for number, row in enumerate(table.to_dict("records"), start=1):
        given = {str(name): text.strip() for name, text in row.items() if text.strip()}
        try:
            runs.append(_run({**defaults, **given}, str(path.parent)))
        except ValueError as error:
            raise BadInputError(f"{path}: row {number}: {error}") from error
    return runs


def _place(text: str, folder: str) -> str:
    text = text.removeprefix("file://")
    return text if is_url(text) else os.path.abspath(os.path.join(folder, text))


def _run(row: Mapping[str, str], folder: str) -> Run:
    """Make a run from a row, its paths relative to ``folder``. Raises ``ValueError`` for what is no run."""
    for column in _PLACES:
        if (length := len(row.get(column, ""))) > _LONGEST_PLACE:
            raise ValueError(f"{column} has {length:,} characters; expected a path or a URL")
    places = {column: _place(row[column], folder) for column in _PLACES if column in row}
    if "recording" not in places:
        raise ValueError("no recording; expected a path or a URL")
    if is_url(places.get("known_line", "")):
        raise ValueError(f"known_line {places['known_line']!r}: expected a path")
    recording = places["recording"]
    name = row.get("run") or _name_of(recording)
    if not _NAME.fullmatch(name):
        raise ValueError(f"run {name!r}: expected letters, digits, points, - and _")
    return Run(
        name=name,
        recording=recording,
        line=row.get("line", UNKNOWN_LINE),
        map=places.get("map"),
        known_line=places.get("known_line"),
        settings=places.get("settings"),
        tags=row.get("tags", ""),
    )


def _name_of(recording: str) -> str:
    """Return the last part of a recording's place, and a hash of the whole: runs of one name stay apart."""
    parts = re.split(r"[/\\]|::", recording.rstrip("/"))
    if parts[-1] == "recording.toml" and len(parts) > 1:
        parts.pop()
    last = re.sub(r"\.(toml|zip)$", "", parts[-1])
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", last).strip(".-")[:150] or "run"
    return f"{name}-{hashlib.sha256(recording.encode('utf-8', 'surrogateescape')).hexdigest()[:_HASH_DIGITS]}"
