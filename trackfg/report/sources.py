"""Make the page about a folder that trackfg wrote: one entry per kind of folder."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from trackfg.comparison.table import COMPARISON_FOLDER, Comparison
from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import real_path
from trackfg.files.libraries import library
from trackfg.files.owned_folder import FolderKind, hint_instead, kind_of
from trackfg.geometry.limits import LimitChoice
from trackfg.plots.strip_chart import LimitLine
from trackfg.plots.strip_limits import limit_lines
from trackfg.report.comparison_page import comparison_page
from trackfg.report.page import Page
from trackfg.report.result_page import result_page
from trackfg.report.runs.trend_page import trend_page
from trackfg.report.sections.background import Background, read_background
from trackfg.report.track_limits import judge
from trackfg.report.truth import against
from trackfg.results.official_places import shown_kilometrage
from trackfg.results.result import RESULT_FOLDER, Result
from trackfg.results.trends import TRENDS_FOLDER, Trends

_SUFFIX = ".html"


@dataclass(frozen=True)
class _Wanted:
    """All that a page is to show besides the folder: truth of a recording, limits, official places, a background."""

    recording: Path | None = None
    limits: LimitChoice | None = None
    km: bool | None = None
    background: Path | None = None

    def refuse(self, why: str) -> None:
        """Raise :class:`BadInputError` where anything is wanted: it belongs beside a result only."""
        for what, value in (
            ("a recording", self.recording),
            ("limits", self.limits),
            ("official places", self.km or None),
            ("a background", self.background),
        ):
            if value is not None:
                raise BadInputError(f"{why}; expected {what} beside a result only")


def write_report(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    recording: str | os.PathLike[str] | None = None,
    limits: LimitChoice | None = None,
    km: bool | None = None,
    background: str | os.PathLike[str] | None = None,
) -> Path:
    """Write the page about a result, a comparison or trends into a file, in one step.

    The same folder gives the same page.

    Parameters
    ----------
    folder
        What ``smooth``, ``compare`` or ``map trends`` wrote.
    path
        The page, ``.html``, outside the folder.
    recording
        The one that a result was made from: the page shows its truth and the errors. Without a truth it adds nothing.
    limits
        Those that a result's geometry is held against.
    km
        Whether places are official ones; if None, where the recording has a kilometrage.
    background
        A GeoJSON file or a GeoPackage whose lines and named points lie behind the map.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    BadInputError
        If the folder is none of these, if ``path`` does not end in ``.html`` or lies in it, for a recording of another
        result, for limits that cannot be read, for official places where the result knows none, and
        for any of these beside a comparison or trends.
    MissingLibraryError
        Without plotly.

    Examples
    --------
    >>> from trackfg.report import write_report
    >>> write_report("out1", "out1.html").name
    'out1.html'
    """
    library("plotly", "charts")  # before anything is read or computed
    folder, path = Path(folder), Path(path)
    if path.suffix != _SUFFIX:
        raise BadInputError(f"{path}: expected a file that ends in {_SUFFIX}")
    if path.is_dir():
        raise BadInputError(f"{path}: is a folder; expected a file")
    kind = _kind_of(folder)
    if real_path(path).parent == real_path(folder):
        what = kind.what
        raise BadInputError(f"{path}: lies in the {what}, which holds nothing but its own files: choose another place")
    given = [] if recording is None else ["--recording", os.fspath(recording)]
    given += [] if limits is None else limits.options()
    given += [] if km is None else ["--km"] if km else ["--no-km"]
    given += [] if background is None else ["--background", os.fspath(background)]
    command = shlex.join(["trackfg", "report", os.fspath(folder), "-o", os.fspath(path), *given])
    behind = None if background is None else Path(background)
    wanted = _Wanted(None if recording is None else Path(recording), limits, km, behind)
    return _PAGES[kind](folder, command, wanted).write(path)


def page_of(folder: Path, command: str) -> Page:
    """Return the page about a folder alone; ``command`` is what it says that it was made by.

    Raises :class:`BadInputError` for a folder that trackfg did not write.
    """
    return _PAGES[_kind_of(folder)](folder, command, _Wanted())


def _kind_of(folder: Path) -> FolderKind:
    for kind in _PAGES:
        if kind.holds(folder):
            return kind
    kinds = " or ".join(f"a {kind.what} ({kind.head})" for kind in _PAGES)
    other = kind_of(folder)
    is_a = "" if other is None or other in {kind.what for kind in _PAGES} else f"is a {other}; "
    hint = hint_instead(other) if is_a else ""
    raise BadInputError(f"{folder}: {is_a}expected a folder that trackfg wrote: {kinds}{hint}")


def _of_result(folder: Path, command: str, wanted: _Wanted) -> Page:
    result, limits = Result.read(folder), wanted.limits
    judgement, lines = None, list[LimitLine]()
    if limits is not None:
        table = limits.table()
        judgement = judge(result, table, limits.line_speed_kmh, km=wanted.km)
        lines, _ = limit_lines(result, table, limits.line_speed_kmh)
    truth = None if wanted.recording is None else against(result, wanted.recording)
    line = shown_kilometrage(result, wanted.km)
    origin = None if result.summary.run is None else result.summary.run.origin
    behind = Background() if wanted.background is None else read_background(wanted.background, origin)
    return result_page(result, command, truth, judgement, line, limits=lines, background=behind)


def _of_comparison(folder: Path, command: str, wanted: _Wanted) -> Page:
    wanted.refuse(f"{folder}: is a comparison, which holds its own truth")
    return comparison_page(Comparison.read(folder), command)


def _of_trends(folder: Path, command: str, wanted: _Wanted) -> Page:
    wanted.refuse(f"{folder}: holds trends, and the dates of their limits")
    return trend_page(Trends.read(folder), real_path(folder).name, command)


_PAGES: dict[FolderKind, Callable[[Path, str, _Wanted], Page]] = {
    RESULT_FOLDER: _of_result,
    COMPARISON_FOLDER: _of_comparison,
    TRENDS_FOLDER: _of_trends,
}
"""The page of each kind of folder: from folder, the command that makes the page, and what else is wanted."""
