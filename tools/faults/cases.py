"""A case is an entry, a fault and a seed: what is damaged, how its command ended, and what is wrong with that end."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import sqlite3
import stat
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from faults import database
from faults.damage import FAULTS
from faults.entries import DATABASE, ENTRIES, Entry
from faults.runner import Conditions, End, Running, run
from faults.server import Server
from trackfg.errors import BadInputError
from trackfg.maps import read_map
from trackfg.results.result import Result

RESOURCES = ("kill", "memory", "disk", "streams", "descriptors", "two writers", "rights")
"""Faults of what the command runs on."""
KINDS = (*FAULTS, *(kind for kind in RESOURCES if kind != "rights" or os.geteuid() == 0))
BY_NAME = {entry.name: entry for entry in ENTRIES}
_DOCUMENTED = (0, 1, 2, 3)
_STARTED = 0.1
"""Share of the cases about streams and open files in which an interpreter is started: others are forks of this one."""
_PYTHONS_OWN = 4
"""Open files without which Python itself does not start: 3.11 needs 2 besides the standard streams."""
_OF_LIBRARIES = (".cache", ".config")
"""Where libraries keep what they know of this machine, as its fonts, in the user's home: here the case's folder."""
_UNFINISHED = re.compile(r"\.trackfg-|^\.unfinished-")
"""In the names of what trackfg has not finished."""
_IN_NEW = ", in a new interpreter"
_UNREADABLE = (
    ArithmeticError,
    LookupError,
    MemoryError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
    pa.ArrowException,
    sqlite3.Error,
)
"""What reading raises of a file that an earlier edit has damaged."""


@dataclass(frozen=True)
class Case:
    """``edits``: which of the case's edits are made; all by default."""

    entry: str
    fault: str
    seed: int
    edits: tuple[int, ...] | None = None

    def __str__(self) -> str:
        return f"{self.entry}:{self.fault}:{self.seed}"


@dataclass(frozen=True)
class Outcome:
    """``failure`` says what is wrong with the end, None where nothing is."""

    case: Case
    command: str
    done: tuple[str, ...]
    status: int
    seconds: float
    failure: str | None = None
    detail: str = ""
    edits: int = 1
    cpu_s: float = 0.0


@dataclass(frozen=True)
class Usual:
    """What a command does without a fault: digests of what it writes, by file, and how long it takes, s."""

    digests: dict[str, str]
    seconds: float


@dataclass(frozen=True)
class Base:
    """The sound inputs of all cases: a folder, and a server with the sound map where there is one.

    ``usual`` has commands of entries without a fault, once they were asked for.
    """

    folder: Path
    server: Server | None = None
    usual: dict[tuple[str, str], Usual] = field(default_factory=dict)


def possible(entry: Entry, fault: str) -> bool:
    """Return whether an entry can have a fault: a database is no file, and where pages are served nothing is written,
    but the address."""
    if entry.requests:
        return fault not in ("kill", "disk", "two writers", "streams")
    return not entry.database or fault in (*database.FAULTS, "kill", "memory", "streams", "descriptors", "two writers")


