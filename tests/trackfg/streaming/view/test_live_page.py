"""The page of a running stream: the state it receives, the requests it answers, and what a browser shows."""

from __future__ import annotations

import http.client
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.errors import OutputError
from trackfg.results.events import Event
from trackfg.streaming.estimates import NO_ESTIMATES
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.run import Stream, StreamStep
from trackfg.streaming.sinks.sink import Callback
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.view.live_server import serving
from trackfg.streaming.view.live_state import LiveState


@pytest.fixture(scope="module")
def steps() -> list[StreamStep]:
    """What a minute and a half of a measuring car lead to."""
    found: list[StreamStep] = []
    source = RecordingSource(simulate("measuring-car", seed=0, duration_s=90.0).recording, batch_s=1.0)
    stream = Stream.of(source, FixedLagSmoother(source.description, lag_s=5.0))
    stream.clock = lambda: 0.0  # no delay but the rows' own
    stream.run(Callback(lambda table, frame: None), watch=found.append)
    return found


def test_steps_say_how_late_estimates_are(steps: list[StreamStep]) -> None:
    delays = [step.delay_s for step in steps if step.delay_s is not None]
    assert len(delays) > 20
    assert max(delays) > 0.5  # a second of rows comes at once
    assert all(0.0 <= delay < 5.0 for delay in delays)
    done = [step.done for step in steps if step.done is not None]
    assert done == sorted(done)
    assert done[-1] == 1.0


def test_a_page_gets_everything_and_then_what_is_new(steps: list[StreamStep]) -> None:
    state = LiveState("run", 5.0)
    for step in steps[:-5]:
        state.watch(step)
    count, whole = state.everything()
    message = json.loads(whole)
    rows = sum(len(step.estimates.filtered) for step in steps[:-5])
    assert len(message["whole"]["time"]) == rows
    assert len(message["whole"]["time"][0]) == len(message["columns"]["time"])
    cells = sum(len(step.estimates.geometry) for step in steps[:-5])
    assert len(message["whole"]["place"]) == (cells + 1) // 2
    for step in steps[-5:]:
        state.watch(step)
    news = state.since(count, 0.0)
    assert news is not None
    assert len(news[1]) == 5
    for _ in range(300):
        state.watch(StreamStep(NO_ESTIMATES, (), None, None))
    assert state.since(count, 0.0) is None  # too far behind: everything is sent again


def asked(address: str, path: str, *, method: str = "GET", host: str | None = None) -> http.client.HTTPResponse:
    match = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/", address)
    assert match is not None
    connection = http.client.HTTPConnection("127.0.0.1", int(match[1]), timeout=10.0)
    connection.request(method, path, headers={} if host is None else {"Host": host})
    return connection.getresponse()


def test_who_may_ask_for_what() -> None:
    with serving(LiveState("run", 5.0), port=0) as address:
        page = asked(address, "/")
        assert (page.status, page.headers["Content-Type"]) == (200, "text/html; charset=utf-8")
        assert "default-src 'none'" in page.headers["Content-Security-Policy"]
        assert not re.findall(rb"https?://", page.read())
        assert asked(address, "/live.js").status == asked(address, "/live.css").status == 200
        assert asked(address, "/../live_state.py").status == 404
        assert asked(address, "/", host="evil.example").status == 403
        assert asked(address, "/", method="POST").status == 501
        port = int(address.rstrip("/").rpartition(":")[2])
        with pytest.raises(OutputError, match="another port, by --port"), serving(LiveState("b", 1.0), port):
            pass


