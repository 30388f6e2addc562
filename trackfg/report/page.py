"""A page: sections of texts, tables and charts, rendered into one file that needs nothing else.

Everything that comes from data is escaped. The page's content security policy names its scripts by their hashes and
allows no connection, but one to the server of a page that is served, so that nothing in a recording can run in it or be
sent anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

from trackfg.files.atomic_file import write_whole
from trackfg.files.libraries import library
from trackfg.report.charts import Chart
from trackfg.report.columns import Column
from trackfg.report.numbers import NONE

_TEMPLATES = "template"
_SCRIPT = (
    "numbers.js",
    "columns.js",
    "thinning.js",
    "axis.js",
    "strips.js",
    "paper.js",
    "tables.js",
    "page.js",
)
"""The parts of the page's own script, in order; one function holds them all."""
_MANY = 25
"""Rows of a table that stand open; longer ones are folded."""
_NOTHING = ("", NONE)
"""What a cell says that says nothing."""
_FACTORY, _FACTORY_END = '() => {\n"use strict";var Plotly', "}));"


@dataclass(frozen=True)
class Text:
    """A paragraph. ``tone``: a note is small print, a warning stands out."""

    text: str
    tone: Literal["plain", "note", "good", "warning"] = "plain"


@dataclass(frozen=True)
class Tile:
    """A figure of the headline: what it is, its value with unit, and a word on it."""

    label: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Tiles:
    """Figures side by side."""

    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class Facts:
    """Names and values under each other."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class TableRow:
    """The cells of a table's row. ``mark``: how it stands out: ``own`` is what the page is about, ``bad`` where it is
    beaten, ``group`` has one cell that heads the rows below; ``warning`` and ``error`` are levels. ``link``: the page
    that the first cell leads to.
    """

    cells: tuple[str, ...]
    mark: Literal["", "own", "bad", "group", "warning", "error"] = ""
    link: str = ""

    @classmethod
    def plain(cls, rows: Iterable[Iterable[str]]) -> tuple[TableRow, ...]:
        """Return rows of cells, none of which stands out."""
        return tuple(cls(tuple(cells)) for cells in rows)


@dataclass(frozen=True)
class PageTable:
    """``numbers`` are the columns that stand to the right, counted from 0."""

    headings: tuple[str, ...]
    rows: tuple[TableRow, ...]
    numbers: frozenset[int] = frozenset()
    caption: str = ""


def without_columns(table: PageTable, left_out: Container[int] = ()) -> PageTable:
    """Return a table without the columns ``left_out`` and without those in which no row says anything."""
    cells = [row.cells for row in table.rows if row.mark != "group"]
    kept = [i for i in range(len(table.headings)) if i not in left_out and any(row[i] not in _NOTHING for row in cells)]
    rows = (row if row.mark == "group" else replace(row, cells=tuple(row.cells[i] for i in kept)) for row in table.rows)
    return replace(
        table,
        headings=tuple(table.headings[i] for i in kept),
        rows=tuple(rows),
        numbers=frozenset(new for new, old in enumerate(kept) if old in table.numbers),
    )


@dataclass(frozen=True)
class Drawing:
    """A chart, with a line above and one below it."""

    chart: Chart
    title: str = ""
    note: str = ""


@dataclass(frozen=True)
class BarCell:
    """A stretch of a bar: its ends, its colour from 0 (best) on or -1 (not known), what it is, and where it leads.

    A ``link`` to a page is a short cut for the mouse: the same page is to be reached from a table, too.
    """

    start: float
    end: float
    step: int
    text: str
    link: str = ""


@dataclass(frozen=True)
class BarRow:
    """A bar and its name, with the page that this leads to; ``legend`` says what its colours go from and to."""

    label: str
    cells: tuple[BarCell, ...]
    legend: str
    link: str = ""


@dataclass(frozen=True)
class ColourBar:
    """Bars below each other, over ``places`` that are written evenly; ``alternative`` says in words what they show."""

    rows: tuple[BarRow, ...]
    places: tuple[str, ...]
    alternative: str

    @property
    def extent(self) -> tuple[float, float]:
        """Return where the bars begin and how long they are."""
        cells = [cell for row in self.rows for cell in row.cells]
        start = min(cell.start for cell in cells)
        return start, max(cell.end for cell in cells) - start

    @property
    def linked(self) -> bool:
        """Return whether anything in it leads to another page."""
        return any(row.link or any(cell.link for cell in row.cells) for row in self.rows)


@dataclass(frozen=True)
class Fold:
    """A fold of the page opens when it is asked for, and on paper."""

    summary: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Code:
    """Text as it is, to be copied."""

    text: str


@dataclass(frozen=True)
class FormField:
    """A field of a form: its name in the address, its label and value, and the choices; any text where there are none.

    A choice is a value and what is read.
    """

    name: str
    label: str
    value: str
    choices: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Form:
    """Fields whose values are asked for in the address of the same page; only in a page with an ``origin``."""

    fields: tuple[FormField, ...]


@dataclass(frozen=True)
class Latest:
    """A text that is asked for again and again, from an address that answers JSON: ``text``, and ``reload`` where the
    page has more to show. Only in a page with an ``origin``.
    """

    address: str
    text: str


@dataclass(frozen=True)
class Columns:
    """Short tables in as many columns as there is room for."""

    blocks: tuple[PageTable, ...]


@dataclass(frozen=True)
class Signature:
    """Lines to be filled in by hand, which only paper has."""

    lines: tuple[str, ...]


Block = Text | Tiles | Facts | PageTable | Drawing | ColourBar | Fold | Code | Form | Latest | Columns | Signature


def folded_if_long(table: PageTable, what: str) -> tuple[Block, ...]:
    """Return a table as it is; a long one is folded, below those of its rows that are marked. ``what``: its rows."""
    if len(table.rows) <= _MANY:
        return (table,)
    marked = tuple(row for row in table.rows if row.mark)
    above = (replace(table, rows=marked, caption=""),) if marked else ()
    return (*above, Fold(f"All {len(table.rows)} {what}", (table,)))


@dataclass(frozen=True)
class PageSection:
    """``name`` is its address in the page, ``short`` what leads to it; its title where that is empty."""

    name: str
    title: str
    blocks: tuple[Block, ...]
    short: str = ""


@dataclass(frozen=True)
class Page:
    """A page: ``what`` says of what kind it is, ``title`` of what.

    ``origin``: the pages above this one, names and addresses, of a page that is served; it may ask its server.
    """

    what: str
    title: str
    subtitle: str
    sections: tuple[PageSection, ...]
    origin: tuple[tuple[str, str], ...] = ()

    def charts(self) -> list[Chart]:
        """Return the charts from top to bottom."""
        return [drawing.chart for section in self.sections for drawing in _drawings(section.blocks)]

    def html(self) -> str:
        """Return the whole file; the same page gives the same text."""
        charts = self.charts()
        columns = list(dict.fromkeys(column for chart in charts for column in chart.columns()))
        number = {column: i for i, column in enumerate(columns)}
        spec = {
            "charts": [chart.spec(number) for chart in charts],
            "columns": [_header(column) for column in columns],
        }
        scripts = (
            *([_part("load_plotly.js")] if charts else []),
            _script(),
            *([_part("served.js")] if self.origin else []),
        )
        return (
            _environment()
            .get_template("page.html.j2")
            .render(
                page=self,
                charts=charts,
                policy=_policy((*([_plotly()] if charts else []), *scripts), served=bool(self.origin)),
                plotly=_packed_plotly() if charts else "",
                style=_part("page.css"),
                scripts=scripts,
                spec=_json(spec),
                columns=columns,
            )
        )

    def write(self, path: Path) -> Path:
        """Write the page in one step: killed at any moment, it leaves the old file, whole, or none."""
        write_whole(path, self.html().encode("utf-8"))
        return path


def _drawings(blocks: tuple[Block, ...]) -> Iterator[Drawing]:
    for block in blocks:
        if isinstance(block, Drawing):
            yield block
        elif isinstance(block, Fold):
            yield from _drawings(block.blocks)


def _header(column: Column) -> dict[str, Any]:
    return {
        "rows": len(column.numbers),
        "step": column.step,
        "order": column.order,
        "planes": column.planes,
        "gaps": column.gaps,
    }


def _json(content: Any) -> str:
    """Return JSON that cannot end the script element that holds it."""
    text = json.dumps(content, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _policy(scripts: tuple[str, ...], *, served: bool) -> str:
    digests = (base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii") for script in scripts)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests)
    server = "connect-src 'self'; form-action 'self'" if served else "form-action 'none'"
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        f"base-uri 'none'; {server}"
    )


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("trackfg.report", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def _part(name: str) -> str:
    return (Path(__file__).parent / _TEMPLATES / name).read_text(encoding="utf-8")


@cache
def _script() -> str:
    parts = "\n".join(_part(name) for name in _SCRIPT)
    return f'"use strict";\n(() => {{\n{parts}\n}})();\n'


@cache
def _packed_plotly() -> str:
    """Return plotly.js as base64 of a zlib stream: less than half of it. The browser unpacks it by ``load_plotly.js``,
    and runs it because the policy names its hash.
    """
    return base64.b64encode(zlib.compress(_plotly().encode("utf-8"), 9)).decode("ascii")


@cache
def _plotly() -> str:
    """Return plotly.js, its factory in parentheses: browsers then compile it as they read it, and not a second time."""
    script: str = library("plotly.offline", "charts").get_plotlyjs()
    head, factory, rest = script.partition(_FACTORY)
    if not factory or not rest.rstrip().endswith(_FACTORY_END):
        return script
    return f"{head}({factory}{rest.rstrip().removesuffix(_FACTORY_END)}}})));"
