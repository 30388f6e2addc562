"""The tables of a comparison: what was compared, who beats the smoother where, and every score."""

from __future__ import annotations

from trackfg.comparison.table import BAND_KMH, QUANTITIES, REFERENCE, About, Task
from trackfg.comparison.table import Row as Score
from trackfg.report.numbers import NONE, digits, duration, interval, percent
from trackfg.report.page import PageTable, TableRow, without_columns

_BASIS = {
    "truth": "the truth",
    "repeatability": "the first run",
    "withheld": "measurements withheld",
    "smoother": "the smoother",
}
_STATISTIC = {"rms": "RMS", "sd": "SD"}


def case_table(about: About) -> PageTable:
    """Return the table of what was compared, and on how many runs."""
    rows = TableRow.plain(
        (
            case.name,
            case.summary,
            _BASIS[case.basis],
            str(len(case.seeds)),
            ", ".join(str(seed) for seed in case.seeds),
            f"{case.distance_km:.2f}",
            duration(case.duration_s),
        )
        for case in about.cases
    )
    headings = ("case", "what it is", "held against", "runs", "seeds", "length, km", "duration")
    return PageTable(headings, rows, numbers=frozenset((3, 5, 6)))


def estimator_names(about: About) -> list[str]:
    """Return the estimators that are described or have a score."""
    return list(dict.fromkeys([*about.estimators, *(row.estimator for row in about.rows)]))


def estimator_table(about: About) -> PageTable:
    """Return a table with a line on each."""
    rows = tuple(
        TableRow((name, about.estimators.get(name, NONE)), mark="own" if name == REFERENCE else "")
        for name in estimator_names(about)
    )
    return PageTable(("estimator", "what it is"), rows)


def best_table(about: About) -> PageTable:
    """Return the smoother against the best of the others, a row per case and quantity, over whole runs."""
    of_parts = {case.name for case in about.cases if case.basis == "withheld"}
    places: dict[tuple[str, str], list[Score]] = {}
    for row in about.rows:
        if row.from_kmh is None:
            places.setdefault((row.case, row.quantity), []).append(row)
    rows = []
    for (case, quantity), of_place in places.items():
        reference_row = next((row for row in of_place if row.estimator == REFERENCE), None)
        others = [row for row in of_place if row.to_smoother is not None]
        if reference_row is None or not others:
            continue
        best = min(others, key=lambda row: row.to_smoother or 0.0)
        rows.append(
            TableRow(
                (
                    case,
                    f"{QUANTITIES[quantity].heading} ({_STATISTIC[best.statistic]})",
                    _error(reference_row),
                    _error(best),
                    best.estimator,
                    digits(best.to_smoother),
                    interval(best.to_smoother_interval),
                    str(best.runs),
                    verdict_on(best, parts=case in of_parts),
                ),
                mark="bad" if best.beats_the_smoother else "",
            )
        )
    headings = (
        "case",
        "error of",
        "smoother",
        "best published system",
        "which",
        "ratio",
        "95 % interval",
        "runs",
        "verdict",
    )
    return _by_case(PageTable(headings, tuple(rows), numbers=frozenset((2, 3, 5, 6, 7))), about)


def _by_case(table: PageTable, about: About) -> PageTable:
    """Return a table whose first column is the case: without it where there is one case, which the page names."""
    return without_columns(table, (0,) if len(about.cases) == 1 else ())


def verdict_on(row: Score, *, parts: bool = False) -> str:
    """Return in words what the ratio of a system's error to the smoother's says, and how far so many runs say it.

    ``parts``: what counts as runs are the parts of one that were withheld, so the interval says nothing of other runs.
    """
    if row.to_smoother is None:
        return "no ratio"
    better = row.to_smoother > 1.0
    if row.to_smoother_interval is None:
        side = "better" if better else "worse"
        return f"the smoother is {side} in this {'run' if row.runs == 1 else 'set of runs'}; others may differ"
    low, high = row.to_smoother_interval
    where, others = (" in this run", "; other runs may differ") if parts else ("", "")
    if low > 1.0:
        return f"the smoother is better{where}: the whole interval is above 1{others}"
    if high < 1.0:
        return f"the smoother is worse{where}: the whole interval is below 1{others}"
    return f"{row.runs} {'parts of this run' if parts else 'runs'} do not decide: the interval holds 1"


