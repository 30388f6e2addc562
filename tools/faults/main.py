"""Does every command end as documented, whatever is wrong with what it reads and with what it runs on?

Sound inputs of every entry are made once, in a temporary folder, and a map in a PostgreSQL server of its own where one
is installed. A case copies them, puts a fault into one entry, runs one of its commands in a process of its own (60 s of
processor time, 2 GB), and looks at how it ended: status 0 with a whole result, 2 (bad input), 1 (anything else) or 3
(not to be trusted), one line on standard error and no traceback; what it did not write is unchanged, nothing is left
over, an earlier result is whole; what was killed and run again, or run twice at a time, is to the last bit what it is
without a fault. Any other end prints the case and the fewest edits that show it.

    python tools/faults.py [--cases 500] [--seed 0] [--jobs 2] [--entries NAME ...] [--faults NAME ...]
                           [--case ENTRY:FAULT:SEED] [--table FILE]
"""

from __future__ import annotations

import argparse
import codecs
import gc
import importlib
import os
import pkgutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, suppress
from itertools import chain
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads do not survive a fork

import trackfg
from faults import server
from faults.cases import BY_NAME, KINDS, Base, Case, Outcome, case_of, outcome, smallest
from faults.database import SOUND
from faults.inputs import make_inputs, run_sound
from trackfg.cli.main import command_line
from trackfg.numerics.blas_threads import one_thread
from trackfg.report.sources import write_report
from trackfg.results.summary import versions

_OF_LIBRARIES = (
    "asammdf",
    "encodings.idna",
    "h5py",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
    "mcap.reader",
    "nptdms",
    "psycopg",
    "pyarrow.feather",
    "pynmeagps",
    "pyogrio.raw",
    "pyproj",
    "pyubx2",
    "rich._emoji_codes",
    "rosbags.highlevel",
    "sqlalchemy.dialects.postgresql.psycopg",
    "sqlalchemy.dialects.sqlite",
    "typer._adapters",
)
"""What commands import of libraries, some of which need not be installed, when they first need it."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases; the exit status is 1 if any ended otherwise than documented."""
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _end)
    import_all()
    for encoding in ("unicode-escape", "cp437"):  # another user may not be able to load them
        codecs.lookup(encoding)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="faults-base-")))
        os.chmod(folder, 0o755)
        make_inputs(folder)
        write_report(folder / "result", folder / "page.html").unlink()  # packs plotly, compiles the template: both kept
        with one_thread():  # looks for the libraries of linear algebra, and keeps what it finds
            pass
        running = None
        if any(BY_NAME[name].database for name in options.entries):
            running = stack.enter_context(server.running_server())
            running.sql("postgres", f"CREATE DATABASE {SOUND} TEMPLATE {'spatial' if running.postgis else 'plain'}")
            for result in ("result", "third"):
                run_sound(f"map build {result} -o {running.url(SOUND, 'trackfg')}", folder)
        base = Base(folder, running)
        gc.freeze()  # else each fork copies all that a collection looks at
        ends = [_outcome_of(case, base) for case in [_case(options.case)]] if options.case else _run(options, base)
    if options.case:
        print(ends[0])
    failed = [end for end in ends if end.failure is not None]
    print(f"{len(ends)} cases, {len(failed)} failures, {sum(end.cpu_s for end in ends):.0f} s of processor time")
    if options.table:
        Path(options.table).write_text(table(ends, options.entries, options.faults))
    sys.exit(1 if failed else 0)


def import_all() -> None:
    """Import whatever commands import, and make what all need, before any fork: else each case takes time for it."""
    of_trackfg = (module.name for module in pkgutil.walk_packages(trackfg.__path__, "trackfg."))
    for module in chain(of_trackfg, _OF_LIBRARIES):
        with suppress(ImportError):
            if not module.endswith("__main__"):
                importlib.import_module(module)
    command_line()
    versions()


def _end(number: int, frame: object) -> None:
    """Leave in order, as an interrupt does: the server ends, and the folders are removed. It is asked for once."""
    signal.signal(number, signal.SIG_IGN)
    sys.exit(128 + number)


def table(ends: Sequence[Outcome], entries: Sequence[str], faults: Sequence[str]) -> str:
    """Return a table in Markdown by entry and fault: how many cases ended with 0 or 3, 2, 1, killed; and failures."""
    lines = ["| entry | " + " | ".join(faults) + " |", "|---" * (len(faults) + 1) + "|"]
    for entry in entries:
        cells = []
        for fault in faults:
            of_fault = [end for end in ends if (end.case.entry, end.case.fault) == (entry, fault)]
            count = Counter("f" if end.failure else _ending(end.status) for end in of_fault)
            cells.append(" ".join(f"{count[kind]}{kind}" for kind in "odxkf" if count[kind]) or "-")
        lines.append(f"| {entry} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _ending(status: int) -> str:
    return {0: "o", 3: "o", 2: "d", 1: "x"}.get(status, "k")


def _case(text: str) -> Case:
    entry, fault, seed = text.rsplit(":", 2)
    return Case(entry, fault, int(seed))


_base: Base


def _begin(base: Base) -> None:
    """Keep the sound inputs in a process that runs cases."""
    global _base
    _base = base


def _next(cases: Sequence[Case]) -> list[Outcome]:
    return [_outcome_of(case, _base) for case in cases]


def _outcome_of(case: Case, base: Base) -> Outcome:
    end = outcome(case, base)
    return end if end.failure is None else smallest(end, base)


def _run(options: argparse.Namespace, base: Base) -> list[Outcome]:
    names = tuple(options.entries), tuple(options.faults)
    cases = [case_of(number, options.seed, *names) for number in range(options.cases)]
    ends: list[Outcome] = []
    try:
        for end in _ends(cases, base, options.jobs):
            if end.failure is not None:
                print(f"FAILURE {end.case}  trackfg {end.command}\n  {end.failure}\n  {'; '.join(end.done)}")
                print("    " + end.detail.strip()[-1500:].replace("\n", "\n    "), flush=True)
            ends.append(end)
    finally:
        if len(ends) < len(cases):
            print(f"ended after {len(ends)} of {len(cases)} cases", flush=True)
    return ends


def _ends(cases: Sequence[Case], base: Base, jobs: int) -> Iterator[Outcome]:
    """Yield the outcomes; one process has all cases of an entry, whose commands it runs without a fault but once."""
    if jobs == 1:
        yield from (_outcome_of(case, base) for case in cases)
        return
    of_entry = [[case for case in cases if case.entry == name] for name in BY_NAME]
    with ProcessPoolExecutor(jobs, get_context("fork"), _begin, (base,)) as pool:
        yield from chain.from_iterable(pool.map(_next, filter(None, of_entry)))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="faults.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=500, metavar="N", help="how many cases")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="how many at a time")
    parser.add_argument("--entries", nargs="+", choices=list(BY_NAME), default=list(BY_NAME), metavar="NAME")
    parser.add_argument("--faults", nargs="+", choices=KINDS, default=list(KINDS), metavar="NAME")
    parser.add_argument("--case", metavar="ENTRY:FAULT:SEED", help="run this case alone, and print all about it")
    parser.add_argument("--table", metavar="FILE", help="write the table by entry and fault to this file")
    return parser
