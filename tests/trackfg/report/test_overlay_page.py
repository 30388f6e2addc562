from __future__ import annotations

import pytest

from trackfg.report.runs.overlay_page import runs_chart
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
