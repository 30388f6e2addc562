"""Commands write to a terminal or a pipe."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from trackfg.errors import printable

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Column, Table

_WIDTH_IN_A_PIPE = 120
"""Letters in a line where there is no terminal whose width could be asked for."""

_BAR_WIDTH = 16
"""Letters of a progress bar: with what stands beside it a line of 80."""


def show(table: RenderableType) -> None:
    """Print to standard output. Columns of a table that is too wide break between words."""
    if _Loudness.collected is not None:
        _Loudness.collected.append(table)
        return
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _WIDTH_IN_A_PIPE
    if isinstance(table, Table):
        _escape(table)
        _fit(table, console)
    console.print(table)


def _escape(table: Table) -> None:
    """Escape the control characters of every text in a table, but for the ends of its lines: it may be a file's."""
    from rich.text import Text

    for column in table.columns:
        for cell in column.cells:
            if isinstance(cell, Text) and not cell.plain.isprintable():
                cell.plain = "\n".join(map(printable, cell.plain.split("\n")))


def _fit(table: Table, console: Console) -> None:
    """Set the widths of columns where the table is wider than the console: the widest give way first, down to their
    longest words, and words are broken where even those are too wide together.
    """
    from rich.measure import Measurement, measure_renderables

    options = console.options.update(max_width=sys.maxsize)
    columns = [measure_renderables(console, options, [column.header, *column.cells]) for column in table.columns]
    between = Measurement.get(console, options, table).maximum - sum(column.maximum for column in columns)
    room = console.width - between
    if sum(column.maximum for column in columns) <= room:
        return
    widths = [(column.minimum, column.maximum) for column in columns]
    if sum(column.minimum for column in columns) > room:
        widths = [(1, column.minimum) for column in columns]
    most = 1
    while sum(_within(most + 1, width) for width in widths) <= room:
        most += 1
    for column, width in zip(table.columns, widths, strict=True):
        column.width, column.no_wrap, column.overflow = _within(most, width), False, "fold"


def _within(width: int, bounds: tuple[int, int]) -> int:
    return min(max(width, bounds[0]), bounds[1])


class _Loudness:
    """The process holds in one place whether ``--quiet`` was given, and what is to be printed as JSON at the end."""

    quiet = False
    collected: list[RenderableType] | None = None


def set_quiet(quiet: bool) -> None:
    """Have what follows be quiet, or loud."""
    _Loudness.quiet = quiet


@contextmanager
def printed_as_json() -> Iterator[None]:
    """Print what the block shows as one JSON object when it ends, also where it ends with an exit status.

    ``key: value`` becomes a member, a line without a key one of ``files``, a table one of ``tables`` with its rows.
    """
    parts: list[RenderableType] = []
    _Loudness.collected = parts
    try:
        yield
    except typer.Exit:
        print(_as_json(parts))
        raise
    finally:
        _Loudness.collected = None
    print(_as_json(parts))


def _as_json(parts: Iterable[RenderableType]) -> str:
    content: dict[str, Any] = {}
    for part in parts:
        if isinstance(part, str):
            key, colon, value = part.partition(": ")
            content.update({key: value}) if colon else content.setdefault("files", []).append(part)
        else:
            content.setdefault("tables", []).append(_table_as_json(part))
    return json.dumps(content, indent=2)


def _table_as_json(part: RenderableType) -> Any:
    from rich.table import Table

    if not isinstance(part, Table):
        return str(part)
    names = [str(column.header) or f"column {number}" for number, column in enumerate(part.columns, start=1)]
    rows = zip(*(map(str, column.cells) for column in part.columns), strict=True)
    return {"title": str(part.title), "rows": [dict(zip(names, row, strict=True)) for row in rows]}


def titled(title: str, *columns: str | Column, **options: Any) -> Table:
    """Return an empty table with its title above."""
    from rich.table import Table

    return Table(*columns, title=title, title_justify="left", title_style="bold", **options)


def columns(*headings: str, **options: Any) -> list[Column]:
    """Return columns of a table that are alike."""
    from rich.table import Column

    return [Column(heading, **options) for heading in headings]


def numbers(*headings: str) -> list[Column]:
    """Return columns that stand to the right."""
    return columns(*headings, justify="right")


def print_unless_quiet(*parts: RenderableType) -> None:
    """Print lines and tables that go with what a command wrote; nothing with ``--quiet``."""
    if _Loudness.quiet and _Loudness.collected is None:
        return
    for part in parts:
        _print(part)


def _print(part: RenderableType) -> None:
    if isinstance(part, str) and _Loudness.collected is None:
        print(part)
    else:
        show(part)


def show_unless_written(*parts: RenderableType, written: str | None) -> None:
    """Show what a command is called for, or, where it has ``written`` that to a file, also say so, unless quiet."""
    if written is not None:
        print_unless_quiet(*parts, written)
        return
    for part in parts:
        _print(part)


def note(text: str) -> None:
    """Print what is worth knowing to standard error; nothing with ``--quiet``."""
    if not _Loudness.quiet:
        complain(text)


def complain(text: str) -> None:
    """Print a message to standard error: one line, which a terminal breaks between words."""
    if sys.stderr.isatty():
        columns = shutil.get_terminal_size().columns
        text = textwrap.fill(text, columns, break_long_words=False, break_on_hyphens=False)
    print(text, file=sys.stderr)


def command(*words: str | Path) -> str:
    """Return a command of trackfg as a shell takes it, with quotes around paths that have blanks."""
    return shlex.join(["trackfg", *map(str, words)])


def next_step(*commands: str) -> None:
    """Say on a terminal which commands go on from here; nothing in a pipe, and nothing with ``--quiet``."""
    if shows_progress() and _Loudness.collected is None:
        print("next: " + "\n      ".join(commands), file=sys.stderr)


def shows_progress() -> bool:
    """Return whether progress is shown: on a terminal, without ``--quiet``."""
    return sys.stderr.isatty() and not _Loudness.quiet


@contextmanager
def progress_bar(*, of_all: bool = True) -> Iterator[Callable[[str, float | None], None] | None]:
    """Show a progress bar on a terminal, nothing in a pipe.

    ``of_all``: fractions are those of the whole command, and not of its stages, so that the time left is shown too. A
    fraction that is None is not known.
    """
    if not shows_progress():
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns: list[ProgressColumn] = [TextColumn("{task.description:<24}"), BarColumn(_BAR_WIDTH), TaskProgressColumn()]
    columns += [TimeElapsedColumn(), *([TimeRemainingColumn(), TextColumn("left")] if of_all else [])]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0)

        def update(stage: str, fraction_done: float | None) -> None:
            begins = stage != bar.tasks[0].description  # shown at once, however short it is
            bar.tasks[0].total = None if fraction_done is None else 1.0  # update() takes None as "leave it"
            bar.update(task, description=stage, completed=fraction_done or 0.0, refresh=begins)

        yield update


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show on a terminal that the block is at work on ``what``, and for how long; it prints nothing meanwhile."""
    with progress_bar(of_all=False) as progress:
        if progress is not None:
            progress(what, None)
        yield


@contextmanager
def interruptible(what: str) -> Iterator[Callable[[], AbstractContextManager[None]]]:
    """Do as :func:`working`; give what shows nothing within a block of its own, while the command asks something."""
    with ExitStack() as shown:
        shown.enter_context(working(what))

        @contextmanager
        def interrupted() -> Iterator[None]:
            shown.close()
            yield
            shown.enter_context(working(what))

        yield interrupted
