"""Each address of a store's pages is answered from the store, by pages of :mod:`trackfg.report.store`."""

from __future__ import annotations

import hashlib
import json
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qsl, urlsplit

import pandas as pd

from trackfg.cli.browse.sections import NO_DATE, StoredSections, geometry_of
from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.files.owned_folder import kind_of
from trackfg.fleet.batch_progress import BatchState, batch_states
from trackfg.fleet.key_figures import SCHEMA
from trackfg.fleet.places import local_files
from trackfg.fleet.store import Store
from trackfg.fleet.store_head import is_store
from trackfg.mapping.changes.overlay import SUMMARY_M
from trackfg.mapping.trends.series import QUANTITIES
from trackfg.report.numbers import duration
from trackfg.report.page import Code, Facts, Page, PageSection, Text
from trackfg.report.sources import page_of
from trackfg.report.store.addresses import LINE, PROGRESS, RUN, SECTION, STORE, line_address, section_address
from trackfg.report.store.line_page import line_page
from trackfg.report.store.run_list import doubted
from trackfg.report.store.section_page import RunOverSection, section_page
from trackfg.report.store.store_page import StoreContent, store_page
from trackfg.results.result import RESULT_FOLDER
from trackfg.streaming.view.local_server import LocalHandler

NEWEST_RUNS = 40
"""Runs that a section's page shows unless every one is asked for: a browser draws these in some seconds."""

_REST = 9.0
"""Pages ask each second what is new: reading the catalogue takes a tenth of a core at most, whatever its size."""

Query = Mapping[str, str]
Row = dict[str, Any]


@dataclass(frozen=True)
class Answer:
    """The answer to a browser's request."""

    content: bytes
    kind: str = "text/html"
    status: int = 200


class StorePages:
    """The pages of one store, read-only."""

    def __init__(self, place: str) -> None:
        """Raise :class:`BadInputError` where there is no store."""
        if not is_store(place):
            kind = kind_of(Path(place))
            what = f"is a {kind}; " if kind else ""
            raise BadInputError(f"{place}: {what}expected a store, as trackfg batch writes it")
        self.store = Store(place, create=False)
        self._sections = StoredSections(self.store)
        self._read: list[Row] = []
        self._digest = ""
        self._fresh_until = 0.0

    def answer(self, address: str) -> Answer:
        """Return the answer to an address, such as ``/line?line=7``; where it cannot be made, a page that says why."""
        try:
            parts = urlsplit(address)
            return self._made(parts.path, dict(parse_qsl(parts.query)))
        except _NoSuchPageError as error:
            return _sentence_page(str(error), 404)
        except (TrackfgError, OSError, ValueError, MemoryError) as error:
            return _sentence_page(first_line(error), 500)

    def _made(self, path: str, query: Query) -> Answer:
        if path == PROGRESS:
            return Answer(json.dumps(self._progress(query)).encode(), "application/json")
        make = {STORE: self._store, LINE: self._line, SECTION: self._section, RUN: self._run}.get(path)
        if make is None:
            raise _NoSuchPageError("There is no such page.")
        return Answer(make(query).html().encode())

    def _rows(self) -> list[Row]:
        """Return the rows of the catalogue, which is read again after :data:`_REST` times what reading it takes."""
        began = time.monotonic()
        if began >= self._fresh_until:
            self._read = self.store.read(SCHEMA.names)
            self._digest = hashlib.sha256(repr(self._read).encode()).hexdigest()
            self._fresh_until = time.monotonic() + _REST * (time.monotonic() - began)
        return self._read

    def _seen(self, unread: int) -> str:
        """Return a text that differs whenever the page of the store would: after any change of a row, too."""
        return f"{self._digest}-{unread}"

    def _store(self, query: Query) -> Page:
        rows = self._rows()
        unread = self._sections.read(rows)
        lines = {line: table for line, (_, table) in self._sections.lines(rows).items()}
        content = StoreContent(
            place=self.store.place,
            runs=_table(rows),
            lines=lines,
            quantities=QUANTITIES,
            unread=unread,
            progress=_progress_text(batch_states(self.store.place), unread),
            seen=self._seen(unread),
        )
        return store_page(content, query)

    def _progress(self, query: Query) -> dict[str, Any]:
        """Return how far running batches are, and whether there is more to show than a page has seen."""
        rows = self._rows()
        unread = self._sections.read(rows)
        text = _progress_text(batch_states(self.store.place), unread)
        return {"text": text, "reload": unread == 0 and query.get("seen") != self._seen(unread)}

    def _line(self, query: Query) -> Page:
        line, rows = self._line_rows(query)
        self._sections.read(rows)
        _, table = self._sections.lines(rows).get(line, (None, None))
        return line_page(line, _table(rows), table, QUANTITIES)

    def _section(self, query: Query) -> Page:
        line, rows = self._line_rows(query)
        try:
            from_m = float(query.get("from", ""))
        except ValueError:
            raise _NoSuchPageError("expected from=, the chainage where a section begins, in m") from None
        self._sections.read(rows)
        series, _ = self._sections.lines(rows).get(line, (None, None))
        ends = from_m, from_m + SUMMARY_M
        over = [row for row in rows if row["status"] == "done" and _overlaps(row, ends)]
        over.sort(key=lambda row: (row["start"] or NO_DATE, row["run"]))
        shown = over if query.get("runs") == "all" else over[-NEWEST_RUNS:]
        runs = [
            RunOverSection(row["run"], row["start"], self._between(row["run"], ends), doubt)
            for row, doubt in zip(shown, doubted(_table(shown)), strict=True)
        ]
        others = section_address(line, from_m, every_run=True) if len(shown) < len(over) else ""
        dated = series if series is not None and series.dates[-1] != NO_DATE else None
        return section_page(line, ends, [run for run in runs if len(run.geometry) > 1], dated, others)

    def _run(self, query: Query) -> Page:
        row = next((row for row in self._rows() if row["run"] == query.get("run")), None)
        if row is None:
            raise _NoSuchPageError(f"the store lists no run {query.get('run', '')!r}")
        above = (("all runs", STORE), (f"line {row['line']}", line_address(row["line"])))
        if row["status"] != "done":
            return _failed(row, above)
        place = self.store.result(row["run"])
        command = shlex.join(["trackfg", "report", place, "-o", f"{row['run']}.html"])
        with local_files(place, RESULT_FOLDER.files) as folder:
            return replace(page_of(folder, command), origin=above)

    def _line_rows(self, query: Query) -> tuple[str, list[Row]]:
        line = query.get("line", "")
        rows = [row for row in self._rows() if row["line"] == line]
        if not rows:
            raise _NoSuchPageError(f"the store lists no run of a line {line!r}")
        return line, rows

    def _between(self, run: str, ends: tuple[float, float]) -> pd.DataFrame:
        geometry, _ = geometry_of(self.store, run)
        return geometry[geometry["chainage_m"].between(*ends)].reset_index(drop=True)