def beaten_table(about: About) -> PageTable:
    """Return every score in which another system is better than the smoother: the sure ones first, then by the
    ratio.
    """
    reference_rows = {_place(row): row for row in about.rows if row.estimator == REFERENCE}
    beaten = [row for row in about.rows if row.beats_the_smoother]
    beaten.sort(key=lambda row: (not surely_beats(row), row.to_smoother))
    rows = tuple(
        TableRow(
            (
                row.case,
                QUANTITIES[row.quantity].heading,
                _band(row),
                row.estimator,
                _error(row),
                _error(reference_rows[_place(row)]) if _place(row) in reference_rows else NONE,
                digits(row.to_smoother),
                interval(row.to_smoother_interval),
                _sureness(row),
            ),
            mark="bad",
        )
        for row in beaten
    )
    headings = (
        "case",
        "quantity",
        "speed, km/h",
        "system",
        "its error",
        "the smoother's",
        "ratio",
        "95 % interval",
        "is it sure?",
    )
    return _by_case(PageTable(headings, rows, numbers=frozenset((4, 5, 6, 7))), about)


def score_table(about: About, task: Task) -> PageTable:
    """Return the table of one task, for whole runs: a group of rows for each case and quantity, the best estimator
    first.
    """
    rows: list[TableRow] = []
    previous: tuple[str, str] | None = None
    for row in about.rows:
        if row.task != task or row.from_kmh is not None:
            continue
        if (row.case, row.quantity) != previous:
            previous = (row.case, row.quantity)
            case = "" if len(about.cases) == 1 else f"{row.case}: "
            group = f"{case}{QUANTITIES[row.quantity].heading} ({_STATISTIC[row.statistic]})"
            rows.append(TableRow((group,), mark="group"))
        is_reference = row.estimator == REFERENCE
        cells = (
            row.estimator,
            _error(row),
            digits(row.largest),
            percent(row.coverage),
            "" if is_reference else digits(row.to_smoother),
            "" if is_reference else interval(row.to_smoother_interval),
            digits(row.seconds_per_km),
            "better than the smoother" if row.beats_the_smoother else "",
        )
        rows.append(TableRow(cells, mark="own" if is_reference else "bad" if row.beats_the_smoother else ""))
    headings = (
        "estimator",
        "error ± 95 %",
        "largest",
        "within 1.96 sigma",
        "over the smoother's",
        "95 % interval",
        "s per km",
        "remark",
    )
    return without_columns(PageTable(headings, tuple(rows), numbers=frozenset(range(1, 7))))


def difference_table(about: About) -> PageTable:
    """Return the rms difference of each estimator from the smoother by kilometre, a row per quantity and estimator."""
    kms = sorted({difference.from_km for difference in about.differences})
    cells = {(cell.quantity, cell.estimator, cell.from_km): cell.rms for cell in about.differences}
    pairs = dict.fromkeys((quantity, name) for quantity in QUANTITIES for q, name, _ in cells if q == quantity)
    rows = TableRow.plain(
        (QUANTITIES[quantity].heading, name, *(digits(cells.get((quantity, name, km))) for km in kms))
        for quantity, name in pairs
    )
    headings = ("quantity", "estimator", *(f"km {km:g}" for km in kms))
    return PageTable(headings, rows, numbers=frozenset(range(2, len(headings))))


def left_out_table(about: About) -> PageTable:
    """Return the table of what could not be used, and why."""
    rows = TableRow.plain((omission.case, omission.estimator, omission.reason) for omission in about.left_out)
    return PageTable(("case", "estimator", "why"), rows)


def _place(row: Score) -> tuple[str, str, float | None]:
    return row.case, row.quantity, row.from_kmh


def _band(row: Score) -> str:
    return "all" if row.from_kmh is None else f"{row.from_kmh:.0f} – {row.from_kmh + BAND_KMH:.0f}"


def _error(row: Score) -> str:
    if row.error_margin is None:
        return digits(row.error)
    return f"{digits(row.error)} ± {digits(row.error_margin, 2)}"


def surely_beats(row: Score) -> bool:
    """Return whether the whole 95 % interval says that it is better than the smoother."""
    return row.to_smoother_interval is not None and row.to_smoother_interval[1] < 1.0


def _sureness(row: Score) -> str:
    if row.to_smoother_interval is None:
        return "one run"
    return "yes" if surely_beats(row) else "may be chance"
