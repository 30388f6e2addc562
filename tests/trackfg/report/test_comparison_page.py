from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.comparison.table import Comparison
from trackfg.report.charts import Figure, Strips
from trackfg.report.comparison_charts import by_speed, case_curves, colours, run_times
from trackfg.report.comparison_page import comparison_page
from trackfg.report.comparison_tables import beaten_table, score_table, verdict_on

COLOURS = colours(["smoother", "rival"])


def without_rows(comparison: Comparison, *estimators: str) -> Comparison:
    rows = tuple(row for row in comparison.about.rows if row.estimator not in estimators)
    return replace(comparison, about=comparison.about.model_copy(update={"rows": rows}))


def test_where_the_smoother_is_beaten_is_said_at_the_top(comparison: Comparison) -> None:
    page = comparison_page(comparison, "trackfg report cmp")
    assert [section.name for section in page.sections[:2]] == ["best", "beaten"]
    table = beaten_table(comparison.about)
    assert table.headings[0] == "quantity"  # of one case, which the page names
    rows = [row.cells for row in table.rows]
    assert [(cells[0], cells[1], cells[2], cells[-1]) for cells in rows] == [
        ("twist, mm", "all", "rival", "yes"),
        ("versine of level, mm", "10 – 15", "rival", "may be chance"),
    ]
    assert float(rows[0][table.headings.index("ratio")]) == pytest.approx(0.75, abs=0.01)


def test_where_it_is_not_beaten_that_is_said(comparison: Comparison) -> None:
    worse = tuple(row for row in comparison.about.rows if not row.beats_the_smoother)
    page = comparison_page(replace(comparison, about=comparison.about.model_copy(update={"rows": worse})), "")
    others = sum(row.to_smoother is not None for row in worse)
    assert others > 0
    assert "Nowhere: in every quantity" in page.html()
    assert f"({others} score" in page.html()
    alone = comparison_page(without_rows(comparison, "rival"), "").html()
    assert "No published system has a score beside one of the smoother" in alone
    assert "Nowhere" not in alone


def test_parts_of_one_run_say_nothing_of_other_runs(comparison: Comparison) -> None:
    row = next(row for row in comparison.about.rows if row.to_smoother_interval is not None)
    row = row.model_copy(update={"to_smoother": 3.0, "to_smoother_interval": (2.0, 4.0)})
    assert verdict_on(row) == "the smoother is better: the whole interval is above 1"
    assert verdict_on(row, parts=True).endswith("is above 1; other runs may differ")


def test_one_table_per_task(comparison: Comparison) -> None:
    page = comparison_page(comparison, "trackfg report cmp")
    titles = [section.title for section in page.sections]
    assert titles[3:6] == ["Attitude and cross-level", "Twist", "Versines"]
    group, first, second = score_table(comparison.about, "twist").rows
    assert group.cells == ("twist, mm (RMS)",)
    assert (first.cells[0], first.mark, first.cells[-1]) == ("rival", "bad", "better than the smoother")
    assert (second.cells[0], second.mark, second.cells[-1]) == ("smoother", "own", "")
    assert second.cells[6] == "0.500"  # 2 s over 4 km


def test_what_was_left_out_has_its_reason(comparison: Comparison) -> None:
    assert "no lasers on this car" in comparison_page(comparison, "").html()


def test_error_over_speed(comparison: Comparison) -> None:
    figure = by_speed(comparison.about.rows, "car", COLOURS)
    assert isinstance(figure, Figure)
    smoother, rival = figure.traces
    assert smoother["x"] == rival["x"] == [12.5, 17.5]
    assert rival["y"] == pytest.approx([0.29, 0.9])
    assert "a line each for smoother, rival;" in figure.alternative
    assert by_speed(comparison.about.rows, "another", COLOURS) is None


def test_run_times(comparison: Comparison) -> None:
    figure = run_times(comparison.about.rows, COLOURS)
    assert figure is not None
    assert figure.traces[0]["x"] == [0.5, 0.5]
    assert run_times((), COLOURS) is None


def test_curves_of_one_run(comparison: Comparison) -> None:
    found = case_curves(comparison, "car", COLOURS)
    assert isinstance(found.geometry, Strips)
    (twist,) = found.geometry.panels
    assert [line.name for line in twist.lines] == ["truth", "smoother", "rival"]
    assert isinstance(found.errors, Strips)
    (errors,) = found.errors.panels
    assert [line.sigma is not None for line in errors.lines] == [True, False]
    assert isinstance(found.over_time, Strips)
    (roll,) = found.over_time.panels
    assert roll.y_range is not None
    assert roll.y_range[1] < 5.0  # the rival's offset of 40 mrad is unknown to all, and left out
    assert "less its mean" in roll.label


def test_a_comparison_of_recordings_without_truth(comparison: Comparison) -> None:
    table = comparison.geometry[comparison.geometry["estimator"] != "truth"].drop(columns="twist_mm_error")
    page = comparison_page(replace(comparison, geometry=table, positions=pd.DataFrame()), "")
    assert [chart.legend for chart in page.charts() if isinstance(chart, Strips)] == [True]


def test_hostile_names(comparison: Comparison) -> None:
    evil = "<script>window.evil = 1</script>"
    about = comparison.about
    rows = tuple(row.model_copy(update={"estimator": evil} if row.estimator == "rival" else {}) for row in about.rows)
    estimators = {"smoother": "a", evil: evil}
    table = comparison.geometry.replace({"estimator": {"rival": evil}})
    changed = about.model_copy(update={"rows": rows, "estimators": estimators})
    html = comparison_page(replace(comparison, about=changed, geometry=table), evil).html()
    assert "<script>window.evil" not in html
    assert re.search(r"\\u0026lt;script", html)  # in the charts' data, twice escaped


def test_a_colour_for_everybody() -> None:
    found = colours(["smoother", *(f"rival {i}" for i in range(20))])
    assert len(found) == 21
    assert len(set(found.values())) > 15
    assert not np.any([value == found["smoother"] for name, value in found.items() if name != "smoother"])
