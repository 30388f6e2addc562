from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from trackfg.report.charts import ChartLine, ChartPanel, Strips
from trackfg.report.columns import packed
from trackfg.report.page import Code, Drawing, Facts, Fold, Page, PageSection, PageTable, TableRow, Text, Tile, Tiles

EVIL = "</script><script>window.evil = 1</script><img src=x onerror=alert(1)>&\"'"


@pytest.fixture(scope="module")
def page() -> Page:
    x = packed(np.arange(10.0), 0.1)
    panel = ChartPanel(EVIL, "mm", (ChartLine(EVIL, "#123456", x, packed(np.arange(10.0) ** 2, 0.1)),))
    blocks = (
        Text(EVIL),
        Tiles((Tile(EVIL, EVIL, EVIL),)),
        Facts(((EVIL, EVIL),)),
        PageTable((EVIL,), (TableRow((EVIL,)), TableRow((EVIL,), mark="group")), caption=EVIL),
        Fold(EVIL, (Code(EVIL), Drawing(Strips("x, m", "m", (0.0, 9.0), (panel,)), title=EVIL, note=EVIL))),
    )
    return Page("result", EVIL, EVIL, (PageSection("one", EVIL, blocks),))


@pytest.fixture(scope="module")
def html(page: Page) -> str:
    return page.html()


def test_everything_from_data_is_escaped(html: str) -> None:
    assert "<script>window.evil" not in html
    assert "<img" not in html
    assert html.count("&lt;/script&gt;") >= 10


def test_nothing_is_loaded(html: str) -> None:
    assert not re.search(r"<(script|img|iframe|object|embed)[^>]*\ssrc=", html)
    assert re.findall(r"<link[^>]*>", html) == ['<link rel="icon" href="data:,">']


def test_only_the_scripts_of_the_page_may_run_and_no_connection_be_made(html: str) -> None:
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    said = policy[1].replace("&#39;", "'")
    assert said.startswith("default-src 'none'; script-src 'sha256-")
    assert "connect-src" not in said
    scripts = re.findall(r"<script>(.*?)</script>", html, flags=re.DOTALL)
    for script in scripts:
        assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() in said
    assert len(scripts) == 2


def test_the_same_page_gives_the_same_text(page: Page, html: str) -> None:
    assert page.html() == html


def test_written_in_one_step(page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "deep" / "report.html"
    page.write(path)
    assert path.read_text(encoding="utf-8") == page.html()
    assert path.stat().st_mode & 0o600 == 0o600

    def cut_short(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", cut_short)
    with pytest.raises(KeyboardInterrupt):
        Page("result", "another", "", ()).write(path)
    assert [file.name for file in path.parent.iterdir()] == ["report.html"]
    assert path.read_text(encoding="utf-8") == page.html()
