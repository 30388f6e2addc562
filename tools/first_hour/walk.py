"""A newcomer goes through the pages: every block is done as printed, in the order printed, in one empty folder.

Commands run on a terminal of 80 columns, by the programs that a user has; what they print is read as it comes, so that
the longest silence is known.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
import tomllib
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from first_hour.pages import ROOT, Block, blocks, spans, unfenced_commands
from first_hour.usage import wrong_words

_ROWS, _COLUMNS = 24, 80
"""The terminal's size, letters."""
_TIMEOUT_S = 3600.0
"""A command that takes longer, s, has failed: the first set-up takes half an hour where a machine is loaded."""
_SHOWN = 2000
"""Letters at the end of what a failed command printed, which say why."""


@dataclass(frozen=True)
class Step:
    """Something that a page says: where, what, how long it took and was silent at most, s, and what became of it.

    ``failure`` is empty where it worked. ``needs`` is what a machine may lack: the step was not done, only read.
    ``printed`` is what it wrote to the terminal, control characters and all.
    """

    place: str
    text: str
    seconds: float = 0.0
    silence_s: float = 0.0
    failure: str = ""
    needs: str = ""
    printed: str = ""


def walk(page: Path, folder: Path) -> Iterator[Step]:
    """Do all that a page says, in ``folder``, which holds what the pages before it left; ``tools`` is made there."""
    tools = folder / "tools"
    if not tools.exists():
        tools.symlink_to(ROOT / "tools")
    names: dict[str, Any] = {"__name__": "__main__"}
    for unfenced in unfenced_commands(page):
        yield Step(unfenced.split(": ")[0], "an indented block", failure=unfenced)
    for span in spans(page):
        if wrong := wrong_words(span):
            yield Step(str(page.relative_to(ROOT)), span, failure=f"there is no {', '.join(wrong)}")
    for block in blocks(page):
        yield from _steps(block, folder, names)


def _steps(block: Block, folder: Path, names: dict[str, Any]) -> Iterator[Step]:
    place = f"{block.page}:{block.line}"
    if block.language in ("sh", "text"):
        run = block.language == "sh" and not block.needs
        for line in block.commands:
            wrong = wrong_words(line)
            if wrong:
                yield Step(place, line, failure=f"there is no {', '.join(wrong)}")
            elif block.needs:
                yield Step(place, line, needs=block.needs)
            elif run:
                yield command(place, line, folder)
    elif block.language == "python":
        title = next(line for line in block.text.splitlines() if line.strip())
        if block.needs:
            yield Step(place, title, failure=_failure(compile, block.text, place, "exec"), needs=block.needs)
        else:
            yield _python(place, title, block.text, folder, names)
    elif block.needs:
        yield Step(place, f"{block.language} {block.name}", needs=block.needs)
    else:
        read = {"toml": tomllib.loads, "json": _json_lines}.get(block.language)
        failure = "" if read is None else _failure(read, block.text)
        if not block.language:
            failure = "names no language: sh and python are run, text is shown"
        if block.name and not failure:
            (folder / block.name).write_text(block.text, encoding="utf-8")
        yield Step(place, f"{block.language} {block.name}", failure=failure)


def _json_lines(text: str) -> None:
    for line in text.splitlines():
        json.loads(line)


def _failure(call: Any, *arguments: Any) -> str:
    try:
        call(*arguments)
    except (ValueError, SyntaxError) as error:
        return str(error)
    return ""


def _python(place: str, title: str, text: str, folder: Path, names: dict[str, Any]) -> Step:
    start, failure = time.perf_counter(), ""
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            exec(compile(text, place, "exec"), names)
        except Exception:
            failure = traceback.format_exc()[-_SHOWN:]
    return Step(place, title, time.perf_counter() - start, failure=failure, printed=printed.getvalue())


def command(place: str, line: str, folder: Path) -> Step:
    """Run a line of a shell in ``folder``, on a terminal, by the programs that a user has."""
    ours, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", _ROWS, _COLUMNS, 0, 0))
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    environment |= {"PATH": path, "TERM": "xterm-256color"}
    start = last = time.perf_counter()
    process = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", line],
        cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=terminal, stderr=terminal, start_new_session=True,
    )  # fmt: skip
    os.close(terminal)
    printed, silence = b"", 0.0
    while time.perf_counter() - start < _TIMEOUT_S:
        readable, _, _ = select.select([ours], [], [], 0.1)
        now = time.perf_counter()
        silence = max(silence, now - last)
        if not readable:
            continue
        try:
            chunk = os.read(ours, 65536)
        except OSError:  # the other end is closed: the command has ended
            break
        printed, last = printed + chunk, now
    else:
        os.killpg(process.pid, signal.SIGKILL)  # of its own session: whatever it has started ends, too
    os.close(ours)
    status = process.wait()
    text = printed.decode(errors="replace")
    failure = "" if status == 0 else f"exit status {status}: {text[-_SHOWN:]}"
    return Step(place, line, time.perf_counter() - start, silence, failure, printed=text)
