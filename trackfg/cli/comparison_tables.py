"""The tables of ``trackfg compare`` are rich tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from trackfg.cli.terminal import columns, numbers, titled
from trackfg.comparison.table import QUANTITIES, REFERENCE, About, ComparedCase, Difference, Row

_BEATING = "bold yellow"


def of_comparison(about: About) -> Iterator[RenderableType]:
    """Yield a table per case and task, the best estimator of each quantity first, and one per quantity by speed.

    Last what was left out, and why.
    """
    for case in about.cases:
        rows = [row for row in about.rows if row.case == case.name]
        for task in dict.fromkeys(row.task for row in rows):
            of_task = [row for row in rows if row.task == task]
            yield _task_table(case, task, [row for row in of_task if row.from_kmh is None])
            banded = [row for row in of_task if row.from_kmh is not None]
            for quantity in dict.fromkeys(row.quantity for row in banded):
                yield _speed_table(case, quantity, [row for row in banded if row.quantity == quantity])
    if about.differences:
        yield _difference_table(about)
    if about.left_out:
        table = titled("Left out", *columns("case", "estimator", "why", overflow="fold"))
        alike: dict[tuple[str, str], list[str]] = {}
        for omission in about.left_out:
            alike.setdefault((omission.case, omission.reason), []).append(omission.estimator)
        for (name, reason), names in alike.items():
            table.add_row(Text(name), Text(", ".join(names)), Text(reason))
        yield table


def _task_table(case: ComparedCase, task: str, rows: Sequence[Row]) -> RenderableType:
    withheld = case.basis == "withheld"
    what = f"{case.name} withheld" if withheld else f"{case.name}, {task}"
    runs = f"{len(case.seeds)} {'parts' if withheld else 'runs'}" if len(case.seeds) > 1 else "1 run"
    against = ", difference from the first recording" if case.basis == "repeatability" else ""
    figures = numbers("error", "±", "largest", "coverage,\n%", "error /\nsmoother's", "s / km")
    title = f"{what}: {runs} of {case.duration_s:.0f} s, {case.distance_km:.2f} km{against}"
    table = titled(title, *columns("", no_wrap=True), *figures)  # names and headings fit into 80 letters whole
    for quantity in dict.fromkeys(row.quantity for row in rows):
        table.add_section()
        table.add_row(Text(QUANTITIES[quantity].heading.replace(", offset", ",\noffset"), style="bold"))
        for row in rows:
            if row.quantity == quantity:
                table.add_row(*_score_cells(row), style=_BEATING if row.beats_the_smoother else "")
    return _explained(table, rows)


def _score_cells(row: Row) -> Iterator[Text]:
    def number(value: float | None, digits: str = ".3g") -> str:
        return "" if value is None else f"{value:{digits}}"

    interval = row.to_smoother_interval
    ratio = number(row.to_smoother) + (f" ({interval[0]:.2g} - {interval[1]:.2g})" if interval else "")
    yield Text(("! " if row.beats_the_smoother else "  ") + row.estimator)
    yield Text(number(row.error))
    yield Text(number(row.error_margin, ".2g"))
    yield Text(number(row.largest))
    yield Text(number(None if row.coverage is None else 100.0 * row.coverage, ".1f"))
    yield Text(ratio)
    yield Text(number(row.seconds_per_km, ".2g"))


def _speed_table(case: ComparedCase, quantity: str, rows: Sequence[Row]) -> RenderableType:
    """Return error of each estimator in each band of speed."""
    names = list(dict.fromkeys(row.estimator for row in rows))
    names.sort(key=lambda name: name != REFERENCE)
    table = titled(f"{case.name}, {QUANTITIES[quantity].heading}, by speed", *numbers("from km/h", *names))
    cells = {(row.from_kmh, row.estimator): row for row in rows}
    for band in sorted({row.from_kmh for row in rows if row.from_kmh is not None}):
        of_band = [cells.get((band, name)) for name in names]
        table.add_row(Text(f"{band:g}"), *(_band_cell(row) for row in of_band))
    return _explained(table, rows)


def _band_cell(row: Row | None) -> Text:
    if row is None:
        return Text("")
    if row.beats_the_smoother:
        return Text(f"! {row.error:.3g}", style=_BEATING)
    return Text(f"{row.error:.3g}")


def _difference_table(about: About) -> RenderableType:
    """Return how far the estimators are from the smoother: over the run, and in the kilometre where it is most."""
    table = titled("Differences from the smoother", "quantity", "estimator", *numbers("rms", "largest", "at km"))
    groups: dict[tuple[str, str], list[Difference]] = {}
    for difference in about.differences:
        groups.setdefault((difference.quantity, difference.estimator), []).append(difference)
    for (quantity, name), differences in sorted(groups.items(), key=lambda item: list(QUANTITIES).index(item[0][0])):
        whole = math.sqrt(sum(difference.rms**2 for difference in differences) / len(differences))
        worst = max(differences, key=lambda difference: difference.rms)
        table.add_row(QUANTITIES[quantity].heading, name, f"{whole:.3g}", f"{worst.rms:.3g}", f"{worst.from_km:g}")
    return table


def _explained(table: Table, rows: Sequence[Row]) -> Table:
    if any(row.beats_the_smoother for row in rows):
        table.caption, table.caption_justify = "! beats the smoother", "left"
    return table
