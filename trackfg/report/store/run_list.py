"""The list of a store's runs, and which of them are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import pandas as pd

from trackfg.report.numbers import NONE
from trackfg.report.page import FormField, PageTable, TableRow
from trackfg.report.store.addresses import run_address

MOST_ROWS = 200
"""Runs of one page of the list: more make a page slow in a browser."""

_ALL = ("", "all")
_STATES = (
    _ALL,
    ("done", "done"),
    ("failed", "failed"),
    ("doubted", "not to be trusted in a quantity"),
    ("slips", "with slips or slides"),
)
_HEADINGS = ("run", "begin, UTC", "line", "from km", "to km", "status", "doubted", "slips", "slides", "warnings")
_NUMBERS = frozenset({1, 3, 4, 7, 8, 9})
_VERDICT = "verdict_"


@dataclass(frozen=True)
class RunChoice:
    """The choice of runs that are asked for: each field as it stands in a page's address, empty where all are.

    ``since`` and ``until`` are months (``2026-05``), ``state`` one of done, failed, doubted, slips; ``text`` words that
    are part of a run's name, tags, recording or reason; ``page`` counts from 1.
    """

    line: str = ""
    since: str = ""
    until: str = ""
    state: str = ""
    text: str = ""
    page: str = ""

    @classmethod
    def of_query(cls, query: Mapping[str, str]) -> RunChoice:
        """Return what an address asks for; what it does not name is empty."""
        return cls(**{field.name: query.get(field.name, "") for field in fields(cls)})

    def chosen(self, runs: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of the catalogue that are asked for, the newest first."""
        true = pd.Series(True, index=runs.index)
        if self.line:
            true &= runs["line"] == self.line
        if self.since:
            true &= runs["month"] >= self.since
        if self.until:
            true &= runs["month"] <= self.until
        if self.state in ("done", "failed"):
            true &= runs["status"] == self.state
        elif self.state == "doubted":
            true &= doubted(runs) != ""
        elif self.state == "slips":
            true &= runs[["slips", "slides"]].fillna(0).sum(axis=1) > 0
        for word in self.text.lower().split():
            columns = (runs[name].fillna("").str.lower() for name in ("run", "tags", "recording", "reason"))
            true &= pd.concat([column.str.contains(word, regex=False) for column in columns], axis=1).any(axis=1)
        return runs[true].sort_values(["start", "run"], ascending=[False, True], kind="stable")

    def first_row(self, rows: int) -> int:
        """Return the row that the page of the list begins with, counted from 0."""
        page = int(self.page) if self.page.isdecimal() else 1
        return MOST_ROWS * min(max(page - 1, 0), max(rows - 1, 0) // MOST_ROWS)

    def form(self, runs: pd.DataFrame, chosen: int) -> tuple[FormField, ...]:
        """Return the fields in which runs are chosen; ``chosen`` is the number of those that are."""
        lines = [_ALL, *((line, line) for line in sorted(runs["line"].unique()))]
        months = [_ALL, *((month, month) for month in sorted(runs["month"].unique()))]
        starts = range(0, chosen, MOST_ROWS)
        pages = [(str(i), f"{start + 1} – {min(start + MOST_ROWS, chosen)}") for i, start in enumerate(starts, start=1)]
        page = FormField("page", "rows", str(self.first_row(chosen) // MOST_ROWS + 1), tuple(pages))
        return (
            FormField("line", "line", self.line, tuple(lines)),
            FormField("since", "since", self.since, tuple(months)),
            FormField("until", "until", self.until, tuple(months)),
            FormField("state", "runs", self.state, _STATES),
            FormField("text", "words", self.text),
            *([page] if len(pages) > 1 else []),
        )


def doubted(runs: pd.DataFrame) -> pd.Series:
    """Return for each run the quantities that its verdict does not trust, as one text."""
    text = pd.Series("", index=runs.index)
    for name in runs.columns:
        if str(name).startswith(_VERDICT):
            words = str(name).removeprefix(_VERDICT).replace("_", "-")
            text = text.where(runs[name] != "not_trusted", text + ", " + words)
    return text.str.removeprefix(", ")


def run_table(runs: pd.DataFrame, caption: str = "") -> PageTable:
    """Return a table of runs, each with a link to its report; of a failed one to its reason and log."""
    rows = tuple(
        TableRow(
            (
                run["run"],
                f"{run['start']:%Y-%m-%d %H:%M}" if pd.notna(run["start"]) else NONE,
                run["line"],
                *(f"{1e-3 * run[name]:z.3f}" if pd.notna(run[name]) else NONE for name in _ENDS),
                run["status"],
                why,
                *(f"{run[name]:.0f}" if pd.notna(run[name]) else NONE for name in ("slips", "slides", "warnings")),
                run["tags"] or "",
            ),
            "error" if run["status"] == "failed" else "",
            link=run_address(run["run"]),
        )
        for run, why in zip(runs.to_dict("records"), doubted(runs), strict=True)
    )
    return PageTable((*_HEADINGS, "tags"), rows, _NUMBERS, caption)


_ENDS = ("from_chainage_m", "to_chainage_m")
