"""What ``trackfg limits`` shows, as rich tables and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

from rich.console import RenderableType
from rich.text import Text

from trackfg.cli.tables import records
from trackfg.cli.terminal import titled
from trackfg.geometry.exceedances import Judgement
from trackfg.results.official_places import KM_COLUMN


def of_judgement(judgement: Judgement) -> Iterator[RenderableType]:
    """Yield the exceedances by chainage, and what could not be judged with the reason."""
    if judgement.found.empty:
        yield Text("No exceedance of the limits that could be judged.")
    else:
        yield _exceedances(judgement)
    if judgement.not_judged:
        table = titled("Not judged")
        for heading in ("limit", "class", "why"):
            table.add_column(heading, overflow="fold")
        for (quantity, reason), levels in judgement.not_judged_levels().items():
            table.add_row(Text(quantity), Text(levels), Text(reason))
        yield table


def _exceedances(judgement: Judgement) -> RenderableType:
    table = titled(f"Exceedances: {len(judgement.found)}")
    for heading in ("km", "from m", "to m", "length m"):
        table.add_column(heading, justify="right")
    for heading in ("quantity", "column"):
        table.add_column(heading, overflow="fold")
    for heading in ("value mm", "limit mm"):
        table.add_column(heading, justify="right")
    table.add_column("class", overflow="fold")
    for row in judgement.found.to_dict("records"):
        sigma = "" if math.isnan(row["value_mm_sd"]) else f" ± {row['value_mm_sd']:.2f}"
        table.add_row(
            row.get(KM_COLUMN) or f"{1e-3 * row['chainage_m']:.3f}",
            *(f"{row[name]:.2f}" for name in ("from_m", "to_m", "length_m")),
            Text(f"{row['parameter'].replace('_', ' ')}, {row['kind']}"),
            Text(row["column"]),
            f"{row['value_mm']:.2f}{sigma}",
            f"{row['limit_mm']:.2f}",
            Text(row["level"]),
        )
    return table


def judgement_json(judgement: Judgement) -> str:
    """Return exceedances with the columns of the table, and the limits that were not judged, as JSON."""
    not_judged = [
        {**limit.model_dump(exclude_defaults=True), "reason": reason} for limit, reason in judgement.not_judged
    ]
    return json.dumps({"exceedances": records(judgement.found), "not_judged": not_judged}, indent=2)
