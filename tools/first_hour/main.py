"""Does everything that README and the pages of docs say work, as printed and in the order printed?

A newcomer's first hour: a fresh clone of the last commit, its own environment, ``make demo``; then, in an empty folder
and a terminal of 80 columns, every command and every block of Python in turn; at last every page that has been made, in
Chromium at three widths and printed on A4, with pictures of all. Each step is listed with its time, its longest silence
and what became of it. What needs something that a machine may lack (the first line of a block says it) is not done, but
its commands and options have to be there; these are counted. Exit status 1 if anything failed.

    python tools/first_hour.py [--pages README.md docs/maps.md ...] [--folder DIR] [--here]
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from first_hour.look import looked_at
from first_hour.pages import ROOT, pages
from first_hour.walk import Step, command, walk

_SILENT_S = 2.0
"""A command that shows nothing for longer, s, seems to hang; such steps are marked by `*`."""

_SET_UP = ("git clone --progress {root} clone", "make -C clone .venv/.ready", "make -C clone demo")
"""What comes before the first page: these need a network."""

_HEAD = "   time silent  result            place                              step"


def _listed(step: Step) -> str:
    result = "FAILED" if step.failure else f"needs {step.needs}" if step.needs else "ok"
    silent = "*" if step.silence_s > _SILENT_S else " "
    return f"{step.seconds:7.1f} {step.silence_s:6.1f}{silent} {result:<17} {step.place:<34} {step.text.strip()}"


def _hour(wanted: set[str] | None, folder: Path) -> Iterator[Step]:
    for page in pages():
        if wanted is None or str(page.relative_to(ROOT)) in wanted:
            yield from walk(page, folder)
    yield from looked_at(folder, folder / "pictures")


def _in_a_clone(arguments: Sequence[str], folder: Path) -> int:
    """Make a clone and its environment in ``folder``, and go through the pages there; return the exit status."""
    for line in _SET_UP:
        step = command("newcomer", line.format(root=ROOT), folder)
        print(_listed(step), flush=True)
        if step.failure:
            print(step.failure)
            return 1
    work = folder / "work"
    work.mkdir(exist_ok=True)
    (folder / "clone" / "demo").rename(work / "demo")
    clone = [folder / "clone" / ".venv/bin/python", folder / "clone/tools/first_hour.py"]
    return subprocess.run([*clone, *arguments, "--here", "--folder", work], check=False).returncode


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pages", nargs="+", help="only these; README.md always comes first")
    parser.add_argument("--folder", type=Path, help="work in this folder, and leave it; a temporary one if absent")
    parser.add_argument("--here", action="store_true", help="no clone: this checkout, with the Python that runs this")
    options = parser.parse_args(arguments)
    chosen = [] if options.pages is None else ["--pages", *options.pages]
    wanted = None if options.pages is None else {"README.md", *options.pages}
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        print(_HEAD, flush=True)
        if not options.here:
            return _in_a_clone(chosen, folder)
        start, steps = time.perf_counter(), []
        for step in _hour(wanted, folder):
            steps.append(step)
            print(_listed(step), flush=True)
    return _judged(steps, time.perf_counter() - start)


def _judged(steps: Sequence[Step], seconds: float) -> int:
    """Print what failed, and how many steps there were; return the exit status."""
    failed = [step for step in steps if step.failure]
    for step in failed:
        print(f"\n{step.place}: {step.text.strip()}\n{step.failure}")
    silent = sum(step.silence_s > _SILENT_S for step in steps)
    not_done = sum(bool(step.needs) for step in steps)
    print(
        f"\n{len(steps)} steps in {seconds:.0f} s: {len(failed)} failed, {not_done} not done for "
        f"what they need, {silent} silent for more than {_SILENT_S:g} s"
    )
    return 1 if failed else 0
