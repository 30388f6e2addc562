"""A case is an entry, a fault and a seed: what is damaged, how its command ended, and what is wrong with that end."""

from __future__ import annotations

import hashlib
import os
import shutil
import sqlite3
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from faults.damage import FAULTS
from faults.entries import ENTRIES, Entry
from faults.runner import Conditions, End, run
from trackfg.errors import BadInputError
from trackfg.results.result import Result

RESOURCES = ("kill", "memory", "disk", "streams", "rights")
"""Faults of what the command runs on."""
KINDS = (*FAULTS, *RESOURCES)
BY_NAME = {entry.name: entry for entry in ENTRIES}
_DOCUMENTED = (0, 1, 2, 3)
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


def case_of(number: int, seed: int, entries: tuple[str, ...], faults: tuple[str, ...]) -> Case:
    """Return the case of a number: every entry with every fault in turn."""
    pairs = [(entry, fault) for fault in faults for entry in entries]
    entry, fault = pairs[number % len(pairs)]
    return Case(entry, fault, seed + number // len(pairs))


def outcome(case: Case, base: Path) -> Outcome:
    """Run a case in a folder of its own, which is removed."""
    place = Path(tempfile.mkdtemp(prefix="faults-"))
    try:
        return _outcome(case, base, place)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def smallest(failed: Outcome, base: Path) -> Outcome:
    """Return the outcome of the fewest edits that still fail, of those of a failed case."""
    if failed.edits == 1 or failed.case.fault not in FAULTS:
        return failed
    for i in range(failed.edits):
        alone = outcome(Case(failed.case.entry, failed.case.fault, failed.case.seed, (i,)), base)
        if alone.failure is not None:
            return alone
    return failed


def _outcome(case: Case, base: Path, place: Path) -> Outcome:
    entry = BY_NAME[case.entry]
    rng = np.random.default_rng([*case.entry.encode(), 0, *case.fault.encode(), 0, case.seed])
    folder = place / "case"
    shutil.copytree(base, folder, symlinks=True)
    command = entry.commands[int(rng.integers(len(entry.commands)))]
    conditions, done = Conditions(), []
    edits = int(rng.choice([1, 1, 1, 2, 4]))
    if case.fault in FAULTS:
        for i, edit in enumerate(rng.spawn(edits)):
            if case.edits is None or i in case.edits:
                done.append(_damaged(folder, entry, case.fault, edit))
    else:
        conditions, text = _resources(case.fault, folder, entry, rng)
        done.append(text)
    kept = {} if case.fault == "rights" else _content(folder, leave_out=_written(command))
    old_result = case.fault in ("kill", "disk", "memory") and entry.output == "out" and "smooth" in command
    if old_result:
        shutil.copytree(base / "other", folder / "out")
    end = run(command, folder, conditions, entry.stdin)
    failure = _wrong(command, end, conditions) or _left(folder, kept, command, end, conditions, old_result)
    if failure is None and case.fault in ("kill", "disk") and "--resume" not in command:
        failure = _wrong_again(command, run(command, folder, Conditions(), entry.stdin))
    detail = "" if failure is None else (end.err or end.out)[-3000:]
    return Outcome(case, command, tuple(done), end.status, end.seconds, failure, detail, edits)


def _damaged(folder: Path, entry: Entry, fault: str, rng: np.random.Generator) -> str:
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


def _resources(fault: str, folder: Path, entry: Entry, rng: np.random.Generator) -> tuple[Conditions, str]:
    if fault == "kill":
        after = float(rng.uniform(0.0, 2.5))
        return Conditions(killed_after_s=after), f"killed after {after:.3f} s"
    if fault == "memory":
        size = int(2 ** rng.uniform(20, 29))
        return Conditions(memory_bytes=size), f"{size / 2**20:.0f} MiB of memory"
    if fault == "disk":
        size = int(2 ** rng.uniform(12, 20))  # messages are files too
        return Conditions(file_bytes=size), f"files of at most {size} bytes"
    if fault == "streams":
        streams = {
            int(n): [None, "/dev/full"][int(rng.integers(2))] for n in rng.choice([1, 2], int(rng.integers(1, 3)))
        }
        return Conditions(streams=streams), f"standard streams {streams}"
    kind = str(rng.choice(["unreadable", "read-only"]))
    os.chmod(folder.parent, 0o755)
    if kind == "unreadable":
        target = folder / entry.inputs[0]
        os.chmod(target, 0)
        os.chmod(folder, 0o777)
    return Conditions(is_nobody=True), f"rights: {kind}"


def _written(command: str) -> tuple[str, ...]:
    words = command.split()
    written = [words[i + 1] for i, word in enumerate(words) if word == "-o"]
    return tuple(name for place in written for name in (place, f"{place}.mapping.toml", f"{place}-journal"))


def _content(folder: Path, leave_out: tuple[str, ...]) -> dict[str, str]:
    """Return the digest of every file outside of what the command may write."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if name.split("/")[0] in leave_out or not stat.S_ISREG(path.lstat().st_mode):
            continue
        size = path.lstat().st_size
        found[name] = str(size) if size > 2**28 else hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _wrong(command: str, end: End, conditions: Conditions) -> str | None:
    if conditions.killed_after_s is not None and end.status == -9:
        return None
    if end.hung:
        return f"no end within {end.seconds:.0f} s"
    if "Traceback" in end.err or end.status == 98:
        return "traceback: " + (end.err.strip().splitlines() or ["?"])[-1][:200]
    if end.status not in _DOCUMENTED:
        return f"status {end.status}"
    streams = conditions.streams or {}
    if end.status in (1, 2) and not streams and not _gives_reason(command, end):
        return f"status {end.status} with {len(end.err.splitlines())} lines on standard error"
    if any(not (c.isprintable() or c in "\n\t") for c in end.out + end.err):
        return "control characters reach the terminal"
    return None


def _wrong_again(command: str, end: End) -> str | None:
    """Return what is wrong with the end of a command that was cut short before: it may refuse what it finished then."""
    refuses_used = command.startswith(("stream", "simulate", "import", "init"))
    is_done = end.status == 2 and (refuses_used or "is in the map already" in end.err)
    if end.status == 0 or is_done:
        return None
    return f"afterwards the same command ends with {end.status}: {end.err[-300:]}"


def _gives_reason(command: str, end: End) -> bool:
    """Return whether one line on standard error says why the command ended."""
    lines = [line for line in end.err.splitlines() if not line.startswith(("trackfg: note", "trackfg: warning"))]
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


def _left(
    folder: Path, kept: dict[str, str], command: str, end: End, conditions: Conditions, old_result: bool
) -> str | None:
    """Return what is wrong with what the command left in its folder."""
    written = _written(command)
    was_killed = conditions.killed_after_s is not None
    now = _content(folder, leave_out=written)
    if lost := sorted(name for name in kept if now.get(name) != kept[name]):
        return f"changed: {', '.join(lost)[:200]}"
    left = sorted(name for name in now if name not in kept and not (was_killed and name.startswith(".")))
    if kept and left and not (was_killed and all(name.endswith("-journal") for name in left)):
        return f"left over: {', '.join(left)[:200]}"
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
