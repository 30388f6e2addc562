"""The tables of ``trackfg limits`` are rich tables, or JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import pandas as pd
from rich.console import RenderableType
from rich.text import Text

from trackfg.cli.tables import records
from trackfg.cli.terminal import columns, numbers, titled
from trackfg.geometry.exceedances import Judgement
from trackfg.report.severity import (
    KilometreExceedances,
    by_kilometre,
    by_severity,
    counts_text,
    place_text,
    quantity_text,
    unsure_text,
    value_text,
)


def of_judgement(judgement: Judgement) -> Iterator[RenderableType]:
    """Yield the exceedances by kilometre and one by one, and what could not be judged with the reason.

    A place that exceeds several levels of a limit is shown once, under the severest.
    """
    exceedances = by_severity(judgement.found)
    if exceedances.empty:
        yield Text("No exceedance of the limits that could be judged.")
    else:
        yield _kilometres(by_kilometre(exceedances))
        yield _exceedances(exceedances.sort_values("chainage_m", kind="stable"))
        if note := unsure_text(exceedances):
            yield Text(note)
    for title, last, grouped in (
        ("Not judged", "why", judgement.not_judged_levels()),
        ("Not judged everywhere", "not known, m", judgement.unknown_levels()),
    ):
        if grouped:
            table = titled(title, *columns("limit", "class", last, overflow="fold"))
            for (quantity, text), levels in grouped.items():
                table.add_row(Text(quantity), Text(levels), Text(text))
            yield table


def _kilometres(kilometres: Sequence[KilometreExceedances]) -> RenderableType:
    counts, worst = columns("exceedances", "worst, as a share of its limit", overflow="fold")
    km, length = numbers("km", "length m")
    table = titled("By kilometre", km, counts, length, worst)
    for kilometre in kilometres:
        table.add_row(
            kilometre.km, Text(counts_text(kilometre.counts)), f"{kilometre.length_m:.2f}", Text(kilometre.worst_text)
        )
    return table


def _exceedances(exceedances: pd.DataFrame) -> RenderableType:
    what, level = columns("what", "class", overflow="fold")
    places, values = numbers("km", "length m"), numbers("value mm", "limit mm")
    table = titled(f"Exceedances: {len(exceedances)}", *places, what, *values, level)
    for row in exceedances.to_dict("records"):
        table.add_row(
            place_text(row),
            f"{row['length_m']:.2f}",
            Text(quantity_text(row)),
            value_text(row),
            f"{row['limit_mm']:.2f}",
            Text(row["level"]),
        )
    return table


def judgement_json(judgement: Judgement) -> str:
    """Return what each kilometre has, exceedances with the columns of the table, and what was not judged, as JSON."""
    not_judged = [
        {**limit.model_dump(exclude_defaults=True), "reason": reason} for limit, reason in judgement.not_judged
    ]
    kilometres = [
        {
            "km": kilometre.km,
            "exceedances": dict(kilometre.counts),
            "length_m": kilometre.length_m,
            "worst": kilometre.worst_text,
        }
        for kilometre in by_kilometre(by_severity(judgement.found))
    ]
    unknown = [
        {"quantity": quantity, "level": level, "length_m": length_m}
        for (quantity, level), length_m in judgement.unknown_m().items()
    ]
    content = {
        "by_km": kilometres,
        "exceedances": records(judgement.found),
        "not_judged": not_judged,
        "unknown": unknown,
    }
    return json.dumps(content, indent=2)
