"""One run is smoothed by ``trackfg smooth`` in a process of its own, which may crash, hang or take too much memory.

What it does, it does to itself: the caller gets an outcome, never an exception for what is the run's fault.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from trackfg.errors import OutputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.fleet.known_content import Sight, sight
from trackfg.io.content import content_files

ATTEMPTS = 3
"""A run is begun so often at most, if others killed its process: the first time, and twice again."""

NOT_TO_BE_TRUSTED = 3
"""Exit status of ``trackfg smooth`` where it wrote a result that did not converge."""

_POLL_S = 0.05
"""Time between two looks at a process, s: 20 MB at the 400 MB/s at which a smoothing takes up memory at most."""
_LOG_LINES, _LOG_LETTERS = 20, 4000
"""What is kept of the log of a run that failed."""
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_LAUNCHER = Path(__file__).with_name("die_with_parent.py")
_OTHERS_SIGNALS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
"""Signals that come from another process or the system, not from what the run itself does."""


@dataclass(frozen=True)
class Job:
    """What is to be smoothed. ``settings`` is TOML, ``result`` the folder to write.

    At most ``timeout_s`` and ``memory_bytes`` (resident) are allowed; None for no limit of time.
    """

    name: str
    recording: str
    result: str
    settings: str
    map: str | None = None
    timeout_s: float | None = None
    memory_bytes: int | None = None


@dataclass(frozen=True)
class Outcome:
    """How a job ended: ``reason`` and the last lines of its ``log`` where it failed, else None and nothing.

    ``killed``: another process killed it. ``recording`` is what its recording's files looked like before.
    """

    name: str
    reason: str | None = None
    log: str = ""
    seconds: float = 0.0
    killed: bool = False
    recording: Sight | None = None


class _FailedError(Exception):
    """A run left no result; its outcome is the argument."""


def run_isolated(job: Job, stop: threading.Event | None = None) -> Outcome:
    """Smooth a run in its own process, again where others killed that; ``stop`` calls it off.

    The result is there whole or not at all.
    """
    seen = sight(job.recording, *content_files(job.recording))
    for _ in range(ATTEMPTS):
        outcome = _attempt(job, stop or threading.Event())
        if not outcome.killed:
            return replace(outcome, recording=seen)
    return replace(outcome, reason=f"{outcome.reason}, {ATTEMPTS} times")


def _attempt(job: Job, stop: threading.Event) -> Outcome:
    started = time.monotonic()
    try:
        outcome = _published(job, stop)
    except _FailedError as failure:
        (outcome,) = failure.args
    except (OSError, OutputError) as error:
        outcome = Outcome(job.name, f"the result cannot be written: {error}")
    return replace(outcome, seconds=time.monotonic() - started)


def _published(job: Job, stop: threading.Event) -> Outcome:
    """Put the result in its place in one step. Raises :class:`_FailedError` where there is none; all stays then."""
    with replaced_folder(Path(job.result)) as new, _scratch() as scratch:
        outcome = _smoothed(job, new, scratch, stop)
        if outcome.reason is not None:
            raise _FailedError(outcome)
        return outcome


@contextmanager
def _scratch() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="trackfg-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _smoothed(job: Job, result: Path, scratch: Path, stop: threading.Event) -> Outcome:
    """Run ``trackfg smooth`` and watch it until it has ended."""
    settings, log = scratch / "settings.toml", scratch / "log"
    settings.write_text(job.settings, encoding="utf-8")
    command = [sys.executable, "-m", "trackfg", "smooth", job.recording, "-o", str(result), "--config", str(settings)]
    command += [] if job.map is None else ["--map", job.map]
    with log.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", str(_LAUNCHER), str(os.getpid()), *command],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env={**os.environ, **_ONE_THREAD, "PYTHONFAULTHANDLER": "1"},
            start_new_session=True,
        )
        try:
            reason = _watched(process, job, stop)
        finally:
            _end(process)
    if reason is None and process.returncode in (0, NOT_TO_BE_TRUSTED):
        return Outcome(job.name)
    text = _ESCAPES.sub("", log.read_bytes()[-10 * _LOG_LETTERS :].decode("utf-8", "replace"))
    tail = "\n".join(text.strip().splitlines()[-_LOG_LINES:])[-_LOG_LETTERS:]
    if reason is not None:
        return Outcome(job.name, reason, tail)
    if process.returncode < 0:
        name = _signal_name(-process.returncode)
        if -process.returncode in _OTHERS_SIGNALS:
            return Outcome(job.name, f"killed from outside by {name}", tail, killed=True)
        return Outcome(job.name, f"crashed with {name}", tail)
    return Outcome(job.name, _message(tail) or f"ended with status {process.returncode}", tail)


def _watched(process: subprocess.Popen[bytes], job: Job, stop: threading.Event) -> str | None:
    """Wait for a process; return why it has to end before it did by itself, else None."""
    deadline = None if job.timeout_s is None else time.monotonic() + job.timeout_s
    while process.poll() is None:
        if stop.is_set():
            return "called off"
        if deadline is not None and time.monotonic() > deadline:
            return f"not done after {job.timeout_s:g} s (--timeout)"
        if job.memory_bytes is not None and (taken := _resident_bytes(process.pid)) > job.memory_bytes:
            return f"took {taken / 1e9:.2f} GB of memory, more than {job.memory_bytes / 1e9:g} GB (--memory)"
        with suppress(subprocess.TimeoutExpired):
            process.wait(_POLL_S)
    return None


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and what it has started, if it still runs."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _resident_bytes(process: int) -> int:
    """Return the memory that a process holds; 0 where it has ended or the system does not say."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _signal_name(number: int) -> str:
    with suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"


def _message(log: str) -> str | None:
    """Return what the command said why it failed, else the last line of its log."""
    lines = [line for line in log.splitlines() if line.strip()]
    said = [line.removeprefix("trackfg: ") for line in lines if line.startswith("trackfg: ")]
    errors = [line for line in said if not line.startswith(("warning: ", "note: "))]
    return next(iter((errors or lines)[-1:]), None)
