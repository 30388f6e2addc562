"""Does every command end as documented, whatever is wrong with what it reads and with what it runs on?

Sound inputs of every entry are made once, in a temporary folder. A case copies them, puts a fault into one entry, runs
one of its commands in a process of its own (60 s, 2 GB), and looks at how it ended: status 0 with a whole result, 2
(bad input), 1 (anything else) or 3 (not to be trusted), one line on standard error and no traceback; what it did not
write is unchanged, nothing is left over, an earlier result is whole. Any other end prints the case and the fewest
edits that show it.

    python tools/faults.py [--cases 500] [--seed 0] [--entries NAME ...] [--faults NAME ...] [--case ENTRY:FAULT:SEED]
                           [--table FILE]
"""

from __future__ import annotations

import argparse
import codecs
import importlib
import os
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads do not survive a fork

from faults.cases import BY_NAME, KINDS, Case, Outcome, case_of, outcome, smallest
from faults.entries import make_inputs

_FOR_COMMANDS = (
    "trackfg.cli.main",
    "trackfg.cli.map_tables",
    "trackfg.cli.tables",
    "trackfg.mapping.joining.build",
    "trackfg.report",
    "trackfg.smoothing.smoother",
    "trackfg.streaming.run",
)
"""What commands import: imported before any fork, so that no case takes time for it."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases; the exit status is 1 if any ended otherwise than documented."""
    options = _parser().parse_args(arguments)
    for module in _FOR_COMMANDS:
        importlib.import_module(module)
    codecs.lookup("unicode-escape")  # another user may not be able to load it
    base = Path(tempfile.mkdtemp(prefix="faults-base-"))
    os.chmod(base, 0o755)
    try:
        make_inputs(base)
        if options.case:
            entry, fault, seed = options.case.rsplit(":", 2)
            ends = [outcome(Case(entry, fault, int(seed)), base)]
            print(ends[0])
        else:
            ends = _run(options, base)
    finally:
        shutil.rmtree(base, ignore_errors=True)
    failed = [end for end in ends if end.failure is not None]
    print(f"{len(ends)} cases, {len(failed)} failures")
    if options.table:
        Path(options.table).write_text(table(ends, options.entries, options.faults))
    sys.exit(1 if failed else 0)


def table(ends: Sequence[Outcome], entries: Sequence[str], faults: Sequence[str]) -> str:
    """Return a table in Markdown by entry and fault: how many cases ended with 0 or 3, 2, 1, killed; and failures."""
    lines = ["| entry | " + " | ".join(faults) + " |", "|---" * (len(faults) + 1) + "|"]
    for entry in entries:
        cells = []
        for fault in faults:
            mine = [end for end in ends if (end.case.entry, end.case.fault) == (entry, fault)]
            count = Counter("f" if end.failure else _ending(end.status) for end in mine)
            cells.append(" ".join(f"{count[kind]}{kind}" for kind in "odxkf" if count[kind]) or "-")
        lines.append(f"| {entry} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _ending(status: int) -> str:
    return {0: "o", 3: "o", 2: "d", 1: "x"}.get(status, "k")


def _run(options: argparse.Namespace, base: Path) -> list[Outcome]:
    ends = []
    for number in range(options.cases):
        end = outcome(case_of(number, options.seed, tuple(options.entries), tuple(options.faults)), base)
        if end.failure is not None:
            least = smallest(end, base)
            print(f"FAILURE {end.case}  trackfg {end.command}\n  {least.failure}\n  {'; '.join(least.done)}")
            print("    " + least.detail.strip()[-1500:].replace("\n", "\n    "), flush=True)
        ends.append(end)
    return ends


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="faults.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=500, metavar="N", help="how many cases")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the first seed")
    parser.add_argument("--entries", nargs="+", choices=list(BY_NAME), default=list(BY_NAME), metavar="NAME")
    parser.add_argument("--faults", nargs="+", choices=KINDS, default=list(KINDS), metavar="NAME")
    parser.add_argument("--case", metavar="ENTRY:FAULT:SEED", help="run this case alone, and print all about it")
    parser.add_argument("--table", metavar="FILE", help="write the table by entry and fault to this file")
    return parser
