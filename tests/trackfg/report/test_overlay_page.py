from __future__ import annotations

import pandas as pd
import pytest

from trackfg.mapping.runs.run_alignment import SHIFT_COLUMNS
from trackfg.mapping.runs.run_overlay import DIFFERENCE_COLUMNS, RunOverlay
from trackfg.report.runs.overlay_page import overlay_page, runs_chart
from trackfg.results.columns import RAIL_COLUMNS
from trackfg.results.result import Result


@pytest.mark.parametrize("rails_first", [False, True])
def test_runs_of_rails_and_of_the_centre_line_share_a_chart(result: Result, rails_first: bool) -> None:
    """Both have the centre line; the one with lasers has each rail besides."""
    centre, rails = result.geometry, result.geometry.assign(**dict.fromkeys(RAIL_COLUMNS, 1.0))
    tables = (rails, centre) if rails_first else (centre, rails)
    colours = {"one": "#000", "two": "#fff"}
    chart = runs_chart(colours, tables, (0.0, 100.0), first_wide=True)
    lines = {panel.label: [(line.name, line.wide) for line in panel.lines] for panel in chart.panels}
    assert list(lines)[:4] == ["level", "alignment", "level\nleft rail", "level\nright rail"]
    assert lines["level"] == lines["twist"] == [("one", True), ("two", False)]
    assert lines["level\nleft rail"] == ([("one", True)] if rails_first else [("two", False)])


def test_a_run_that_is_not_to_be_trusted_is_marked(result: Result) -> None:
    shifts = pd.DataFrame([("bad", 0.0, 100.0)], columns=["run", "from_m", "to_m"])
    shifts = shifts.reindex(columns=list(SHIFT_COLUMNS), fill_value=0.1)
    differences = pd.DataFrame(columns=list(DIFFERENCE_COLUMNS))
    overlay = RunOverlay(("good", "bad"), shifts, (result.geometry, result.geometry), differences)
    html = overlay_page(overlay, "trackfg overlay", {"good": "", "bad": "twist"}).html()
    assert "bad, not to be trusted in this run: twist." in html
    assert "bad (doubted)" in html
    assert "good (doubted)" not in html
