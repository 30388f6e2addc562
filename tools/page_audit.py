"""Hold pages against the rules of accessibility of axe-core and against the keyboard, in headless Chromium.

Each page, a file or the address of one that is served (the live page of a stream), is opened at the widths of a desk, a
tablet and a phone, light and dark, with everything unfolded. axe-core comes from npm into a temporary folder unless
``--axe`` names its ``axe.min.js``. In each view Tab has to reach everything that can be operated, and the page must not
be wider than the window. Printed is a line per page and view; the exit status is 1 where anything is wrong::

    python tools/page_audit.py out1.html comparison1.html http://127.0.0.1:8765/
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, expect, sync_playwright

WIDTHS = (1400, 800, 390)
SCHEMES = ("light", "dark")
AXE_VERSION = "4.14.1"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")

OPERATED = "a[href], button, input, select, textarea, summary, [tabindex='0']"
"""What a page has for its user to operate. Of radio buttons of one name Tab reaches one; arrows reach the others."""

MARK = """(operated) => {
  const shown = (one) => one.checkVisibility({ visibilityProperty: true }) && !one.disabled && one.tabIndex >= 0;
  window.unreached = new Set([...document.querySelectorAll(operated)].filter(shown));
  document.addEventListener("focusin", (event) => window.unreached.delete(event.target));
  document.body.focus();
  return window.unreached.size;
}"""
LEFT = "() => [...window.unreached].filter((one) => one.isConnected).map((one) => one.outerHTML.slice(0, 100))"


def axe_core(folder: Path) -> str:
    """Return the source of axe-core, installed into ``folder``."""
    command = ["npm", "install", "--silent", "--prefix", str(folder), f"axe-core@{AXE_VERSION}"]
    subprocess.run(command, check=True, timeout=300)
    return (folder / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")


def chromium() -> str | None:
    """Return the path of a browser, if there is one."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def drawn(tab: Page, address: str) -> None:
    """Open a page and wait until its charts are there."""
    tab.goto(address)
    if tab.locator(".chart").count():
        tab.wait_for_selector("html[data-charts=drawn]", timeout=120_000)
    if tab.locator(".strips").count():
        tab.wait_for_selector(".strips figure", timeout=120_000)
    tab.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    expect(tab.locator(".chart:not([data-drawn])")).to_have_count(0, timeout=120_000)


def too_wide(tab: Page, width: int) -> list[str]:
    """Return how wide a page is, px, if that is more than the window."""
    wide = tab.evaluate("document.documentElement.scrollWidth")
    return [f"is {wide} px wide"] if wide > width else []


def unreached(tab: Page) -> list[str]:
    """Return what can be operated, but not reached by Tab."""
    for _ in range(tab.evaluate(MARK, OPERATED) + 3):
        tab.keyboard.press("Tab")
    elements: list[str] = tab.evaluate(LEFT)
    return elements


def faults(browser: Browser, address: str, axe: str, width: int, scheme: str) -> list[str]:
    """Return what is wrong with a page in one view, a line each."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True)
    try:
        tab = context.new_page()
        drawn(tab, address)
        tab.evaluate(axe)
        rules: list[dict[str, Any]] = tab.evaluate("axe.run(document)")["violations"]
        violations = [
            f"{rule['id']} ({rule['impact']}), {len(rule['nodes'])} times: {rule['nodes'][0]['html'][:100]}"
            for rule in rules
        ]
        violations += [f"Tab does not reach {one}" for one in unreached(tab)]
        return violations + too_wide(tab, width)
    finally:
        context.close()


def main() -> int:
    """Print what each page breaks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", metavar="PAGE", help="a file, or the address of a page that is served")
    parser.add_argument("--axe", type=Path, metavar="FILE", help="axe.min.js, instead of npm's")
    asked = parser.parse_args()
    for page in asked.pages:
        if not page.startswith("http://") and not Path(page).is_file():
            parser.error(f"no such page: {page}")
    program = chromium()
    if program is None:
        parser.error(f"no browser: expected one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        axe = asked.axe.read_text(encoding="utf-8") if asked.axe else axe_core(Path(folder))
        browser = playwright.chromium.launch(executable_path=program)
        bad = 0
        for page, width, scheme in itertools.product(asked.pages, WIDTHS, SCHEMES):
            address = page if page.startswith("http://") else Path(page).resolve().as_uri()
            violations = faults(browser, address, axe, width, scheme)
            bad += len(violations)
            print("\n  ".join([f"{page} {width} px {scheme}: {len(violations)} faults", *violations]), flush=True)
        browser.close()
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
