"""A store holds the results of many runs, and a catalogue of them.

==================  ==========================================================================================
place               content
==================  ==========================================================================================
store.json          says that it is a store
results/RUN         the result of a run, a folder
catalogue           Parquet, ``line=7/month=2026-05/runs.parquet``: a row per run (:mod:`trackfg.fleet.key_figures`)
.known.sqlite       what is known of files that need not be read again (:mod:`trackfg.fleet.known_content`)
==================  ==========================================================================================

A result is replaced in one step, and so is each file of the catalogue. Several processes may write: one at a time
writes to the catalogue.
"""

from __future__ import annotations

import json
import shutil
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trackfg.errors import BadInputError
from trackfg.files.atomic_file import write_whole
from trackfg.files.owned_folder import sole_writer
from trackfg.files.parquet import write_parquet
from trackfg.fleet.key_figures import PARTITIONS, SCHEMA

FORMAT = "trackfg-store/1"
_HEAD = "store.json"
_RUNS = "runs.parquet"

Partition = tuple[str, str]
"""Line and month."""


class Store:
    """A folder with results and their catalogue; made where there is none, unless it is only to be read."""

    def __init__(self, folder: Path, *, create: bool = True) -> None:
        """Raise :class:`BadInputError` where something else is."""
        self.folder = folder.absolute()
        head = self.folder / _HEAD
        if not head.exists():
            if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
                raise BadInputError(f"{folder}: exists and is not a trackfg store: choose another folder")
            if create:
                self.catalogue.mkdir(parents=True)
                self.results.mkdir()
                write_whole(head, json.dumps({"format": FORMAT}).encode() + b"\n")
        elif not self._is_store(head):
            raise BadInputError(f"{head}: expected the format {FORMAT!r}")
        self._places: dict[str, set[Partition]] = defaultdict(set)

    @property
    def results(self) -> Path:
        """The folder of the results."""
        return self.folder / "results"

    @property
    def catalogue(self) -> Path:
        """The folder of the catalogue."""
        return self.folder / "catalogue"

    @property
    def known_content(self) -> Path:
        """The file of what is known of other files."""
        return self.folder / ".known.sqlite"

    def result(self, run: str) -> Path:
        """Return the folder of a run's result."""
        return self.results / run

    def names(self) -> set[str]:
        """Return the runs that have a result."""
        return {path.name for path in self.results.glob("[!.]*")} if self.results.is_dir() else set()

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
        gone: dict[Partition, set[str]] = defaultdict(set)
        for row in rows:
            place = row["line"], row["month"]
            added[place].append(row)
            for other in self._places[row["run"]] | {place}:
                gone[other].add(row["run"])
            self._places[row["run"]] = {place}
        if not gone:
            return
        with sole_writer(self.catalogue, wait=True):
            for place, runs in gone.items():
                _replace_rows(self._file(place), runs, added.get(place, []))

    def _files(self) -> list[tuple[Partition, Path]]:
        places = []
        for path in sorted(self.catalogue.glob(f"line=*/month=*/{_RUNS}")):
            line, month = (unquote(part.partition("=")[2]) for part in path.parts[-3:-1])
            places.append(((line, month), path))
        return places

    def _file(self, place: Partition) -> Path:
        folders = (f"{name}={quote(value, safe='')}" for name, value in zip(PARTITIONS, place, strict=True))
        return self.catalogue.joinpath(*folders, _RUNS)

    @staticmethod
    def _is_store(head: Path) -> bool:
        try:
            content = json.loads(head.read_bytes())
        except (OSError, ValueError):
            return False
        return isinstance(content, dict) and content.get("format") == FORMAT


def _table(path: Path) -> pa.Table:
    """Return a file of the catalogue, with the columns of this version; those that it lacks are empty."""
    table = pq.read_table(path, partitioning=None)
    columns = [
        table[field.name].cast(field.type) if field.name in table.column_names else pa.nulls(len(table), field.type)
        for field in SCHEMA
    ]
    return pa.Table.from_arrays(columns, schema=SCHEMA)


def _replace_rows(path: Path, gone: set[str], added: list[dict[str, Any]]) -> None:
    table = pa.Table.from_pylist(added, SCHEMA)
    if path.exists():
        before = _table(path)
        table = pa.concat_tables([before.filter(pc.invert(pc.is_in(before["run"], pa.array(sorted(gone))))), table])
    if len(table) == 0:
        path.unlink(missing_ok=True)
        shutil.rmtree(path.parent, ignore_errors=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    sink = pa.BufferOutputStream()
    write_parquet(table.sort_by("run"), sink)
    write_whole(path, memoryview(sink.getvalue()))
