"""Commands end in one line and the documented status where output, memory or a stream is missing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from trackfg.cli import main as entry
from trackfg.datasets.scenarios import simulate


def run(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    shell = command.replace("trackfg", f"{sys.executable} -m trackfg")
    return subprocess.run(["/bin/sh", "-c", shell], capture_output=True, text=True, cwd=cwd, check=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
def test_a_full_disk_behind_standard_output_is_one_line(tmp_path: Path) -> None:
    done = run("trackfg scenarios > /dev/full", tmp_path)
    assert (done.returncode, done.stderr) == (1, f"trackfg: {os.strerror(28)}\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
def test_a_full_disk_behind_standard_error_changes_no_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python itself would exit with 120 for what it cannot write at the end."""
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    assert run("trackfg check nowhere 2> /dev/full", tmp_path).returncode == 2
    assert run("trackfg scenarios 2> /dev/full", tmp_path).returncode == 0
    (tmp_path / "log.csv").write_text("a\n1\n", encoding="utf-8")
    assert run("trackfg import log.csv -o out 2> /dev/full", tmp_path).returncode in (1, 2)


def test_closed_streams_are_none_to_write_to(tmp_path: Path) -> None:
    assert run("trackfg check nowhere >&- 2>&-", tmp_path).returncode == 2
    assert run("trackfg scenarios 2>&-", tmp_path).returncode == 0


@pytest.mark.parametrize("encoding", ["ascii", "iso-8859-1", "cp1252"])
def test_letters_that_an_encoding_lacks_are_replaced(
    encoding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate("mainline", seed=1, duration_s=60.0).write(tmp_path / "run1")
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    shell = f"{sys.executable} -m trackfg check run1"
    done = subprocess.run(["/bin/sh", "-c", shell], capture_output=True, cwd=tmp_path, check=False)
    shown = done.stdout.decode(encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    assert "rad/s/?Hz" in shown
    assert ("\xb1" in shown) == (encoding != "ascii")


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

    monkeypatch.setattr(entry, "command_line", lambda: fail)
    with pytest.raises(SystemExit) as end:
        entry.main()
    written = capsys.readouterr().err
    assert end.value.code == 1
    assert written.startswith(line)
    assert written.count("\n") == 1


FILE_COMMANDS = {
    "plot": ["nowhere"],
    "limits": ["nowhere", "--limits", "cfr-213"],
    "report": ["nowhere"],
    "statistics": ["nowhere"],
    "balises": ["nowhere"],
    "noise": ["nowhere"],
    "export": ["nowhere"],
    "config": [],
    "map changes": ["nowhere", "line.gpkg"],
}


@pytest.mark.parametrize("command", FILE_COMMANDS)
def test_a_place_that_is_none_for_a_file_is_refused_before_anything_is_read(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("mine")
    for place, what in (
        ("folder", "is a folder; expected a file"),
        ("file/table", f"{tmp_path / 'file'} is a file; expected a folder to write into"),
        ("n" * 300, "too long; expected "),
    ):
        arguments = [*command.split(), *FILE_COMMANDS[command], "-o", str(tmp_path / place)]
        monkeypatch.setattr(sys, "argv", ["trackfg", *arguments])
        with pytest.raises(SystemExit) as end:
            entry.main()
        written = capsys.readouterr().err
        assert (end.value.code, written.count("\n")) == (2, 1)
        assert what in written
    assert (tmp_path / "file").read_text() == "mine"


Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run_here(trackfg: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return what runs a command line in this process, in the test's own folder."""
    monkeypatch.chdir(tmp_path)
    return lambda command: trackfg(*command.split())


def test_folders_above_a_file_are_made(run_here: Run, tmp_path: Path) -> None:
    done = run_here("config -o new/folder/settings.toml")
    assert done.returncode == 0
    assert (tmp_path / "new" / "folder" / "settings.toml").read_text().startswith("#")


def test_no_stream_is_begun_where_a_file_is(run_here: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for place, what in (("file", "file: exists; "), ("file/out", "is a file; expected a folder to write into")):
        done = run_here(f"stream nowhere -o {place}")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert what in done.stderr
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("command", ["demo -o file/demo", "map build nowhere -o file/line.gpkg"])
def test_no_work_begins_for_a_place_under_a_file(command: str, run_here: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    done = run_here(f"--quiet {command}")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "is a file; expected a folder to write into" in done.stderr


def test_folders_of_another_kind_are_named(run_here: Run, tmp_path: Path) -> None:
    heads = {
        "run": "recording.toml",
        "out": "summary.json",
        "live": "checkpoint",
        "base": "baseline.json",
        "store": "store.json",
    }
    for name, head in heads.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / head).write_text("{}")
    for command, what in (
        ("plot run", "run: is a recording; expected a trackfg result. Hint: trackfg smooth makes"),
        ("limits store --limits cfr-213", "store: is a store; expected a trackfg result. Hint: its folder results"),
        ("report store", "store: is a store; expected a folder that trackfg wrote: a result"),
        ("report run", "run: is a recording; expected a folder that trackfg wrote: a result"),
        ("report live", "live: is a stream; expected a folder that trackfg wrote: a result"),
        ("plot live", "live: is a stream; expected a trackfg result. Hint: smooth the recording"),
        ("plot base", "base: is a baseline's result; expected a trackfg result. Hint: trackfg compare makes"),
        ("smooth live -o new", "live: is a stream; expected a folder with recording.toml"),
        ("statistics run", "run: is a recording; expected a trackfg result. Hint: trackfg smooth makes"),
        ("smooth out -o new", "out: is a result; expected a folder with recording.toml"),
    ):
        done = run_here(command)
        assert done.returncode == 2
        assert what in done.stderr
