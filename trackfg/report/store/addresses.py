"""Addresses of the pages of a store, as links name them and a server takes them apart."""

from __future__ import annotations

from urllib.parse import urlencode

STORE, LINE, SECTION, RUN, PROGRESS = "/", "/line", "/section", "/run", "/progress"


def line_address(line: str) -> str:
    """Return the address of a line's page."""
    return f"{LINE}?{urlencode({'line': line})}"


def section_address(line: str, from_m: float, *, every_run: bool = False) -> str:
    """Return the address of the page of the section that begins at a chainage, with its newest runs or every one."""
    return f"{SECTION}?{urlencode({'line': line, 'from': f'{from_m:g}'} | ({'runs': 'all'} if every_run else {}))}"


def run_address(run: str) -> str:
    """Return the address of a run's report."""
    return f"{RUN}?{urlencode({'run': run})}"


def progress_address(seen: str) -> str:
    """Return the address of the text about running batches; ``seen`` is what the page that asks was made from."""
    return f"{PROGRESS}?{urlencode({'seen': seen})}"
