"""A store holds the results of many runs, and a catalogue of them.

==================  ==========================================================================================
place               content
==================  ==========================================================================================
store.json          says that it is a store
results/RUN         the result of a run, a folder
catalogue           Parquet, ``line=7/month=2026-05/runs.parquet``: a row per run (:mod:`trackfg.fleet.key_figures`)
progress            the progress of running batches (:mod:`trackfg.fleet.batch_progress`)
.known.sqlite       what is known of files that need not be read again (:mod:`trackfg.fleet.known_content`)
==================  ==========================================================================================

A result is there whole or not at all, and so is each file of the catalogue. Several processes may write: one at a time
writes to the catalogue. A store may be at a URL (:mod:`trackfg.fleet.places`).
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.compute as pc

from trackfg.errors import BadInputError, first_line
from trackfg.files.owned_folder import refuse_unwritable, sole_writer
from trackfg.files.parquet import read_parquet, write_parquet
from trackfg.fleet.key_figures import NEVER_EMPTY, PARTITIONS, RESULTS, SCHEMA
from trackfg.fleet.places import exists, is_url, joined, matching, read, remove, write
from trackfg.fleet.store_head import FORMAT, HEAD, is_head
from trackfg.results.result import RESULT_FOLDER

_RUNS = "runs.parquet"

Partition = tuple[str, str]
"""Line and month."""


class Store:
    """A place with results and their catalogue; made where there is none, unless it is only to be read."""

    def __init__(self, place: str | Path, *, create: bool = True) -> None:
        """Raise :class:`BadInputError` where something else is."""
        text = str(place).removeprefix("file://")
        self.place = text.rstrip("/") if is_url(text) else os.path.abspath(text)
        head = joined(self.place, HEAD)
        if not exists(head):
            if matching(self.place, "*") or os.path.isfile(self.place):
                raise BadInputError(f"{place}: exists and is not a trackfg store: choose another folder")
            if create:
                if not is_url(self.place):
                    refuse_unwritable(Path(self.place))
                write(head, json.dumps({"format": FORMAT}).encode() + b"\n")
        elif not is_head(head):
            raise BadInputError(f"{head}: expected the format {FORMAT!r}")
        self._places: dict[str, set[Partition]] = defaultdict(set)

    @property
    def known_content(self) -> Path:
        """The file of what is known of other files: in the store, or for one at a URL among the user's caches."""
        if not is_url(self.place):
            return Path(self.place) / ".known.sqlite"
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trackfg"
        caches.mkdir(parents=True, exist_ok=True)
        return caches / f"{hashlib.sha256(self.place.encode()).hexdigest()}.sqlite"

    @property
    def _catalogue(self) -> str:
        return joined(self.place, "catalogue")

    def result(self, run: str) -> str:
        """Return the folder of a run's result."""
        return joined(self.place, RESULTS, run)

    def names(self) -> set[str]:
        """Return the runs that have a result."""
        paths = matching(joined(self.place, RESULTS), f"*/{RESULT_FOLDER.head}")
        return {path.partition("/")[0] for path in paths}

    def read(self, columns: Sequence[str]) -> list[dict[str, Any]]:
        """Return columns of the catalogue, ``line`` and ``month`` with them, as a list of rows."""
        tables = [
            table.append_column("line", pa.array([line] * len(table), pa.string())).append_column(
                "month", pa.array([month] * len(table), pa.string())
            )
            for (line, month), path in self._files()
            for table in [_table(path).select(list(columns))]
        ]
        rows = pa.concat_tables(tables).to_pylist() if tables else []
        for row in rows:
            self._places[row["run"]].add((row["line"], row["month"]))
        return rows

    def write(self, rows: Iterable[dict[str, Any]]) -> None:
        """Put rows into the catalogue, each in place of those of the same run that were read before."""
        added: dict[Partition, list[dict[str, Any]]] = defaultdict(list)
        removals: dict[Partition, set[str]] = defaultdict(set)
        for row in rows:
            place = row["line"], row["month"]
            added[place].append(row)
            for other in self._places[row["run"]] | {place}:
                removals[other].add(row["run"])
            self._places[row["run"]] = {place}
        if not removals:
            return
        with self._sole_writer():
            for place, runs in removals.items():
                _replace_rows(self._file(place), runs, added.get(place, []))

    def _sole_writer(self) -> AbstractContextManager[None]:
        """Keep other processes from writing; at a URL nothing can. What two lost to each other, the next plan lists."""
        if is_url(self.place):
            return nullcontext()
        folder = Path(self._catalogue)
        folder.mkdir(exist_ok=True)
        return sole_writer(folder, wait=True)

    def _files(self) -> list[tuple[Partition, str]]:
        places = []
        for path in matching(self._catalogue, f"line=*/month=*/{_RUNS}"):
            line, month = (unquote(part.partition("=")[2]) for part in path.split("/")[:2])
            places.append(((line, month), joined(self._catalogue, path)))
        return places

    def _file(self, place: Partition) -> str:
        folders = (f"{name}={quote(value, safe='')}" for name, value in zip(PARTITIONS, place, strict=True))
        return joined(self._catalogue, *folders, _RUNS)


def _table(path: str) -> pa.Table:
    """Return a file of the catalogue. Raises :class:`BadInputError` where it is none."""
    try:
        return _of_schema(read_parquet(pa.BufferReader(read(path))))
    except (OSError, ValueError, TypeError, KeyError, pa.ArrowException) as error:
        raise BadInputError(f"{path}: not a readable catalogue of runs: {first_line(error)}") from error


def _of_schema(table: pa.Table) -> pa.Table:
    """Return a table of runs with the columns of this version; those that it lacks are empty.

    Raises ``ValueError`` and Arrow's own for other types, and where a row does not say which run it is of.
    """
    columns = [
        table[field.name].cast(field.type) if field.name in table.column_names else pa.nulls(len(table), field.type)
        for field in SCHEMA
    ]
    empty = [name for name, column in zip(SCHEMA.names, columns, strict=True) if column.null_count]
    if missing := sorted(set(NEVER_EMPTY).intersection(empty)):
        raise ValueError(f"column {missing[0]!r} is empty in some rows; expected a text in each")
    return pa.Table.from_arrays(columns, schema=SCHEMA)


def _replace_rows(path: str, removals: set[str], added: list[dict[str, Any]]) -> None:
    table = pa.Table.from_pylist(added, SCHEMA)
    if exists(path):
        old = _table(path)
        table = pa.concat_tables([old.filter(pc.invert(pc.is_in(old["run"], pa.array(sorted(removals))))), table])
    if len(table) == 0:
        remove(path)
        return
    sink = pa.BufferOutputStream()
    write_parquet(table.sort_by("run"), sink)
    write(path, sink.getvalue().to_pybytes())
