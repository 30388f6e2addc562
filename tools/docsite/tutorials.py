"""The tutorials are carried out while the site is built, as printed, each in a folder of its own.

Beneath each block stands what it printed. A remark ``<!-- figure: FILE | TEXT -->`` shows a picture that the blocks
before it made; TEXT is its caption and its text alternative. A step that fails ends the build.
"""

from __future__ import annotations

import re
import shutil
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from os.path import relpath
from pathlib import Path

import pyte
from first_hour.pages import blocks
from first_hour.walk import walk
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

_COLUMNS, _ROWS = 240, 2000
"""The screen that outputs are read off: larger than what any command prints, so that no line is broken."""
_AT_ONCE = 2
"""Tutorials that run beside each other: each uses one core."""
_FIGURE = re.compile(r"<!-- figure: (?P<file>\S+) \| (?P<text>.+?) -->", re.DOTALL)

Outputs = dict[int, str]
"""What the blocks printed, by the line that a block begins in."""


def outputs_of(page: Path, folder: Path) -> Outputs:
    """Carry out a page in an empty folder, and return what each block printed. Raises ``ValueError`` for a failure."""
    folder.mkdir(parents=True, exist_ok=True)
    printed: defaultdict[int, list[str]] = defaultdict(list)
    for step in walk(page, folder):
        if step.failure:
            raise ValueError(f"{step.place}: {step.text}: {step.failure}")
        _, _, line = step.place.partition(":")
        printed[int(line or 0)].append(on_screen(step.printed))
    return {line: text for line, parts in printed.items() if (text := "\n".join(filter(None, parts)))}


def on_screen(printed: str) -> str:
    """Return what is left on a terminal's screen of what a command printed: progress bars are gone."""
    if "\r" not in printed and "\x1b" not in printed:
        return printed.strip("\n")
    screen = pyte.Screen(_COLUMNS, _ROWS)
    screen.set_mode(pyte.modes.LNM)
    pyte.Stream(screen).feed(printed)
    return "\n".join(line.rstrip() for line in screen.display).strip("\n")


def with_outputs(page: Path, text: str, outputs: Outputs, folder: str) -> str:
    """Return a page's text with the output beneath each block, and with the pictures; ``folder`` is relative to it."""
    lines = text.splitlines()
    for block in reversed(blocks(page)):
        if block.line in outputs:
            end = block.line + block.text.count("\n") + 1
            lines[end:end] = ["", "~~~{code-block} text", ":class: output", "", outputs[block.line], "~~~", ""]

    def picture(match: re.Match[str]) -> str:
        words = " ".join(match["text"].split())
        file = f"{folder}/{match['file']}"
        return f":::{{figure}} {file}\n:alt: {words}\n:class: made-here\n\n{words}\n:::"

    return _FIGURE.sub(picture, "\n".join(lines) + "\n")


def _carried_out(pages: Sequence[Path], folders: Sequence[Path]) -> list[Outputs]:
    with ProcessPoolExecutor(_AT_ONCE, mp_context=get_context("spawn")) as pool:
        return list(pool.map(outputs_of, pages, folders))


def _run(app: Sphinx) -> None:
    app.tutorial_outputs = {}
    if app.builder.format != "html" or not app.config.run_tutorials:
        return
    every = (path.relative_to(app.srcdir).with_suffix("") for path in Path(app.srcdir).rglob("*.md"))
    names = sorted(name for path in every if re.fullmatch(app.config.tutorial_pages, name := path.as_posix()))
    shutil.rmtree(home := Path(app.doctreedir) / "tutorials", ignore_errors=True)
    folders = [home / Path(name).name for name in names]
    pages = [Path(app.srcdir, f"{name}.md") for name in names]
    try:
        outputs = _carried_out(pages, folders)
    except ValueError as error:
        raise ExtensionError(str(error)) from error
    app.tutorial_outputs = dict(zip(names, zip(outputs, folders, strict=True), strict=True))


def _show(app: Sphinx, name: str, source: list[str]) -> None:
    if name in app.tutorial_outputs:
        outputs, folder = app.tutorial_outputs[name]
        page = Path(app.env.doc2path(name))
        source[0] = with_outputs(page, source[0], outputs, relpath(folder, page.parent))


def setup(app: Sphinx) -> None:
    """Carry the tutorials out before pages are read, and show their outputs."""
    app.add_config_value("tutorial_pages", "tutorials/.*", "env")
    app.add_config_value("run_tutorials", True, "env", bool)
    app.connect("builder-inited", _run)
    app.connect("source-read", _show)
