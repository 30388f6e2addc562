"""One run is smoothed by ``trackfg smooth`` in a process of its own, which may crash, hang or take too much memory.

The caller gets an outcome for all of these, never an exception.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from trackfg.errors import OutputError, first_line
from trackfg.files.temporary_folder import temporary_folder
from trackfg.fleet.catalogue import Run
from trackfg.fleet.key_figures import done_row
from trackfg.fleet.known_content import Sight, sight
from trackfg.fleet.places import PlaceError, content_of, local_recording, new_folder
from trackfg.results.result import RESULT_FOLDER

ATTEMPTS = 3
"""A run is begun this many times at most, where its process was killed from outside."""

NOT_TO_BE_TRUSTED = 3
"""Exit status of ``trackfg smooth`` where it wrote a result that did not converge."""

_POLL_S = 0.05
"""Time between two looks at a process, s: 20 MB at the 400 MB/s at which a smoothing takes up memory at most."""
_SHARE_OF_MEMORY = 0.5
"""Part of the memory allowed that ``trackfg smooth`` keeps to: what it holds besides large arrays comes on top."""
_LOG_LINES, _LOG_LETTERS = 20, 4000
"""What is kept of the log of a run that failed."""
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_LAUNCHER = Path(__file__).with_name("die_with_parent.py")
_OTHERS_SIGNALS = {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
"""Signals that come from another process or the system, not from what the run itself does."""


@dataclass(frozen=True)
class Job:
    """A run that is to be smoothed with settings, as TOML, into the folder ``result``.

    At most ``timeout_s`` and ``memory_bytes`` (resident) are allowed; None for no limit.
    """

    run: Run
    result: str
    settings: str
    timeout_s: float | None = None
    memory_bytes: int | None = None


@dataclass(frozen=True)
class Outcome:
    """The end of a job: ``reason`` and the last lines of its ``log`` where it failed, else its ``row`` of the
    catalogue.

    ``killed``: another process killed it. ``recording`` is what its recording's files looked like before.
    """

    name: str
    reason: str | None = None
    log: str = ""
    seconds: float = 0.0
    killed: bool = False
    recording: Sight | None = None
    row: dict[str, Any] | None = None


class _FailedError(Exception):
    """A run left no result; ``outcome`` says why."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


def run_isolated(job: Job, stop: threading.Event | None = None) -> Outcome:
    """Smooth a run in its own process, and again where that was killed from outside; ``stop`` ends the run.

    The result is there whole or not at all.
    """
    stop, started = stop or threading.Event(), time.monotonic()
    try:
        state = sight(job.run.recording, *content_of(job.run.recording))
        with local_recording(job.run.recording) as recording:
            outcome = replace(_attempts(job, recording, stop), recording=state)
    except PlaceError as error:
        outcome = Outcome(job.run.name, str(error))
    return replace(outcome, seconds=time.monotonic() - started)


def _attempts(job: Job, recording: Path, stop: threading.Event) -> Outcome:
    for _ in range(ATTEMPTS):
        outcome = _attempt(job, recording, stop)
        if not outcome.killed:
            return outcome
    return replace(outcome, reason=f"{outcome.reason}, {ATTEMPTS} times")


def _attempt(job: Job, recording: Path, stop: threading.Event) -> Outcome:
    try:
        return _published(job, recording, stop)
    except _FailedError as failure:
        return failure.outcome
    except (OSError, OutputError, PlaceError) as error:
        return Outcome(job.run.name, f"the result cannot be written: {error}")


def _published(job: Job, recording: Path, stop: threading.Event) -> Outcome:
    """Put the result in its place as a whole. Raises :class:`_FailedError` where there is none; all stays then."""
    with new_folder(job.result, RESULT_FOLDER.head) as new, temporary_folder() as scratch:
        outcome = _smoothed(job, recording, new, scratch, stop)
        if outcome.reason is not None:
            raise _FailedError(outcome)
        try:
            return replace(outcome, row=done_row(job.run, new))
        except ValueError as error:
            raise _FailedError(replace(outcome, reason=f"the result is none: {first_line(error)}")) from error


def _smoothed(job: Job, recording: Path, result: Path, scratch: Path, stop: threading.Event) -> Outcome:
    """Run ``trackfg smooth`` and watch it until it has ended."""
    settings, log = scratch / "settings.toml", scratch / "log"
    settings.write_text(job.settings, encoding="utf-8")
    command = [sys.executable, "-m", "trackfg", "smooth", str(recording), "-o", str(result), "--config", str(settings)]
    command += [] if job.run.map is None else ["--map", job.run.map]
    command += [] if job.run.known_line is None else ["--line", job.run.known_line]
    command += [] if job.memory_bytes is None else ["--memory", f"{_SHARE_OF_MEMORY * job.memory_bytes / 1e9:g}"]
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
        return Outcome(job.run.name)
    text = _ESCAPES.sub("", log.read_bytes()[-10 * _LOG_LETTERS :].decode("utf-8", "replace"))
    tail = "\n".join(text.strip().splitlines()[-_LOG_LINES:])[-_LOG_LETTERS:]
    if reason is not None:
        return Outcome(job.run.name, reason, tail)
    if process.returncode < 0:
        name = _signal_name(-process.returncode)
        if -process.returncode in _OTHERS_SIGNALS:
            return Outcome(job.run.name, f"killed from outside by {name}", tail, killed=True)
        return Outcome(job.run.name, f"crashed with {name}", tail)
    return Outcome(job.run.name, _message(tail) or f"ended with status {process.returncode}", tail)


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
    """Return the command's message about its failure, else the last line of its log."""
    lines = [line for line in log.splitlines() if line.strip()]
    messages = [line.removeprefix("trackfg: ") for line in lines if line.startswith("trackfg: ")]
    errors = [line for line in messages if not line.startswith(("warning: ", "note: "))]
    return next(iter((errors or lines)[-1:]), None)