def test_a_browser_shows_the_stream_and_finds_it_again(
    browser: Any, steps: list[StreamStep], until: Callable[..., None]
) -> None:
    expect = pytest.importorskip("playwright.sync_api").expect
    page, faults = browser.new_page(viewport={"width": 1280, "height": 900}), []
    page.on("pageerror", lambda error: faults.append(str(error)))
    state = LiveState("run <b>7</b>", 5.0)
    with serving(state, port=0) as address:
        page.goto(address)
        expect(page.locator("#state")).to_have_text(re.compile("running"))
        assert page.inner_text("#title") == "run <b>7</b>"
        for step in steps:
            state.watch(step)
        state.watch(StreamStep(NO_ESTIMATES, (Event("slip", t_s=12.0, detail="<i>wheel</i>"),), None, None))
        page.wait_for_selector("#strip-place-cross_level_mm .curve")
        expect(page.locator("#events")).to_contain_text("<i>wheel</i>")
        labels = [svg.get_attribute("aria-label") for svg in page.query_selector_all("svg[role=img]")]
        assert len(labels) >= 8
        assert all(re.search(r": -?[\d.]+", label) for label in labels)
        last = steps[-1].estimates.filtered if len(steps[-1].estimates.filtered) else None
        shown = page.inner_text("#now")
        assert "km/h" in shown
        assert last is None or f"{last['t_s'].iloc[-1]:.1f} s" in shown
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        assert page.inner_text("#pause") == "Go on"
        page.keyboard.press("Enter")
    expect(page.locator("#state")).to_have_text("the stream has ended")
    with serving(LiveState("again", 5.0), port=int(address.rstrip("/").rpartition(":")[2])):
        expect(page.locator("#title")).to_have_text("again", timeout=15_000)
        expect(page.locator("#events tr")).to_have_count(0)
    for width in (1400, 800, 390):
        page.set_viewport_size({"width": width, "height": 800})
        until(lambda width=width: page.evaluate("document.documentElement.scrollWidth") <= width)
    assert faults == []


def test_what_is_not_known_before_a_fix_is_neither_drawn_nor_given_a_sigma(
    browser: Any, steps: list[StreamStep]
) -> None:
    expect = pytest.importorskip("playwright.sync_api").expect
    with_rows = [step for step in steps if len(step.estimates.filtered)]
    state = LiveState("run", 5.0)
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    for i, step in enumerate(with_rows):
        sigma_m = 1e5 if i < len(with_rows) // 2 else 0.5 + i / len(with_rows)
        filtered = step.estimates.filtered.assign(chainage_m_sd=sigma_m)
        state.watch(replace(step, estimates=step.estimates._replace(filtered=filtered)))
        if i == 0:
            with serving(state, port=0) as address:
                page.goto(address)
                cell = page.locator("#now div", has_text="Distance from the start")
                expect(cell).to_contain_text(re.compile(r"\d m no fix yet"))
    with serving(state, port=0) as address:
        page.goto(address)
        expect(page.locator("#now div", has_text="Chainage")).to_contain_text("± 1.49")
        expect(page.locator("#now")).not_to_contain_text("no fix yet")
        label = page.wait_for_selector("#strip-time-chainage_m_sd svg").get_attribute("aria-label")
    found = re.search(r"\(logarithmic\): (\S+); from (\S+) to (\S+) between", label)
    assert found is not None
    assert [float(number) for number in found.groups()] == pytest.approx([1.5, 1.0, 1.5], abs=0.05)


def test_a_band_far_narrower_than_its_axis_keeps_its_digits(browser: Any, steps: list[StreamStep]) -> None:
    state = LiveState("run", 5.0)
    for step in steps:
        geometry = step.estimates.geometry.assign(cross_level_mm_sd=2e-3)
        state.watch(replace(step, estimates=step.estimates._replace(geometry=geometry)))
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    with serving(state, port=0) as address:
        page.goto(address)
        label = page.wait_for_selector("#strip-place-cross_level_mm svg").get_attribute("aria-label")
    assert re.search(r": -?\d+\.\d{4} ± 0\.0039 \(95 %\)", label)


def test_the_command_serves_it(tmp_path: Path) -> None:
    simulate("trolley", seed=0, duration_s=30.0).write(tmp_path / "run")
    command = [sys.executable, "-m", "trackfg", "stream", tmp_path / "run", "-o", tmp_path / "out", "--lag", "5"]
    options = ["--view", "--port", "0", "--real-time"]
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        address = process.stderr.readline().removeprefix("view: ").strip()
        events = asked(address, "/events")
        assert events.headers["Content-Type"] == "text/event-stream"
        lines = [events.readline() for _ in range(4)]
        process.kill()
    assert lines[2] == b"event: whole\n"
    assert json.loads(lines[3].removeprefix(b"data: "))["about"] == {"title": "run", "lag_s": 5.0}
