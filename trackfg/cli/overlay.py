"""``trackfg overlay``: runs over one line are laid over each other and compared."""

from __future__ import annotations

import json as json_text
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Json
from trackfg.cli.terminal import numbers, show_unless_written, titled, working
from trackfg.files.atomic_folder import real_path
from trackfg.files.libraries import library

if TYPE_CHECKING:
    from rich.console import RenderableType

    from trackfg.mapping.runs.run_overlay import RunOverlay
    from trackfg.report.page import Page

_HEAD, _SHIFTS, _DIFFERENCES, _PAGE = _FILES = ("overlay.json", "shifts.csv", "differences.csv", "page.html")
_FORMAT = "trackfg-overlay/1"
_MOST_ROWS = 60
"""Sections that are shown in a terminal."""


def overlay(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN", help="Results, or channel tables of recording cars.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="OUT", help="Folder for the tables and the page.")
    ] = None,
    section: Annotated[
        int, typer.Option(metavar="M", min=20, help="Length of the sections of the shift, m: a multiple of 20.")
    ] = 100,
    json: Json = False,
) -> None:
    """Lay runs over the first of them: its shift by sections, with a sigma each, and how well channels repeat.

    No hint of the offset is needed. The exit status is 2 where a run has no track in common with the first. In OUT are
    shifts.csv, differences.csv, overlay.json and a page with all runs over one axis.
    """
    from trackfg.cli.tables import warn_of_doubt
    from trackfg.files.owned_folder import FolderKind
    from trackfg.interchange.importing.channels.source_geometry import read_geometry
    from trackfg.mapping.runs.run_overlay import overlaid
    from trackfg.report.runs.overlay_page import overlay_page
    from trackfg.results.verdict import untrusted

    if out is not None:
        library("plotly", "charts")  # of the page
        FolderKind("overlay", _HEAD, "trackfg-overlay/", _FILES).refuse_foreign(out)
    with working("overlay"):
        results = [read_geometry(path) for path in runs]
        laid = overlaid(results, _names(runs), section_m=float(section))
        if out is not None:
            command = shlex.join(["trackfg", "overlay", *map(str, runs), "-o", str(out), "--section", str(section)])
            verdicts = (result.summary.verdicts for result in results)
            doubts = {name: untrusted(one) for name, one in zip(laid.names, verdicts, strict=True)}
            _write(out, laid, overlay_page(laid, command, doubts))
    for result, path in zip(results, runs, strict=True):
        warn_of_doubt(result, path)
    if json:
        print(_as_json(laid))
        return
    show_unless_written(*_tables(laid, out), written=None if out is None else f"overlay: {out}")


def _names(runs: Sequence[Path]) -> list[str]:
    """Return the runs' names: those of their files or folders, with the folder above where two are alike."""
    short = [real_path(path).stem for path in runs]
    return [
        name if short.count(name) == 1 else f"{real_path(path).parent.name}/{path.name}"
        for name, path in zip(short, runs, strict=True)
    ]


def _as_json(laid: RunOverlay) -> str:
    from trackfg.cli.tables import records

    content = {
        "format": _FORMAT,
        "reference": laid.names[0],
        "shifts": records(laid.shifts),
        "repeatability": records(laid.repeatability),
    }
    return json_text.dumps(content, indent=2)


def _write(out: Path, laid: RunOverlay, page: Page) -> None:
    """Write the folder, complete or not at all."""
    from trackfg.files.atomic_folder import replaced_folder

    with replaced_folder(out) as new:
        (new / _HEAD).write_text(_as_json(laid) + "\n", encoding="utf-8")
        laid.shifts.to_csv(new / _SHIFTS, index=False)
        laid.differences.to_csv(new / _DIFFERENCES, index=False)
        page.write(new / _PAGE)


def _tables(laid: RunOverlay, out: Path | None) -> list[RenderableType]:
    from rich.text import Text

    from trackfg.report.numbers import fixed

    shifts = titled(f"Shift against {laid.names[0]}", "run", *numbers("from m", "to m", "shift m", "1 sigma m"))
    more = len(laid.shifts) - _MOST_ROWS
    where = "-o writes all" if out is None else f"all are in {out / _SHIFTS}"
    for row in laid.shifts.head(_MOST_ROWS).to_dict("records"):
        places = {"from_m": 1, "to_m": 1, "shift_m": 3, "shift_m_sd": 3}
        shifts.add_row(Text(row["run"]), *(fixed(row[name], digits) for name, digits in places.items()))
    title = "Repeatability: standard deviation of the difference over 200 m"
    repeated = titled(title, "run", "channel", *numbers("sections", "median", "95 % below", "greatest"))
    for row in laid.repeatability.to_dict("records"):
        sds = (f"{row[name]:.3g}" for name in ("sd_median", "sd_95", "sd_max"))
        repeated.add_row(Text(row["run"]), row["channel"], str(row["sections"]), *sds)
    return [shifts, *([Text(f"{more} sections more: {where}")] if more > 0 else []), repeated]
