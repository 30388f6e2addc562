"""A command runs in a fork of this process, which has trackfg imported: a case takes no time to start."""

from __future__ import annotations

import http.client
import os
import re
import resource
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

TIME_S = 60.0
"""A command that takes more processor time hangs, s, and so does one that uses none for so long: it waits. All that the
sound inputs need is 2 s; time on a clock on the wall depends on what else the machine does."""
MEMORY_BYTES = 2 * 2**30
"""Memory that a command may take beyond what this process has mapped."""
NOBODY = 65534
"""The user that cases about rights run as."""
_LOOK_EVERY_S = 1.0
"""Time between two looks at the processor time of a command, s."""
_ASK_EVERY_S = 0.05
"""Time between two looks at whether pages are served yet, s."""
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Conditions:
    """What a command runs under, besides the limits: the time after which it is killed, memory and file size in
    bytes, standard streams that are closed or full, how many files it may open, whether its user owns nothing, and
    whether an interpreter is started for it, as everyone's is.
    """

    killed_after_s: float | None = None
    memory_bytes: int = MEMORY_BYTES
    file_bytes: int | None = None
    streams: Mapping[int, str | None] | None = None
    open_files: int | None = None
    is_nobody: bool = False
    is_started: bool = False


@dataclass(frozen=True)
class End:
    """``status``: of the exit, negative for a signal. ``hung``: it had to be ended. ``cpu_s``: processor time.

    ``unanswered`` is the first request without an answer, None where there is none.
    """

    status: int
    hung: bool
    seconds: float
    out: str
    err: str
    cpu_s: float = 0.0
    unanswered: str | None = None


class Running:
    """``trackfg command`` runs in a folder; ``stdin`` names a file in it. Pages that it serves get ``requests``."""

    def __init__(
        self,
        command: str,
        folder: Path,
        conditions: Conditions,
        stdin: str | None = None,
        requests: Sequence[str] = (),
    ) -> None:
        self.conditions = conditions
        self._requests, self._has_ended = requests, threading.Event()
        self._unanswered: str | None = None
        self._texts = [_new_file(folder.parent, prefix) for prefix in ("out-", "err-")]
        self._start = time.monotonic()
        self.process = os.fork()
        if self.process == 0:
            _become(command, folder, conditions, stdin, *self._texts)

    def has_ended(self) -> bool:
        return os.waitid(os.P_PID, self.process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def end(self) -> End:
        """Wait for the end, and bring it about where the time is over, or all requests are answered."""
        browser = threading.Thread(target=self._ask)
        if self._requests:
            browser.start()
        killed_after_s = self.conditions.killed_after_s
        looked, worked, used, hung, done = self._start, self._start, 0.0, False, 0
        while not done:
            done, status, usage = os.wait4(self.process, os.WNOHANG)
            now = time.monotonic()
            if not done and killed_after_s is None and now > looked + _LOOK_EVERY_S:
                looked, last_used, used = now, used, _processor_time_s(self.process)
                worked = worked if used == last_used else now
                hung = used > TIME_S or now - worked > TIME_S
            if not done and (hung or (killed_after_s is not None and now - self._start > killed_after_s)):
                os.kill(self.process, signal.SIGKILL)
                done, status, usage = os.wait4(self.process, 0)
            elif not done:
                time.sleep(0.002 if killed_after_s else 0.01)
        self._has_ended.set()
        if self._requests:
            browser.join()
        texts = [path.read_bytes()[:100_000].decode(errors="replace") for path in self._texts]
        for path in self._texts:
            path.unlink()
        seconds, cpu_s = time.monotonic() - self._start, usage.ru_utime + usage.ru_stime
        return End(os.waitstatus_to_exitcode(status), hung, seconds, *texts, cpu_s, self._unanswered)

    def _ask(self) -> None:
        """Ask for all addresses, as soon as the command says where it serves, and interrupt it then."""
        while not (served := re.search(rb"http://([\d.]+):(\d+)/", self._texts[1].read_bytes())):
            if self._has_ended.wait(_ASK_EVERY_S):
                return
        for path in self._requests:
            connection = http.client.HTTPConnection(served[1].decode(), int(served[2]))
            try:
                connection.request("GET", path)
                connection.getresponse().read()
            except (OSError, http.client.HTTPException) as error:
                self._unanswered = self._unanswered or f"{path} ({type(error).__name__})"
            finally:
                connection.close()
        with suppress(ProcessLookupError):
            os.kill(self.process, signal.SIGINT)


def run(
    command: str, folder: Path, conditions: Conditions, stdin: str | None = None, requests: Sequence[str] = ()
) -> End:
    """Run ``trackfg command`` in a folder and wait for its end."""
    return Running(command, folder, conditions, stdin, requests).end()


def _new_file(folder: Path, prefix: str) -> Path:
    """Make a file that any user may write."""
    descriptor, name = tempfile.mkstemp(prefix=prefix, dir=folder)
    os.close(descriptor)
    path = Path(name)
    path.chmod(0o666)
    return path


def _processor_time_s(process: int) -> float:
    """Return what a process and its ended children have used."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / _TICKS_PER_S


def _opened(stdin: str | None) -> int:
    """Open standard input; nothing where Python or a shell would not even start."""
    is_there = stdin is not None and Path(stdin).exists() and not Path(stdin).is_dir()
    return os.open(stdin if is_there and stdin else os.devnull, os.O_RDONLY | os.O_NONBLOCK)


def _become(command: str, folder: Path, conditions: Conditions, stdin: str | None, out: Path, err: Path) -> None:
    """Turn this process, a child, into the command; never returns."""
    code = 99
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore it
    try:
        os.chdir(folder)
        tempfile.tempdir = os.environ["TMPDIR"] = os.environ["HOME"] = str(folder.parent)
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
        if conditions.open_files is not None:
            taken = max(map(int, os.listdir("/proc/self/fd")))
            resource.setrlimit(resource.RLIMIT_NOFILE, (taken + conditions.open_files,) * 2)
        if conditions.is_nobody:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        if conditions.is_started:
            os.execv(sys.executable, [sys.executable, "-m", "trackfg", *command.split()])
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