def case_of(number: int, seed: int, entries: tuple[str, ...], faults: tuple[str, ...]) -> Case:
    """Return the case of a number: every entry with every fault in turn."""
    pairs = [(entry, fault) for fault in faults for entry in entries if possible(BY_NAME[entry], fault)]
    entry, fault = pairs[number % len(pairs)]
    return Case(entry, fault, seed + number // len(pairs))


def outcome(case: Case, base: Base) -> Outcome:
    """Run a case in a folder of its own, which is removed."""
    entry = BY_NAME[case.entry]
    rng = np.random.default_rng([*case.entry.encode(), 0, *case.fault.encode(), 0, case.seed])
    named = entry.commands[int(rng.integers(len(entry.commands)))]
    with ExitStack() as stack:
        folder, command = _prepared(stack, entry, named, base)
        return _outcome(case, command, rng, folder, lambda: expected(entry, named, base), base)


def smallest(failed: Outcome, base: Base) -> Outcome:
    """Return the outcome of the fewest edits that still fail, of those of a failed case."""
    if failed.edits == 1 or failed.case.fault not in FAULTS:
        return failed
    for i in range(failed.edits):
        alone = outcome(Case(failed.case.entry, failed.case.fault, failed.case.seed, (i,)), base)
        if alone.failure is not None:
            return alone
    return failed


def _prepared(stack: ExitStack, entry: Entry, command: str, base: Base) -> tuple[Path, str]:
    """Copy what an entry needs, and return the case's folder and its command."""
    place = Path(tempfile.mkdtemp(prefix="faults-"))
    stack.callback(shutil.rmtree, place, ignore_errors=True)
    folder = place / "case"
    folder.mkdir()
    for name in sorted({name.split("/")[0] for name in (*entry.inputs, *entry.others)}):
        source = base.folder / name
        if source.is_dir():
            shutil.copytree(source, folder / name, symlinks=True)
        else:
            shutil.copy(source, folder / name)
    if DATABASE in command and base.server is not None:
        command = command.replace(DATABASE, stack.enter_context(database.copied(base.server, place.name)))
    return folder, command


def _outcome(
    case: Case, command: str, rng: np.random.Generator, folder: Path, usual: Callable[[], Usual], base: Base
) -> Outcome:
    entry, conditions, done = BY_NAME[case.entry], Conditions(), []
    edits = int(rng.choice([1, 1, 1, 2, 4]))
    if case.fault in FAULTS:
        for i, edit in enumerate(rng.spawn(edits)):
            if case.edits is None or i in case.edits:
                done.append(_damaged(folder, entry, case.fault, edit, base.server))
    elif case.fault != "two writers":
        conditions, text = _resources(case.fault, folder, entry, rng, usual().seconds if case.fault == "kill" else 0.0)
        done.append(text)
    kept = {} if case.fault == "rights" else _content(folder, leave_out=_written(command))
    old_result = case.fault in ("kill", "disk", "memory") and "smooth" in command
    if old_result:
        shutil.copytree(base.folder / "other", folder / "out")
    count = 1 + (case.fault == "two writers")
    running = [Running(command, folder, conditions, entry.stdin, entry.requests) for _ in range(count)]
    ends = [process.end() for process in running]
    end, failure = ends[0], None
    for each in ends:
        failure = failure or _wrong(command, each, conditions)
    if len(ends) > 1 and failure is None:
        failure = _wrong_together(ends, folder, command, usual().digests)
    if end.status == -signal.SIGKILL:
        failure = failure or _survivors(folder)
    failure = failure or _left(folder, kept, command, end, conditions, old_result)
    if failure is None and case.fault in ("kill", "disk"):
        again = run(_again(command), folder, Conditions(), entry.stdin)
        failure = _wrong_again(command, again) or _differs(folder, command, usual().digests) or _remains(folder, again)
        end = End(end.status, end.hung, end.seconds, end.out, end.err, end.cpu_s + again.cpu_s)
    detail = "" if failure is None else (end.err or end.out)[-3000:]
    return Outcome(case, command, tuple(done), end.status, end.seconds, failure, detail, edits, end.cpu_s)


def expected(entry: Entry, named: str, base: Base) -> Usual:
    """Return what a command leaves without any fault."""
    if (entry.name, named) not in base.usual:
        with ExitStack() as stack:
            folder, command = _prepared(stack, entry, named, base)
            end = run(command, folder, Conditions(), entry.stdin, entry.requests)
            if end.status not in (0, 3):
                raise SystemExit(f"trackfg {named} without a fault ends with {end.status}: {end.err[-500:]}")
            base.usual[entry.name, named] = Usual(_digests(folder, command), end.seconds)
    return base.usual[entry.name, named]


def _damaged(folder: Path, entry: Entry, fault: str, rng: np.random.Generator, server: Server | None) -> str:
    if entry.database and server is not None:
        return database.FAULTS[fault](server, folder.parent.name, rng)
    files = sorted(
        file
        for name in entry.inputs
        for file in ([folder / name] if not (folder / name).is_dir() else (folder / name).rglob("*"))
        if file.is_file() and not file.is_symlink() and "truth" not in file.name
    )
    if not files:
        return "nothing is left to damage"
    file = files[rng.integers(len(files))]
    try:
        return FAULTS[fault](file, rng)
    except _UNREADABLE as error:
        return f"{file.name}: not damaged further ({type(error).__name__})"


def _resources(
    fault: str, folder: Path, entry: Entry, rng: np.random.Generator, usual_s: float
) -> tuple[Conditions, str]:
    if fault == "kill":
        kill_s = float(rng.uniform(0.0, 1.1)) * usual_s
        return Conditions(killed_after_s=kill_s), f"killed after {kill_s:.3f} s of {usual_s:.3f}"
    if fault == "memory":
        size = int(2 ** rng.uniform(20, 29))
        return Conditions(memory_bytes=size), f"{size / 2**20:.0f} MiB of memory"
    if fault == "disk":
        size = int(2 ** rng.uniform(12, 20))  # messages are files too
        return Conditions(file_bytes=size), f"files of at most {size} bytes"
    is_started = bool(rng.random() < _STARTED)
    if fault == "descriptors":
        count = int(rng.integers(_PYTHONS_OWN if is_started else 1, 25))
        return Conditions(open_files=count, is_started=is_started), f"{count} open files{_IN_NEW * is_started}"
    if fault == "streams":
        streams = {
            int(n): [None, "/dev/full"][int(rng.integers(2))] for n in rng.choice([1, 2], int(rng.integers(1, 3)))
        }
        return Conditions(streams=streams, is_started=is_started), f"standard streams {streams}{_IN_NEW * is_started}"
    kind = str(rng.choice(["unreadable", "read-only"]))
    os.chmod(folder.parent, 0o777)
    if kind == "unreadable":
        target = folder / entry.inputs[0]
        os.chmod(target, 0)
        os.chmod(folder, 0o777)
    return Conditions(is_nobody=True), f"rights: {kind}"


def _again(command: str) -> str:
    """Return the command that goes on with the work of a killed one."""
    goes_on = command.startswith("stream") and "-o -" not in command and "--resume" not in command
    return f"{command} --resume" if goes_on else command


def _written(command: str) -> tuple[str, ...]:
    words = command.split()
    written = [words[i + 1] for i, word in enumerate(words) if word == "-o"]
    return tuple(name for place in written for name in (place, f"{place}.mapping.toml", f"{place}-journal"))


def _digests(folder: Path, command: str) -> dict[str, str]:
    """Return the digests of all numbers that a command has written: tables, checkpoints, and maps."""
    digests = {}
    words = command.split()
    places = [word for word in words if "://" in word or (word.endswith(".gpkg") and word in _written(command))]
    for place in places:
        made = read_map(place if "://" in place else folder / place)
        parts = [getattr(made, name).to_csv(index=False).encode() for name in ("grid", "landmarks", "line")]
        digests["map"] = hashlib.sha256(b"".join([*parts, made.covariance.tobytes()])).hexdigest()
    for path in [path for name in _written(command) for path in (folder / name).rglob("*")]:
        is_ours = path.suffix in (".parquet", ".csv") or path.name == "checkpoint"
        if is_ours and "catalogue" not in path.parts:  # which lists when and where
            digests[path.relative_to(folder).as_posix()] = hashlib.sha256(_numbers(path)).hexdigest()
    return digests


def _numbers(path: Path) -> bytes:
    """Return the content of a file, of the scores of a comparison without the time that each of them took."""
    if path.name != "comparison.parquet":
        return path.read_bytes()
    return pd.read_parquet(path).drop(columns="seconds").to_csv(index=False).encode()


def _differs(folder: Path, command: str, wanted: dict[str, str]) -> str | None:
    try:
        digests = _digests(folder, command)
    except BadInputError as error:
        return f"what is written is not whole: {error}"
    differing = sorted(name for name in wanted.keys() | digests.keys() if wanted.get(name) != digests.get(name))
    return f"differs from what is written without a fault: {', '.join(differing)[:200]}" if differing else None


def _wrong_together(ends: list[End], folder: Path, command: str, wanted: dict[str, str]) -> str | None:
    """Return what is wrong with what two processes did that ran the same command at the same time."""
    if all(end.status not in (0, 3) for end in ends):
        return f"neither of two writers has done it: {[end.err[-200:] for end in ends]}"
    return _differs(folder, command, wanted)


def _content(folder: Path, leave_out: tuple[str, ...]) -> dict[str, str]:
    """Return the digest of every file outside of what the command may write."""
    digests = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if name.split("/")[0] in leave_out or not stat.S_ISREG(path.lstat().st_mode):
            continue
        size = path.lstat().st_size
        digests[name] = str(size) if size > 2**28 else hashlib.sha256(path.read_bytes()).hexdigest()
    return digests


def _wrong(command: str, end: End, conditions: Conditions) -> str | None:
    if conditions.killed_after_s is not None and end.status == -9:
        return None
    if end.hung:
        return f"no end within {end.seconds:.0f} s"
    if "Traceback" in end.err or end.status == 98:
        return "traceback: " + (end.err.strip().splitlines() or ["?"])[-1][:200]
    if end.status not in _DOCUMENTED:
        return f"status {end.status}"
    if end.unanswered is not None:
        return f"no answer to {end.unanswered}"
    streams = conditions.streams or {}
    if end.status in (1, 2) and not streams and not _gives_reason(command, end):
        return f"status {end.status} with {len(end.err.splitlines())} lines on standard error"
    if any(not (c.isprintable() or c in "\n\t") for c in end.out + end.err):
        return "control characters reach the terminal"
    return None


def _wrong_again(command: str, end: End) -> str | None:
    """Return what is wrong with the end of a command that was cut short before: it may refuse what it finished then."""
    refuses_used = command.startswith(("simulate", "import", "init"))
    is_done = end.status == 2 and (refuses_used or "is in the map already" in end.err)
    if command.startswith("check") and "error" in end.out:
        return None
    if end.status in (0, 3) or is_done:
        return None
    return f"afterwards the same command ends with {end.status}: {end.err[-300:]}"


def _remains(folder: Path, end: End) -> str | None:
    """Return what a command that was cut short has left, and the one that did its work afterwards has not removed."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob(".*") if _UNFINISHED.search(path.name))
    return f"remains: {', '.join(names)[:200]}" if names and end.status in (0, 3) else None


def _gives_reason(command: str, end: End) -> bool:
    """Return whether one line on standard error says why the command ended."""
    about = ("trackfg: note", "trackfg: warning", "view: ", "trackfg: info")
    lines = [line for line in end.err.splitlines() if not line.startswith(about)]
    if command.startswith("batch"):  # one line for each run that failed, a warning
        return bool(end.err) and all(line.startswith("trackfg: ") for line in end.err.splitlines())
    if command.startswith(("check", "init", "import")):
        return bool(lines) or "error" in end.out
    if "--resume" in command:  # it says first where it goes on
        lines = [line for line in lines if ": goes on at t = " not in line]
    return (len(lines) == 1 and lines[0].startswith("trackfg: ")) or "Usage:" in end.err


def _is_whole(folder: Path) -> bool:
    """Return whether there is a whole result: the status is 1 where it is, but standard output could not be written."""
    try:
        Result.read(folder)
    except BadInputError:
        return False
    return True


def _survivors(folder: Path) -> str | None:
    """Return what is left of a killed command's processes, which end with it."""
    for _ in range(100):
        survivors = [process for process in Path("/proc").glob("[0-9]*") if _works_in(process, folder)]
        if not survivors:
            return None
        time.sleep(0.1)
    return f"processes go on after their parent was killed: {', '.join(process.name for process in survivors)}"


def _works_in(process: Path, folder: Path) -> bool:
    try:
        return Path(os.readlink(process / "cwd")).is_relative_to(folder)
    except OSError:
        return False


def _left(
    folder: Path, kept: dict[str, str], command: str, end: End, conditions: Conditions, old_result: bool
) -> str | None:
    """Return what is wrong with what the command left in its folder."""
    written = _written(command)
    was_killed = conditions.killed_after_s is not None
    now = _content(folder, leave_out=written)
    if lost := sorted(name for name in kept if now.get(name) != kept[name]):
        return f"changed: {', '.join(lost)[:200]}"
    leftovers = sorted(name for name in now if name not in kept and not (was_killed and name.startswith(".")))
    stray = sorted(path.name for path in folder.parent.iterdir() if path != folder and path.name not in _OF_LIBRARIES)
    if not was_killed and stray:
        return f"left in the folder for temporary files: {', '.join(stray)[:200]}"
    if kept and leftovers and not (was_killed and all(name.endswith("-journal") for name in leftovers)):
        return f"left over: {', '.join(leftovers)[:200]}"
    out = folder / "out"
    if "smooth" in command and (old_result or end.status in (0, 3)):
        try:
            result = Result.read(out)
        except BadInputError as error:
            return f"the result is not whole: {error}"
        if old_result and end.status in (1, 2) and result.summary.recording_id != "mainline-gnss-seed0-run1":
            return "the old result is lost"
    if "smooth" in command and not old_result and end.status in (1, 2) and out.exists() and not _is_whole(out):
        return "half a result is left"
    return None
