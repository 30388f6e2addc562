"""The pages as a browser shows them, without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.report import write_report
from trackfg.results.result import Result

EVIL = "</script><script>window.evil = 1</script><img src=x onerror='window.evil = 2'><b>bold</b>"
Make = Callable[..., Result]
LINE = "document.querySelector('#geometry .plot').data.find((trace) => trace.yaxis === 'y' && trace.fill !== 'toself')"


@pytest.fixture(scope="module")
def shown(result_folder: Path, open_page: Callable[[Path], Any], tmp_path_factory: pytest.TempPathFactory) -> Iterator:
    page = open_page(write_report(result_folder, tmp_path_factory.mktemp("page") / "report.html"))
    yield page
    page.tab.close()


@pytest.fixture(autouse=True)
def whole_run(request: pytest.FixtureRequest) -> None:
    """Every test begins with the whole run in the charts."""
    if "shown" in request.fixturenames:
        tab = request.getfixturevalue("shown").tab
        tab.locator("#geometry .tools button").click()
        tab.wait_for_selector("#geometry .chart[data-shown^='0 ']")


def drawn(page: Any) -> tuple[np.ndarray, np.ndarray]:
    """Chainage and level as they are drawn, NaN in a gap."""
    x, y = page.tab.evaluate(f"[{LINE}.x, {LINE}.y]")
    return np.array(x), np.array(y, dtype=np.float64)


def zoom(page: Any, start: float, end: float) -> None:
    """By the fields above the chart."""
    for number, value in ((1, end), (0, start)):
        field = page.tab.locator("#geometry .tools input[type=text]").nth(number)
        field.fill(f"{value}")
        field.press("Tab")
    page.tab.wait_for_selector(f"#geometry .chart[data-shown='{start:g} {end:g}']")


def test_every_chart_is_drawn_without_a_word_or_a_request(shown: Any) -> None:
    charts = shown.tab.locator(".chart").count()
    assert charts >= 4
    assert shown.tab.locator(".chart[data-drawn=yes] .main-svg").count() >= charts
    assert shown.said == []
    assert all(url.startswith(("file:", "data:", "blob:")) for url in shown.asked)
    paths = shown.tab.eval_on_selector_all(
        "#geometry .js-line", "all => all.map((one) => one.getAttribute('d').length)"
    )
    assert sum(length > 1000 for length in paths) >= 9


def test_a_narrow_axis_has_two_places_or_more(shown: Any) -> None:
    """The round step above a third of what is shown, 500 m, would leave one."""
    tab, size = shown.tab, shown.tab.viewport_size
    tab.set_viewport_size({"width": 400, "height": 800})
    zoom(shown, 105, 854)
    marks = tab.locator("#geometry .axis text:not(.row)").all_text_contents()  # names of curves are among them
    assert sum(mark.isdecimal() for mark in marks) >= 2
    tab.set_viewport_size(size)


def test_no_horizontal_scrolling(shown: Any) -> None:
    assert shown.tab.evaluate("document.documentElement.scrollWidth") <= 1280


def test_the_wide_view_is_thinned_and_loses_no_peak_and_no_gap(shown: Any, result_folder: Path) -> None:
    rows = len(Result.read(result_folder).geometry)
    x, y = drawn(shown)
    assert len(x) < 0.6 * rows
    assert np.nanmax(y) == pytest.approx(9.0, abs=0.01)
    assert np.isnan(y[(x > 701.0) & (x < 749.0)]).all()
    assert np.isnan(y).any()


def test_zooming_shows_every_row(shown: Any, result_folder: Path) -> None:
    table = Result.read(result_folder).geometry
    x, _ = drawn(shown)
    before = np.count_nonzero((x >= 280.0) & (x <= 320.0))
    zoom(shown, 280, 320)
    x, y = drawn(shown)
    expected = table[table["chainage_m"].between(280.0, 320.0)]
    inside = (x >= 280.0) & (x <= 320.0)
    assert before < 0.7 * len(expected)
    np.testing.assert_allclose(x[inside], expected["chainage_m"], atol=1e-6)
    np.testing.assert_allclose(y[inside], expected["level_mm"], atol=0.005)  # a twentieth of sigma
    assert shown.said == []


def test_dragging_zooms_and_a_double_click_goes_back(shown: Any, until: Callable[..., None]) -> None:
    shown.tab.locator("#geometry .plot").scroll_into_view_if_needed()
    box = shown.tab.locator("#geometry .plot .nsewdrag").first.bounding_box()
    y = box["y"] + box["height"] / 2.0
    whole = shown.tab.get_attribute("#geometry .chart", "data-shown")
    shown.tab.mouse.move(box["x"] + 0.2 * box["width"], y)
    shown.tab.mouse.down()
    shown.tab.mouse.move(box["x"] + 0.3 * box["width"], y, steps=4)
    shown.tab.mouse.up()
    shown.tab.wait_for_selector(f"#geometry .chart:not([data-shown='{whole}'])")
    start, end = map(float, shown.tab.get_attribute("#geometry .chart", "data-shown").split())
    assert (start, end) == pytest.approx((300.0, 449.0), abs=6.0)
    x, _ = drawn(shown)
    assert np.diff(x[(x > start) & (x < end)]).max() == pytest.approx(0.25)

    def double_clicked_back() -> bool:
        """On a busy machine two clicks may be too far apart to be a double click: again, as a reader would."""
        shown.tab.mouse.dblclick(box["x"] + 0.5 * box["width"], y)
        shown.tab.wait_for_timeout(500)
        return bool(shown.tab.get_attribute("#geometry .chart", "data-shown") == whole)

    until(double_clicked_back)


def test_vertical_scales_follow_when_asked(shown: Any, until: Callable[..., None]) -> None:
    scale = "document.querySelector('#geometry .plot').layout.yaxis.range"
    zoom(shown, 800, 810)
    fixed = shown.tab.evaluate(scale)
    box = shown.tab.locator("#geometry .tools input[type=checkbox]")
    box.check()
    until(lambda: np.ptp(shown.tab.evaluate(scale)) < 0.8 * np.ptp(fixed))
    box.uncheck()
    until(lambda: shown.tab.evaluate(scale) == fixed)


def test_the_pointer_reads_the_value_of_the_row(shown: Any, result_folder: Path) -> None:
    table = Result.read(result_folder).geometry
    zoom(shown, 100, 140)
    shown.tab.locator("#geometry .plot").scroll_into_view_if_needed()
    box = shown.tab.locator("#geometry .plot .nsewdrag").first.bounding_box()
    shown.tab.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 5.0)
    name, place, unit = shown.tab.inner_text("#geometry .tools output").split()
    assert (name, float(place), unit) == ("chainage", pytest.approx(110.0, abs=0.06), "m")
    value, sigma = shown.tab.locator("#geometry .reading").first.inner_text().split(" ± ")
    (row,) = table[table["chainage_m"] == 110.0].itertuples()
    assert float(value) == pytest.approx(row.level_mm, abs=0.01)
    assert float(sigma) == pytest.approx(0.1)
    shown.tab.mouse.move(5.0, 5.0)
    assert shown.tab.locator("#geometry .reading").first.inner_text() == ""


def test_hostile_names_are_only_text(make_result: Make, open_page: Callable[[Path], Any], tmp_path: Path) -> None:
    finding = {"level": "warning", "code": "x", "message": EVIL, "file": EVIL}
    result = make_result(
        recording_id=EVIL, noise_ratios={EVIL: 1.0}, findings=(finding,), configuration={EVIL: {EVIL: EVIL}}
    )
    result.events["kind"] = EVIL
    result.events["detail"] = EVIL
    page = open_page(write_report(result.write(tmp_path / "out"), tmp_path / "report.html"))
    assert page.tab.inner_text("h1") == EVIL
    assert page.tab.evaluate("window.evil") is None
    assert page.tab.locator("img, b, svg a").count() == 0
    assert EVIL in page.tab.locator("#consistency .plot").text_content()
    assert page.said == []
    page.tab.close()


def test_next_to_nothing(make_result: Make, open_page: Callable[[Path], Any], tmp_path: Path) -> None:
    """One row of everything, and no value in it."""
    result = make_result(rows=2)
    table = result.geometry.iloc[:1].copy()
    table.loc[:, table.columns[3:]] = np.nan
    small = replace(result, trajectory=result.trajectory.iloc[:1], geometry=table, events=result.events.iloc[:0])
    page = open_page(write_report(small.write(tmp_path / "out"), tmp_path / "report.html"))
    assert page.said == []
    assert page.tab.locator(".failed").count() == 0
    page.tab.close()


def test_on_paper_charts_have_the_width_of_the_sheet(
    result_folder: Path, open_page: Callable[[Path], Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    page = open_page(write_report(result_folder, tmp_path / "report.html"))
    page.tab.set_viewport_size({"width": 1900, "height": 900})
    width = "document.querySelector('#geometry .main-svg').getBoundingClientRect().width"
    until(lambda: page.tab.evaluate(width) > 1350)
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    until(lambda: page.tab.evaluate(width) == 1230)
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    until(lambda: page.tab.evaluate(width) > 1350)
    assert page.said == []
    page.tab.close()


def test_a_comparison(
    comparison_folder: Path, open_page: Callable[[Path], Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    page = open_page(write_report(comparison_folder, tmp_path / "report.html"))
    assert page.said == []
    assert page.tab.locator(".chart[data-drawn=yes]").count() == page.tab.locator(".chart").count() >= 5
    assert page.tab.evaluate("document.documentElement.scrollWidth") <= 1280
    assert page.tab.locator("tr.bad").count() >= 2
    plot = "document.querySelectorAll('#curves .plot')[0]"
    names = page.tab.evaluate(f"{plot}.data.filter((trace) => trace.showlegend).map((trace) => trace.name)")
    assert names == ["truth", "smoother", "rival"]
    page.tab.locator("#curves .plot").first.locator(".legendtoggle").nth(2).click()
    until(lambda: page.tab.evaluate(f"{plot}.data.find((trace) => trace.name === 'rival').visible") == "legendonly")
    page.tab.close()
