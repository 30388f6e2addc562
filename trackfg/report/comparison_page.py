"""The page of a comparison: who is better at what, by how much, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from trackfg.comparison.table import REFERENCE, Comparison, Row
from trackfg.errors import counted
from trackfg.report.comparison_charts import by_speed, case_curves, colours, run_times
from trackfg.report.comparison_tables import (
    beaten_table,
    best_table,
    case_table,
    difference_table,
    estimator_names,
    estimator_table,
    left_out_table,
    score_table,
    surely_beats,
)
from trackfg.report.numbers import duration
from trackfg.report.page import Block, Code, Drawing, Facts, Fold, Page, PageSection, Text, Tile, Tiles

_FEW = 12
"""Rows in which the smoother is beaten that are always shown; all that are sure are, too."""


def comparison_page(comparison: Comparison, command: str) -> Page:
    """``command`` is what made the page."""
    about = comparison.about
    names = estimator_names(about)
    colour = colours(names)
    runs = sum(len(case.seeds) for case in about.cases)
    subtitle = ", ".join(
        (
            counted(len(names), "estimator"),
            counted(runs, "run"),
            counted(len(about.cases), "case"),
            f"trackfg {about.versions.get('trackfg')}",
        )
    )
    title = ", ".join(case.name for case in about.cases if case.basis != "withheld")
    sections = [
        *_best(comparison),
        _beaten(comparison),
        _what(comparison, runs),
        *_tasks(comparison, colour),
        *_curves(comparison, colour),
        *_differences(comparison),
        *_times(comparison, colour),
        _left_out(comparison),
        _made(comparison, command),
    ]
    return Page("comparison", title, subtitle, tuple(sections))


def _best(comparison: Comparison) -> Iterator[PageSection]:
    table = best_table(comparison.about)
    if not table.rows:
        return
    note = (
        "The best system is, for each quantity, the one whose error over the smoother's in the same runs is least. The "
        "ratio is the geometric mean of these, above 1 where the smoother is better. All systems are below."
    )
    yield PageSection("best", "The smoother against the best published system", (table, Text(note, "note")), "Summary")


def _beaten(comparison: Comparison) -> PageSection:
    held = [row for row in comparison.about.rows if row.to_smoother is not None]
    beaten = sum(row.beats_the_smoother for row in held)
    sure = sum(surely_beats(row) for row in held)
    title = "Where a published system beats the smoother"
    if not held:
        text = "No published system has a score beside one of the smoother."
        return PageSection("beaten", title, (Text(text),), "Where others win")
    if not beaten:
        text = (
            "Nowhere: in every quantity, case and speed band the smoother's error is the smallest "
            f"({counted(len(held), 'score')} of other systems)."
        )
        return PageSection("beaten", title, (Text(text, "good"),), "Where others win")
    table, shown = beaten_table(comparison.about), max(sure, _FEW)
    blocks: list[Block] = [
        Text(
            f"In {beaten} of {len(held)} scores, speed bands among them; {_how_sure(sure, held)}.",
            "warning",
        ),
        replace(table, rows=table.rows[:shown]),
    ]
    if len(table.rows) > shown:
        rest = replace(table, rows=table.rows[shown:])
        blocks.append(Fold(f"{len(rest.rows)} more, which may all be chance", (rest,)))
    note = (
        "Ratio: error over the smoother's error in the same runs, geometric mean. With several runs it is sure where "
        "the whole 95 % interval is below 1; otherwise another choice of runs may say the opposite."
    )
    return PageSection("beaten", title, (*blocks, Text(note, "note")), "Where others win")


def _how_sure(sure: int, held: Sequence[Row]) -> str:
    """Return how many of the scores are more than chance; one run decides nothing."""
    if all(row.to_smoother_interval is None for row in held):
        return "one run does not say which of them are chance"
    return f"in {sure} of these the whole 95 % interval is below 1"


def _what(comparison: Comparison, runs: int) -> PageSection:
    about = comparison.about
    tiles = Tiles(
        (
            Tile("cases", str(len(about.cases))),
            Tile("runs", str(runs)),
            Tile("estimators", str(len(estimator_names(about)))),
            Tile("distance", f"{sum(case.distance_km * len(case.seeds) for case in about.cases):.1f} km"),
            Tile("computed in", duration(about.seconds)),
        )
    )
    tables = (case_table(about), estimator_table(about))
    return PageSection("compared", "What was compared", (tiles, *tables), "Compared")


def _tasks(comparison: Comparison, colour: dict[str, str]) -> Iterator[PageSection]:
    about = comparison.about
    for number, task in enumerate(dict.fromkeys(row.task for row in about.rows), start=1):
        blocks: list[Block] = [
            Text(
                "Error: the mean over runs of each run's RMS, or of its standard deviation where an unknown offset is "
                "removed. Largest: of all runs. Rows in red are better than the smoother.",
                "note",
            ),
            score_table(about, task),
        ]
        rows = [row for row in about.rows if row.task == task]
        for case in about.cases:
            chart = by_speed(rows, case.name, colour)
            if chart is not None:
                note = "Mean over runs, in bands of 5 km/h. Click a name to hide it, double-click to see it alone."
                blocks.append(Drawing(chart, title=f"{case.name}: error over speed", note=note))
        yield PageSection(f"task-{number}", task.capitalize(), tuple(blocks))


def _curves(comparison: Comparison, colour: dict[str, str]) -> Iterator[PageSection]:
    choose = (
        "Click a name to show or hide it, double-click to see it alone; at first the smoother and the best of the "
        "others are shown. Bands: 95 % of the sigmas that the smoother claims."
    )
    blocks: list[Block] = []
    for case in comparison.about.cases:
        figures = case_curves(comparison, case.name, colour)
        errors, less = ("differences", "the smoother's") if case.basis == "smoother" else ("errors", "truth")
        for chart, what, note in (
            (figures.geometry, "geometry", "Each over its own chainage."),
            (figures.errors, f"{errors} of the geometry", f"Estimate less {less} at the same place."),
            (figures.over_time, f"{errors} over time", f"Estimate less {less}."),
        ):
            if chart is not None:
                title = f"{case.name}, first run: {what}"
                blocks.append(Drawing(chart, title=title, note=f"{note} {choose}"))
    if blocks:
        yield PageSection("curves", "Curves of one run", tuple(blocks), "Curves")


def _differences(comparison: Comparison) -> Iterator[PageSection]:
    if comparison.about.differences:
        note = (
            "RMS of estimate less smoother over each kilometre; where the quantity has one unknown offset, its mean "
            "over the run is removed. No truth is known: where they differ, what was withheld says who is nearer."
        )
        blocks = (Text(note, "note"), difference_table(comparison.about))
        yield PageSection("differences", "Where estimators differ from the smoother", blocks, "Differences")


def _times(comparison: Comparison, colour: dict[str, str]) -> Iterator[PageSection]:
    chart = run_times(comparison.about.rows, colour)
    if chart is not None:
        note = "Median over the cases of the time that an estimator took for a kilometre of run, one run at a time."
        yield PageSection("times", "Run time", (Drawing(chart, note=note),))


def _left_out(comparison: Comparison) -> PageSection:
    if not comparison.about.left_out:
        return PageSection("left-out", "Left out", (Text("Nothing: every estimator could use every case."),))
    return PageSection("left-out", "Left out", (left_out_table(comparison.about),))


def _made(comparison: Comparison, command: str) -> PageSection:
    blocks: tuple[Block, ...] = (
        Text("This page was made by"),
        Code(command),
        Text("from what trackfg compare wrote with these versions:"),
        Facts(tuple(comparison.about.versions.items())),
        Text(
            f"Ratios are over {REFERENCE!r}; all are scored by the same code (trackfg.evaluation.scores) on the "
            "same runs; trackfg compare with the cases and seeds above makes it again."
        ),
    )
    return PageSection("made", "How it was made", blocks, "Made")
