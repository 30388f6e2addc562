"""Hold pages against the rules of accessibility of axe-core, in headless Chromium.

Each page is opened at the widths of a desk, a tablet and a phone, light and dark, with everything unfolded. axe-core
comes from npm into a temporary folder unless ``--axe`` names its ``axe.min.js``. Printed is a line per page and view;
the exit status is 1 where a rule is broken::

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

from playwright.sync_api import Browser, sync_playwright

WIDTHS = (1400, 800, 390)
SCHEMES = ("light", "dark")
AXE_VERSION = "4.14.1"


def axe_core(folder: Path) -> str:
    """Return the source of axe-core, installed into ``folder``."""
    command = ["npm", "install", "--silent", "--prefix", str(folder), f"axe-core@{AXE_VERSION}"]
    subprocess.run(command, check=True, timeout=300)
    return (folder / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")


def violations(browser: Browser, page: str, axe: str, width: int, scheme: str) -> list[dict[str, Any]]:
    """Return the rules that a page breaks in one view, each with the elements that do."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True)
    try:
        tab = context.new_page()
        tab.goto(page if page.startswith("http://") else Path(page).resolve().as_uri())
        tab.wait_for_selector("html[data-charts=drawn]", timeout=120_000)
        tab.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        tab.wait_for_function("document.querySelectorAll('.chart:not([data-drawn])').length === 0")
        tab.evaluate(axe)
        found: list[dict[str, Any]] = tab.evaluate("axe.run(document)")["violations"]
        return found
    finally:
        context.close()


def main() -> int:
    """Print what each page breaks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+", metavar="PAGE", help="a file, or the address of a page that is served")
    parser.add_argument("--axe", type=Path, metavar="FILE", help="axe.min.js, instead of npm's")
    asked = parser.parse_args()
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        parser.error("no browser: expected chromium, chromium-browser or google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        axe = asked.axe.read_text(encoding="utf-8") if asked.axe else axe_core(Path(folder))
        browser = playwright.chromium.launch(executable_path=chromium)
        bad = 0
        for page, width, scheme in itertools.product(asked.pages, WIDTHS, SCHEMES):
            broken = violations(browser, page, axe, width, scheme)
            bad += len(broken)
            print(f"{page} {width} px {scheme}: {len(broken)} violations", flush=True)
            for rule in broken:
                print(
                    f"  {rule['id']} ({rule['impact']}), {len(rule['nodes'])} times: {rule['nodes'][0]['html'][:100]}"
                )
        browser.close()
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
