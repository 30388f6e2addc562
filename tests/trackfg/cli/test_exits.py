"""Commands end in one line and the documented status where output, memory or a stream is missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from trackfg.cli import main as command_line


def run(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    shell = command.replace("trackfg", f"{sys.executable} -m trackfg")
    return subprocess.run(["/bin/sh", "-c", shell], capture_output=True, text=True, cwd=cwd, check=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
def test_a_full_disk_behind_standard_output_is_one_line(tmp_path: Path) -> None:
    done = run("trackfg scenarios > /dev/full", tmp_path)
    assert (done.returncode, done.stderr) == (1, f"trackfg: {os.strerror(28)}\n")


def test_closed_streams_are_none_to_write_to(tmp_path: Path) -> None:
    assert run("trackfg check nowhere >&- 2>&-", tmp_path).returncode == 2
    assert run("trackfg scenarios 2>&-", tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (MemoryError("Unable to allocate 30.5 MiB"), "trackfg: out of memory (Unable to allocate 30.5 MiB). Hint: "),
        (MemoryError(), "trackfg: out of memory (MemoryError). Hint: "),
        (
            RuntimeError("can't start new thread"),
            "trackfg: out of memory or of processes (can't",
        ),
        (FileNotFoundError(2, "No such file or directory", "a\x1b[31mb"), r"trackfg: a\x1b[31mb: No such file"),
    ],
)
def test_what_the_system_refuses_is_one_line(
    error: Exception, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(command_line, "app", fail)
    with pytest.raises(SystemExit) as end:
        command_line.main()
    written = capsys.readouterr().err
    assert end.value.code == 1
    assert written.startswith(line)
    assert written.count("\n") == 1
