"""Does everything that README and the pages of docs say work, as printed and in the order printed?

A newcomer's first hour: an empty folder, a terminal of 80 columns, every command and every block of Python in turn.
Each step is listed with its time, its longest silence and what became of it. What needs something that a machine may
lack (the block's first line says it) is not done, but its commands and options have to be there; these are counted.
Exit status 1 if anything failed.

    python tools/first_hour.py [--pages README.md docs/maps.md ...] [--folder DIR]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from first_hour.pages import ROOT, pages
from first_hour.walk import Step, walk

_SILENT_S = 2.0
"""A command that shows nothing for longer, s, seems to hang; such steps are marked by `*`."""


def _listed(step: Step) -> str:
    result = "FAILED" if step.failure else f"needs {step.needs}" if step.needs else "ok"
    silent = "*" if step.silence_s > _SILENT_S else " "
    return f"{step.seconds:7.1f} {step.silence_s:6.1f}{silent} {result:<17} {step.place:<34} {step.text.strip()}"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pages", nargs="+", help="only these; README.md always comes first")
    parser.add_argument("--folder", type=Path, help="work in this folder, and leave it; a temporary one if absent")
    options = parser.parse_args(arguments)
    wanted = None if options.pages is None else {"README.md", *options.pages}
    chosen = [page for page in pages() if wanted is None or str(page.relative_to(ROOT)) in wanted]
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        start, steps = time.perf_counter(), []
        print("   time silent  result            place                              step")
        for page in chosen:
            for step in walk(page, folder):
                steps.append(step)
                print(_listed(step), flush=True)
    failed = [step for step in steps if step.failure]
    for step in failed:
        print(f"\n{step.place}: {step.text.strip()}\n{step.failure}")
    silent = sum(step.silence_s > _SILENT_S for step in steps)
    not_done = sum(bool(step.needs) for step in steps)
    print(
        f"\n{len(steps)} steps in {time.perf_counter() - start:.0f} s: {len(failed)} failed, {not_done} not done for "
        f"what they need, {silent} silent for more than {_SILENT_S:g} s"
    )
    return 1 if failed else 0