def handler_of(pages: StorePages) -> type[LocalHandler]:
    """Return what answers requests for the pages."""
    return type("Handler", (_Handler,), {"pages": pages})


class _Handler(LocalHandler):
    pages: ClassVar[StorePages]

    def answer(self) -> None:
        answer = self.pages.answer(self.path)
        self.send_content(answer.content, answer.kind, answer.status)


class _NoSuchPageError(Exception):
    """An address that names what the store does not have."""


def _sentence_page(text: str, status: int) -> Answer:
    """Return a page with one sentence."""
    section = PageSection("answer", "Not found" if status == 404 else "Cannot be shown", (Text(text, "warning"),))
    page = Page("store", "no page", "", (section,), origin=(("all runs", STORE),))
    return Answer(page.html().encode(), status=status)


def _failed(row: Row, above: tuple[tuple[str, str], ...]) -> Page:
    facts = Facts((("recording", row["recording"]), ("tags", row["tags"] or "")))
    blocks = (Text(row["reason"] or "", "warning"), facts, Code(row["log"] or ""))
    return Page("run", row["run"], "This run has no result.", (PageSection("reason", "Why", blocks),), origin=above)


def _table(rows: list[Row]) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=[*SCHEMA.names, "line", "month"])
    return table.assign(start=pd.to_datetime(table["start"], utc=True))


def _overlaps(row: Row, ends: tuple[float, float]) -> bool:
    low, high = row["from_chainage_m"], row["to_chainage_m"]
    return low is not None and high is not None and low < ends[1] and high > ends[0]


def _progress_text(batches: list[BatchState], unread: int) -> str:
    """Return how far batches are, in words."""
    now = time.time()
    texts = [_how_far(batch, now) for batch in batches] or ["No batch is running."]
    return " ".join((*texts, *([f"The results of {unread} runs are yet to be read."] if unread else [])))


def _how_far(batch: BatchState, now: float) -> str:
    if batch.lost(now):
        return f"Batch {batch.name} ended before it was done: {batch.done} of {batch.runs} runs."
    remaining_s = batch.remaining_s
    time_left = "" if remaining_s is None else f", {batch.runs_per_minute:.3g} a minute, {duration(remaining_s)} left"
    failures = f", {batch.failed} failed" if batch.failed else ""
    return f"Batch {batch.name}: {batch.done} of {batch.runs} runs{time_left}{failures}."
