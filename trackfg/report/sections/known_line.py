"""The section of a page about a known line: which track the run is on, from where to where, and how far beside it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from trackfg.report.numbers import NONE, with_sd
from trackfg.report.page import PageSection, PageTable, TableRow, Text, folded_if_long
from trackfg.report.sections.places import PagePlaces
from trackfg.results.result import Result
from trackfg.results.summary import LineStretch

_MARKS: dict[str, Literal["error", "warning"]] = {"disagrees": "error", "undecided": "warning", "absent": "warning"}
_WORDS = {
    "on": "on the track, which was used",
    "undecided": "undecided, not used",
    "disagrees": "the line disagrees, not used",
    "absent": "no known track is near",
}


def known_line_sections(result: Result, places: PagePlaces) -> Iterator[PageSection]:
    """Yield the section of a run that was smoothed with a known line; nothing for others."""
    use = result.summary.line
    if use is None:
        return
    on = use.length_m("on")
    whole = sum(use.length_m(status) for status in _WORDS)
    text = f"Of {whole:.0f} m of the run {on:.0f} m are on a track of {use.name}, which was used."
    headings = ("from, km", "to, km", "track", "probability", "across, m", "what")
    rows = tuple(_row(stretch, places) for stretch in use.stretches)
    caption = "Before the line is used; positive to the left of it"
    table = PageTable(headings, rows, numbers=frozenset((0, 1, 3, 4)), caption=caption)
    yield PageSection("line", "Known line", (Text(text), *folded_if_long(table, "stretches")))


def _row(stretch: LineStretch, places: PagePlaces) -> TableRow:
    tracks = stretch.track or ", ".join(f"{name} ({100.0 * p:.0f} %)" for name, p in stretch.tracks.items()) or NONE
    across = NONE
    if stretch.across_m is not None and stretch.across_m_sd is not None:
        across = with_sd(stretch.across_m, stretch.across_m_sd, "")
    start, end = places.written([stretch.start_chainage_m, stretch.end_chainage_m])
    cells = (start, end, tracks, f"{stretch.probability:.3f}", across, _WORDS[stretch.status])
    return TableRow(cells, mark=_MARKS.get(stretch.status, ""))
