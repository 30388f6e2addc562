"""A command runs in a fork of this process, which has trackfg imported: a case takes no time to start."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

TIME_S = 60.0
"""A command that takes longer hangs, s: all that the sound inputs need is 2 s."""
MEMORY_BYTES = 2 * 2**30
"""Memory that a command may take beyond what this process has mapped."""
NOBODY = 65534
"""The user that cases about rights run as."""


@dataclass(frozen=True)
class Conditions:
    """What a command runs under, besides the limits: the time after which it is killed, memory and file size in
    bytes, standard streams that are closed or full, and whether its user owns nothing.
    """

    killed_after_s: float | None = None
    memory_bytes: int = MEMORY_BYTES
    file_bytes: int | None = None
    streams: Mapping[int, str | None] | None = None
    is_nobody: bool = False


@dataclass(frozen=True)
class End:
    """``status``: of the exit, negative for a signal. ``hung``: it had to be ended."""

    status: int
    hung: bool
    seconds: float
    out: str
    err: str


def run(command: str, folder: Path, conditions: Conditions, stdin: str | None = None) -> End:
    """Run ``trackfg command`` in a folder and wait for its end."""
    out, err = folder.parent / "stdout", folder.parent / "stderr"
    for path in (out, err):
        path.touch()  # the child may be killed before it does
        path.chmod(0o666)
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        _become(command, folder, conditions, stdin, out, err)
    limit = conditions.killed_after_s or TIME_S
    status = None
    while status is None and time.monotonic() - start < limit:
        done, code = os.waitpid(child, os.WNOHANG)
        status = code if done else None
        if status is None:
            time.sleep(0.002 if conditions.killed_after_s else 0.01)
    ended = status is not None
    if status is None:
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    seconds = time.monotonic() - start
    texts = [path.read_bytes()[:100_000].decode(errors="replace") for path in (out, err)]
    return End(os.waitstatus_to_exitcode(status), not ended and conditions.killed_after_s is None, seconds, *texts)


def _opened(stdin: str | None) -> int:
    """Open standard input; nothing where Python or a shell would not even start."""
    is_there = stdin is not None and Path(stdin).exists() and not Path(stdin).is_dir()
    return os.open(stdin if is_there and stdin else os.devnull, os.O_RDONLY | os.O_NONBLOCK)


def _become(command: str, folder: Path, conditions: Conditions, stdin: str | None, out: Path, err: Path) -> None:
    """Turn this process, a child, into the command; never returns."""
    code = 99
    try:
        os.chdir(folder)
        os.dup2(_opened(stdin), 0)
        for number, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666), number)
        for number, place in (conditions.streams or {}).items():
            os.close(number) if place is None else os.dup2(os.open(place, os.O_RDWR), number)
        names = ("stdin", "stdout", "stderr")
        for number, name in enumerate(names):
            closed = (conditions.streams or {}).get(number, "") is None
            setattr(sys, name, None if closed else open(number, "r" if number == 0 else "w", closefd=False))  # noqa: SIM115
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + conditions.memory_bytes,) * 2)
        if conditions.file_bytes is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (conditions.file_bytes,) * 2)
        if conditions.is_nobody:
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        sys.argv = ["trackfg", *command.split()]
        from trackfg.cli.main import main

        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        if sys.stderr is not None:
            traceback.print_exc()
        code = 98
    finally:
        try:
            for stream in (sys.stdout, sys.stderr):
                if stream is not None:
                    stream.flush()
        except (OSError, ValueError):
            pass
        os._exit(code)
