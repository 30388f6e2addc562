"""What a reader does with a page: sort and copy its tables, read its charts by keys, print it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from trackfg.geometry.limits import Limit
from trackfg.recording.line_kilometrage import KmEquation, LineKilometrage
from trackfg.report.result_page import result_page
from trackfg.report.track_limits import judge
from trackfg.results.result import Result

TWIST = Limit(standard="rule", level="alert", parameter="twist", base_m=5.0, kind="peak", value_mm=1.9)
SEVERE = TWIST.model_copy(update={"level": "stop", "value_mm": 1.99})
AXE = os.environ.get("AXE_CORE")
# Waits from outside the page: its content security policy forbids the conditions that playwright evaluates inside.
expect = pytest.importorskip("playwright.sync_api").expect
WAIT_MS = 30_000


@pytest.fixture(scope="module")
def shown(result: Result, open_page: Callable[[Path], Any], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    judgement = judge(result, [TWIST])
    page = result_page(result, "", None, judgement).write(tmp_path_factory.mktemp("page") / "report.html")
    opened = open_page(page)
    yield opened
    assert opened.said == []
    opened.tab.close()


ONE_BY_ONE = 1
"""The table of the exceedances, after that of the kilometres."""


def column(page: Any, section: str, number: int) -> list[str]:
    """The cells that are shown of the second table of a section."""
    texts: list[str] = (
        page.tab.locator(f"#{section} table")
        .nth(ONE_BY_ONE)
        .evaluate(
            "(table, k) => [...table.tBodies[0].rows].filter(r => !r.hidden).map(r => r.cells[k].textContent)", number
        )
    )
    return texts


def test_a_table_is_sorted_by_its_numbers_and_back(shown: Any) -> None:
    heading = shown.tab.locator("#limits table").nth(ONE_BY_ONE).locator("th button", has_text="km").first
    as_written = column(shown, "limits", 0)
    heading.focus()
    shown.tab.keyboard.press("Enter")
    ascending = [float(text) for text in column(shown, "limits", 0)]
    assert ascending == sorted(float(text) for text in as_written)
    assert shown.tab.locator("#limits th[aria-sort=ascending]").count() == 1
    heading.click()
    assert [float(text) for text in column(shown, "limits", 0)] == ascending[::-1]
    heading.click()
    assert column(shown, "limits", 0) == as_written


def test_a_table_is_filtered_and_copied_as_it_is_shown(shown: Any) -> None:
    shown.tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    rows = column(shown, "limits", 0)
    field = shown.tab.locator("#limits .tabletools input").first
    field.fill(rows[3])
    kept = column(shown, "limits", 0)
    assert rows[3] in kept
    assert len(kept) < len(rows)
    shown.tab.locator("#limits .tabletools").nth(ONE_BY_ONE).locator("button").click()
    expect(shown.tab.locator("#limits .tabletools output").nth(ONE_BY_ONE)).to_have_text("copied", timeout=WAIT_MS)
    text = shown.tab.evaluate("navigator.clipboard.readText()")
    assert text.splitlines()[0].startswith('km,quantity,"peak, mm"')
    field.fill("")


def test_keys_move_the_reading_and_the_window(shown: Any) -> None:
    shown.tab.locator("#geometry .plot").focus()
    whole = shown.tab.get_attribute("#geometry .chart", "data-shown")
    shown.tab.keyboard.press("+")
    shown.tab.wait_for_selector(f"#geometry .chart:not([data-shown='{whole}'])")
    shown.tab.keyboard.press("ArrowRight")
    expect(shown.tab.locator("#geometry [role=status]").first).not_to_be_empty(timeout=WAIT_MS)
    said = shown.tab.text_content("#geometry [role=status]")
    assert said.startswith("chainage ")
    assert "level estimate" in said
    shown.tab.keyboard.press("Escape")
    shown.tab.wait_for_selector(f"#geometry .chart[data-shown='{whole}']")


def test_the_axis_stays_in_sight(shown: Any) -> None:
    shown.tab.locator("#geometry .plot").evaluate(
        "plot => scrollTo(0, scrollY + plot.getBoundingClientRect().top + 200)"
    )
    box = shown.tab.locator("#geometry .head").bounding_box()
    assert 0 <= box["y"] < 60
    assert shown.tab.locator("#geometry .head .place.left").count() == 1


def test_on_paper_every_sheet_is_whole(shown: Any) -> None:
    shown.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    shown.tab.emulate_media(media="print")
    names = shown.tab.eval_on_selector_all(".sheet", "sheets => sheets.map(one => one.getAttribute('aria-label'))")
    assert ["Sheet 1 of 2" in names[0], "Sheet 2 of 2" in names[1]] == [True, True]
    heights = shown.tab.eval_on_selector_all(
        ".sheet, .chart:not(:has(> .sheets))", "all => all.map(one => one.getBoundingClientRect().height)"
    )
    assert max(heights) < 190.0 / 25.4 * 96.0  # of A4 across without margins
    beyond = shown.tab.eval_on_selector_all(
        ".sheet", "all => all.filter(one => one.getBBox().x < 0 || one.getBBox().width > 1108).length"
    )
    assert beyond == 0
    breaks = shown.tab.eval_on_selector_all(".sheet", "all => all.map(one => getComputedStyle(one).breakBefore)")
    assert breaks[:2] == ["auto", "page"]  # the heading is on the first sheet's page
    shown.tab.emulate_media(media="screen")
    shown.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert shown.tab.locator(".sheet").count() == 0


def redrawn_at(page: Any, width: int, until: Callable[..., None]) -> int:
    """Give the window another width; how often the first chart was drawn again for it."""
    drawn = "performance.getEntriesByName('chart ' + document.querySelector('#geometry .chart').dataset.chart).length"
    page.tab.evaluate("performance.clearMarks()")
    page.tab.set_viewport_size({"width": width, "height": 900})
    until(lambda: page.tab.evaluate(drawn) > 0)
    page.tab.wait_for_timeout(300.0)  # a second time would follow at once
    times: int = page.tab.evaluate(drawn)
    return times


def test_the_page_fits_a_phone(shown: Any, until: Callable[..., None]) -> None:
    redrawn_at(shown, 390, until)
    assert shown.tab.evaluate("document.documentElement.scrollWidth") <= 390
    redrawn_at(shown, 1280, until)


def test_a_phone_that_is_turned_draws_each_chart_once(shown: Any, until: Callable[..., None]) -> None:
    shown.tab.locator("#geometry .plot").focus()
    shown.tab.keyboard.press("ArrowRight")
    shown.tab.wait_for_selector("#geometry .plot[data-rows=all]")
    assert [redrawn_at(shown, width, until) for width in (390, 1280, 390, 1280)] == [1, 1, 1, 1]
    assert shown.tab.get_attribute("#geometry .plot", "data-rows") is None  # read when the pointer asks for them


def test_every_chart_says_in_words_what_it_shows(shown: Any) -> None:
    said = shown.tab.eval_on_selector_all(".chart .plot", "all => all.map(one => one.getAttribute('aria-label'))")
    assert len(said) >= 3
    assert all(len(text) > 20 for text in said)
    assert shown.tab.locator(".bars[role=img][aria-label*='SD of level']").count() == 1


@pytest.mark.skipif(AXE is None, reason="AXE_CORE names no axe.min.js; tools/page_audit.py gets one")
def test_axe_finds_no_violation(result: Result, browser: Any, tmp_path: Path) -> None:
    page = result_page(result, "", None, judge(result, [TWIST])).write(tmp_path / "report.html")
    context = browser.new_context(bypass_csp=True)
    tab = context.new_page()
    tab.goto(page.as_uri())
    tab.wait_for_selector("html[data-charts=drawn]")
    tab.evaluate(Path(str(AXE)).read_text(encoding="utf-8"))
    assert [rule["id"] for rule in tab.evaluate("axe.run(document)")["violations"]] == []
    context.close()


def test_an_exceedance_is_shaded_in_its_own_panel(shown: Any) -> None:
    panels = shown.tab.evaluate(
        "() => JSON.parse(document.getElementById('spec').textContent).charts[0].spans.map(one => one[3])"
    )
    labels = shown.tab.evaluate(
        "() => JSON.parse(document.getElementById('spec').textContent).charts[0].panels.map(one => one.label)"
    )
    assert {labels[i] for i in panels} == {"twist"}
    assert shown.tab.locator("#geometry .head .place.exceeded").count() > 0


@pytest.mark.slow
def test_the_axis_has_official_places_on_both_sides_of_a_jump(
    make_result: Callable[..., Result], open_page: Callable[[Path], Any], tmp_path: Path
) -> None:
    """At chainage 700 kilometrage jumps back by 250 m: some places are there twice."""
    equations = (KmEquation(chainage_m=0.0, km="12+000"), KmEquation(chainage_m=700.0, km="12+450"))
    line = LineKilometrage(line="L", equation=equations)
    opened = open_page(result_page(make_result(rows=1000), "", None, None, line).write(tmp_path / "a.html"))
    ticks = opened.tab.eval_on_selector_all("#geometry .axis text:not(.row)", "all => all.map(one => one.textContent)")
    assert {"12+200", "12+600", "13+000"} <= set(ticks)
    assert ticks.count("12+600") == 2
    shown = opened.tab.locator("#geometry .plot .nsewdrag").first
    shown.scroll_into_view_if_needed()
    box = shown.bounding_box()
    opened.tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 5.0)
    assert opened.tab.inner_text("#geometry .tools output") == "km 12+499.1"
    for width in (800, 390):  # official places are longer than chainages
        opened.tab.set_viewport_size({"width": width, "height": 900})
        bars = opened.tab.locator(".bars").evaluate_all(
            "all => all.map(one => [one.scrollWidth, one.getBoundingClientRect().width])"
        )
        assert bars
        assert all(content <= room + 1 for content, room in bars)
        assert all(room < width for _, room in bars)
    opened.tab.close()
