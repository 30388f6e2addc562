"""The pages of a store: what is answered to which address, and what a browser shows."""

from __future__ import annotations

import http.client
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.cli.browse.pages import StorePages, handler_of
from trackfg.cli.browse.sections import StoredSections
from trackfg.errors import BadInputError
from trackfg.fleet.batch_progress import batch_states, shown_progress
from trackfg.fleet.catalogue import Run
from trackfg.fleet.key_figures import SCHEMA, done_row, failed_row
from trackfg.fleet.store import Store
from trackfg.report.store.line_colours import Aspect, coloured_lines
from trackfg.results.result import Result
from trackfg.streaming.view.local_server import serving_locally

EVIL = "<b>evil</b>"
WAIT_MS = 180_000
"""For a browser on a machine that is busy otherwise."""
GROWTH_MM = 0.5


@pytest.fixture(scope="module")
def store(make_result: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Line 7 with six runs of 1.5 km, a month apart, in which the twist between 400 and 600 m grows; line 8 with one
    run; a run that failed."""
    made = Store(tmp_path_factory.mktemp("fleet") / "store")
    rng, rows = np.random.default_rng(0), []
    for number, line in enumerate(["7"] * 6 + ["8"]):
        name = f"run{number}"
        facts = {
            "start": f"2026-0{number + 1}-05T03:12:00Z",
            "content_sha256": f"{number:064x}",
            "files_sha256": f"{number:064x}",
            "direction": 1,
            "anchored": True,
            "mount_roll_sd_rad": 0.0,
        }
        result = make_result(rows=1000, recording_id=name, run=facts)
        geometry = result.geometry
        geometry["twist_mm"] += 0.02 * rng.standard_normal(len(geometry))
        grown = geometry["chainage_m"].between(400.0, 600.0)
        geometry.loc[grown, "twist_mm"] *= 1.0 + GROWTH_MM * number
        result.write(Path(made.result(name)))
        rows.append(
            done_row(
                Run(name, f"/recordings/{name}", line, tags="night" if number % 2 else "day"), Path(made.result(name))
            )
        )
    rows.append(failed_row(Run("broken", "/recordings/broken", "7"), f"imu.csv: {EVIL}", "last words"))
    made.write(rows)
    return made


@pytest.fixture(scope="module")
def address(store: Store) -> Iterator[str]:
    with serving_locally(handler_of(StorePages(store.place)), port=0) as address:
        yield address


def page(store: Store, path: str) -> str:
    answer = StorePages(store.place).answer(path)
    assert answer.status == 200
    return answer.content.decode()


def rows_of(html: str) -> list[str]:
    return re.findall(r'href="/run\?run=(\w+)"', html)


def test_runs_are_chosen(store: Store) -> None:
    assert rows_of(page(store, "/")) == ["run6", "run5", "run4", "run3", "run2", "run1", "run0", "broken"]
    assert rows_of(page(store, "/?line=8")) == ["run6"]
    assert rows_of(page(store, "/?since=2026-03&until=2026-04")) == ["run3", "run2"]
    assert rows_of(page(store, "/?state=failed")) == ["broken"]
    assert rows_of(page(store, "/?text=night+recordings")) == ["run5", "run3", "run1"]
    assert rows_of(page(store, "/?state=slips&page=7")) == ["run6", "run5", "run4", "run3", "run2", "run1", "run0"]
    assert "No run is as asked for" in page(store, "/?text=nothing")
    assert EVIL not in page(store, "/run?run=broken")
    assert "last words" in page(store, "/run?run=broken")


def test_growth_stands_where_it_is(store: Store) -> None:
    html = page(store, "/line?line=7")
    cells = dict(
        re.findall(
            r"<title>km (\S+) to \S+: (\S+) mm a month</title>",
            html.partition("growth of SD of twist")[2].partition("</svg>")[0],
        )
    )
    assert set(cells) == {"0.000", "0.200", "0.400", "0.600", "0.800", "1.000", "1.200"}
    # The twist is a sine of 2 mm, whose standard deviation is 2 / sqrt(2).
    assert float(cells.pop("0.400")) == pytest.approx(GROWTH_MM * np.sqrt(2.0), rel=0.05)
    assert max(map(float, cells.values())) < 0.01


def test_colours_of_growth_reach_down_to_the_least_trend() -> None:
    sections = pd.DataFrame({"from_m": 200.0 * np.arange(6), "to_m": 200.0 * np.arange(1, 7)})
    sections["twist_mm_per_month"] = [-0.3, 0.05, 0.11, 0.3, 5.0, np.nan]
    sections["twist_mm_per_month_sd"] = 0.01
    (bar,) = coloured_lines({"7": sections}, Aspect("twist_mm", growth=True))
    assert [cell.step for cell in bar.rows[0].cells] == [0, 0, 1, 2, 4, -1]
    assert bar.rows[0].legend == "below 0.1 to 0.8 mm a month and more"


def test_what_is_not_there_is_said(store: Store, tmp_path: Path) -> None:
    pages = StorePages(store.place)
    for path in ("/nothing", "/line?line=9", "/run?run=none", "/section?line=7&from=here", "/../store.json"):
        assert pages.answer(path).status == 404
    assert pages.answer("//[").status == 500
    assert "No run covers this section" in page(store, "/section?line=7&from=90000")
    with pytest.raises(BadInputError, match="expected a store"):
        StorePages(str(tmp_path))
    with pytest.raises(BadInputError, match="is a result; expected a store"):
        StorePages(store.result("run0"))


def test_a_result_that_cannot_be_read_is_said(make_result: Callable[..., Result], tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    make_result(recording_id="short").write(Path(store.result("short")))
    store.write([done_row(Run("short", "/recordings/short", "7"), Path(store.result("short")))])
    assert "No run covers a section of 200 m" in page(store, "/line?line=7")
    (Path(store.result("short")) / "geometry.parquet").write_bytes(b"PAR1 and nothing else")
    answer = StorePages(store.place).answer("/run?run=short")
    assert answer.status == 500
    assert b"results/short: not a readable trackfg result" in answer.content
    assert StorePages(store.place).answer("/").status == 200


def test_a_section_marks_runs_that_are_not_to_be_trusted(make_result: Callable[..., Result], tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    doubted = {"quantity": "twist", "status": "not_trusted", "factor": None, "reasons": ["seen"], "hints": ["do"]}
    rows = []
    for name, verdicts in (("good", []), ("bad", [doubted])):
        make_result(rows=1000, recording_id=name, verdicts=verdicts).write(Path(store.result(name)))
        rows.append(done_row(Run(name, f"/recordings/{name}", "7"), Path(store.result(name))))
    store.write(rows)
    html = page(store, "/section?line=7&from=200")
    assert "bad, not to be trusted in this run: twist." in html
    assert "bad (doubted)" in html
    assert "good (doubted)" not in html


@pytest.mark.parametrize("name", ["geometry.parquet", "summary.json"])
def test_a_result_is_checked_before_it_is_shown(name: str, make_result: Callable[..., Result], tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    make_result(recording_id="short").write(Path(store.result("short")))
    store.write([done_row(Run("short", "/recordings/short", "7"), Path(store.result("short")))])
    file = Path(store.result("short")) / name
    if name == "summary.json":
        file.unlink()
        os.mkfifo(file)
    else:
        table = pd.read_parquet(file)
        table.assign(twist_mm=table["twist_mm"].astype(str) + "x").to_parquet(file)
    pages = StorePages(store.place)
    assert pages.answer("/section?line=7&from=0").status == 500
    assert pages.answer("/").status == pages.answer("/progress").status == 200


@pytest.mark.parametrize("damage", ["bytes", "no run"])
def test_a_catalogue_that_cannot_be_read_is_said(damage: str, store: Store, tmp_path: Path) -> None:
    place = tmp_path / "store"
    shutil.copytree(store.place, place)
    file = next(place.rglob("runs.parquet"))
    if damage == "bytes":
        file.write_bytes(b"PAR1 and nothing else")
    else:
        pd.read_parquet(file).assign(run=None).to_parquet(file)
    for path in ("/", "/progress", "/line?line=7"):
        answer = StorePages(str(place)).answer(path)
        assert answer.status == 500
        assert b"runs.parquet: not a readable catalogue of runs" in answer.content


def test_an_empty_store_has_a_page(tmp_path: Path) -> None:
    assert "No run is as asked for" in page(Store(tmp_path / "store"), "/")


def test_a_page_is_reloaded_where_a_run_was_computed_again(make_result: Callable[..., Result], tmp_path: Path) -> None:
    made = Store(tmp_path / "store")
    facts = {"content_sha256": "0" * 64, "direction": 1, "anchored": True, "mount_roll_sd_rad": 0.0}
    make_result(run=facts).write(Path(made.result("run0")))
    row = done_row(Run("run0", "/recordings/run0", "7"), Path(made.result("run0")))
    made.write([row])
    asked = re.search(r"/progress\?seen=[\w-]+", page(made, "/"))
    assert asked is not None
    wanted = [json.loads(page(made, asked[0]))["reload"]]
    made.read(["run"])
    made.write([{**row, "slips": 3}])
    wanted.append(json.loads(page(made, asked[0]))["reload"])
    assert wanted == [False, True]


def test_progress_of_batches(store: Store) -> None:
    pages = StorePages(store.place)
    assert json.loads(pages.answer("/progress").content)["text"] == "No batch is running."
    with shown_progress(store.place, 200):
        assert re.search(r"Batch \S+: 0 of 200 runs\.", json.loads(pages.answer("/progress").content)["text"])
        (state,) = batch_states(store.place)
        assert not state.lost(state.news_s + 30.0)
        assert state.lost(state.news_s + 3600.0)
    assert batch_states(store.place) == []


def test_a_killed_batch_is_distinguished_from_a_running_one(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    state = {"name": "host-1", "began_s": 0.0, "news_s": 600.0, "runs": 200, "done": 50, "failed": 2}
    (tmp_path / "store" / "progress").mkdir()
    (tmp_path / "store" / "progress" / "host-1.json").write_text(json.dumps(state))
    (tmp_path / "store" / "progress" / "host-2.json").write_text("half")
    (known,) = batch_states(store.place)
    assert (known.runs_per_minute, known.remaining_s) == (5.0, 1800.0)
    assert "ended before it was done: 50 of 200 runs" in page(store, "/")
    with shown_progress(store.place, 1):
        assert len(batch_states(store.place)) == 1  # the next batch clears it away
    assert batch_states(store.place) == []


def test_a_batch_clears_away_what_a_killed_one_had_begun_to_write(store: Store) -> None:
    folder = Path(store.place) / "progress"
    folder.mkdir(exist_ok=True)
    (folder / "elsewhere-7.json").write_text('{"name": "elsewhere-7", "beg')
    assert batch_states(store.place) == []
    with shown_progress(store.place, 1):
        assert [path.name for path in folder.iterdir()] == [f"{batch_states(store.place)[0].name}.json"]
    assert list(folder.iterdir()) == []


def asked(address: str, path: str, *, method: str = "GET", host: str | None = None) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection(address.removeprefix("http://").rstrip("/"), timeout=1e-3 * WAIT_MS)
    connection.request(method, path, headers={} if host is None else {"Host": host})
    return connection.getresponse()


def test_who_may_ask_for_what(address: str) -> None:
    answer = asked(address, "/")
    assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    html = answer.read().decode()
    assert "default-src &#39;none&#39;" in html
    assert not re.findall(r"""(src|href)=["']?(https?:)?//""", html)
    assert asked(address, "/", host="evil.example").status == 403
    assert asked(address, "/", method="POST").status == 501


def test_sections_are_those_of_the_known_line_that_a_run_was_smoothed_with(store: Store) -> None:
    rows = [row for row in store.read(SCHEMA.names) if row["run"] == "run6"]
    sections = StoredSections(store)
    assert sections.read(rows) == 0
    assert list(sections.lines(rows)) == ["8"]
    assert sections.lines([{**row, "known_line": "another"} for row in rows]) == {}


def follow(tab: Any, link: str) -> None:
    """Open what a link or a button leads to. A click with the mouse waits for two frames, and a browser without a
    screen may draw none."""
    with tab.expect_navigation():
        tab.locator(link).dispatch_event("click")
    tab.wait_for_selector("html[data-charts=drawn]")


def test_a_browser_goes_from_the_store_to_a_report(browser: Any, address: str, until: Callable[..., None]) -> None:
    expect = pytest.importorskip("playwright.sync_api").expect
    tab, faults, urls = browser.new_page(viewport={"width": 1280, "height": 900}), [], []
    tab.set_default_timeout(WAIT_MS)
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("request", lambda request: urls.append(request.url))
    tab.goto(address)
    expect(tab.locator(".latest")).to_contain_text("No batch is running.", timeout=WAIT_MS)
    tab.select_option("select[name=line]", "7")
    tab.select_option("select[name=colour]", "twist_mm_per_month")
    follow(tab, "form button")
    assert "line=7" in tab.url
    assert tab.locator("#lines .bars").count() == 1
    assert tab.locator("#lines svg rect.step3").count() == 1
    tab.locator("#runs input[type=search]").fill("day")
    expect(tab.locator("#runs tbody tr:visible")).to_have_count(3, timeout=WAIT_MS)
    follow(tab, "#lines .barname a")
    follow(tab, "#sections td a >> text=0.400")
    assert tab.inner_text("h1") == "line 7, km 0.400 to 0.600"
    expect(tab.locator("#runs .chart[data-drawn=yes]")).to_have_count(1, timeout=WAIT_MS)
    lines = "document.querySelector('#runs .plot').data.filter((trace) => trace.yaxis === 'y').length"
    assert tab.evaluate(lines) >= 6
    expect(tab.locator("#history tbody tr")).not_to_have_count(0, timeout=WAIT_MS)
    across = "document.documentElement.scrollWidth"
    resized = browser.new_page()
    resized.goto(tab.url)
    for width in (1400, 800, 390):
        resized.set_viewport_size({"width": width, "height": 800})
        until(lambda width=width: resized.evaluate(across) <= width, within_s=1e-3 * WAIT_MS)
    resized.close()
    follow(tab, "#history td a >> text=run3")
    assert tab.inner_text("h1") == "run3"
    follow(tab, "header a >> text=all runs")
    assert faults == []
    assert all(url.startswith((address, "data:", "blob:")) for url in urls)
    tab.close()


def test_an_open_page_shows_a_batch_that_begins(browser: Any, store: Store, address: str) -> None:
    expect = pytest.importorskip("playwright.sync_api").expect
    tab = browser.new_page()
    tab.set_default_timeout(WAIT_MS)
    tab.goto(address)
    expect(tab.locator(".latest")).to_contain_text("No batch is running.", timeout=WAIT_MS)
    with shown_progress(store.place, 50):
        expect(tab.locator(".latest")).to_contain_text("0 of 50 runs", timeout=WAIT_MS)
    expect(tab.locator(".latest")).to_contain_text("No batch is running.", timeout=WAIT_MS)
    tab.close()


def test_the_command_serves_it(store: Store) -> None:
    command = [sys.executable, "-m", "trackfg", "browse", store.place, "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        address = process.stderr.readline().removeprefix("browse: ").strip()
        assert b"run6" in asked(address, "/").read()
        process.send_signal(2)
        assert process.wait() == 0
