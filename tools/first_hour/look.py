"""Pages that a newcomer has made are opened in headless Chromium, at three widths, and printed on A4."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from page_audit import WIDTHS, chromium, drawn, too_wide
from playwright.sync_api import Browser, Error, Page, sync_playwright

from first_hour.walk import Step

_LOCAL = ("file:", "data:", "blob:")
"""Beginnings of addresses that need no network."""
_HEIGHT = 900
"""Of the window, px; pictures show the whole page."""


def looked_at(folder: Path, pictures: Path) -> Iterator[Step]:
    """Open every page below ``folder``, and put what it looks like into ``pictures``, to be looked at.

    A page has failed where its scripts do, where it asks a network for anything, or is wider than the window.
    """
    program = chromium()
    if program is None:
        yield Step("pages", "are opened in Chromium", needs="a browser")
        return
    pictures.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program)
        for page in sorted(folder.rglob("*.html")):
            if pictures not in page.parents:
                yield from _views(browser, page, pictures, str(page.relative_to(folder)))
        browser.close()


def _views(browser: Browser, page: Path, pictures: Path, name: str) -> Iterator[Step]:
    picture = pictures / name.replace("/", "-").removesuffix(".html")
    for width in WIDTHS:
        start, wrong = time.perf_counter(), list[str]()
        tab = browser.new_page(viewport={"width": width, "height": _HEIGHT})
        _note_errors(tab, wrong)
        try:
            drawn(tab, page.resolve().as_uri())
            tab.screenshot(path=f"{picture}-{width}.png", full_page=True)
            wrong += too_wide(tab, width)
            if width == WIDTHS[0]:
                tab.pdf(path=f"{picture}.pdf", format="A4", prefer_css_page_size=True)
        except Error as error:
            wrong.append(error.message)
        tab.close()
        yield Step(name, f"{width} px", time.perf_counter() - start, failure="\n".join(wrong))


def _note_errors(tab: Page, wrong: list[str]) -> None:
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    tab.on("request", lambda asked: None if asked.url.startswith(_LOCAL) else wrong.append(f"asks for {asked.url}"))
