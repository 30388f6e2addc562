"""What commands show on a terminal, and what ``--quiet`` leaves of it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from rich.table import Table
from rich.text import Text

from trackfg.cli.terminal import command, show
from trackfg.datasets.scenarios import simulate

_COLUMNS = 80


def on_terminal(*arguments: object, stdout: bool = True, status: int = 0) -> str:
    """Return what a command of trackfg writes to a terminal of 80 columns, by either stream or by stderr alone.

    Its exit status has to be ``status``.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, _COLUMNS, 0, 0))
    environment = {name: text for name, text in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    command = [sys.executable, "-m", "trackfg", *map(str, arguments)]
    out = theirs if stdout else subprocess.DEVNULL
    with subprocess.Popen(command, stdout=out, stderr=theirs, env={**environment, "TERM": "xterm"}) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                shown += os.read(ours, 4096)
            except OSError:  # the terminal is closed when the process ends
                break
    os.close(ours)
    assert process.returncode == status, shown
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terminal") / "run"
    simulate("trolley", seed=0, duration_s=40.0).write(folder)
    return folder


def test_progress_of_a_simulation(tmp_path: Path) -> None:
    shown = on_terminal("simulate", "trolley", "-o", tmp_path / "a", "--duration", 20)
    assert "sensors" in shown
    assert "left" in shown
    assert on_terminal("simulate", "trolley", "-o", tmp_path / "b", "--duration", 20, "--quiet") == ""


def test_progress_of_a_check(recording: Path) -> None:
    assert re.search(r"reading +━+ +0% \d:\d\d:\d\d .* left", on_terminal("check", recording))
    shown = on_terminal("--quiet", "check", recording)
    assert "━ " not in shown
    assert "Nothing to report" in shown or "Findings" in shown  # the list that was asked for


def test_progress_of_smoothing(recording: Path, tmp_path: Path) -> None:
    assert "%" in on_terminal("smooth", recording, "-o", tmp_path / "out", stdout=False)


def test_a_command_shows_at_once_that_it_has_begun_and_at_last_what_follows(recording: Path, tmp_path: Path) -> None:
    shown = on_terminal("smooth", recording, "-o", tmp_path / "out")
    assert shown.index("starting") < shown.index("Summary")
    assert shown.rstrip().splitlines()[-1].startswith("next: trackfg report ")
    command = [sys.executable, "-m", "trackfg", "check", recording]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "next:" not in done.stdout + done.stderr  # a program that reads it wants what was asked for


def test_messages_break_between_words(recording: Path) -> None:
    shown = on_terminal("report", recording, "-o", "nowhere/page.html", status=2)
    lines = shown.splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= _COLUMNS
    assert " ".join(lines[-3:]).count("expected a folder that trackfg wrote") == 1


def test_a_stream_shows_where_it_is(recording: Path, tmp_path: Path) -> None:
    shown = on_terminal("stream", recording, "-o", tmp_path / "a", "--lag", 5)
    status = re.findall(r"([\d.]+) s (-?[\d.]+) m (-?[\d.]+) km/h delay ([\d.]+) s \d+ events?", shown)
    assert float(status[-1][0]) == pytest.approx(40.0, abs=1.0)
    assert "keyframes; " in shown
    assert on_terminal("stream", recording, "-o", tmp_path / "b", "--lag", 5, "-q") == ""


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_columns_break_between_words(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("trackfg.cli.terminal._WIDTH_IN_A_PIPE", width)
    table = Table(box=None, padding=(0, 1, 0, 0))
    table.add_column("landmark", overflow="fold")
    for heading in ("chainage", "radius", "cant", "transition"):
        table.add_column(heading, no_wrap=True)
    words = ("C0001-BTC Musashi-Kosugi", "123456.78 ± 12.34", "13342.6 ± 111.5", "94.9 ± 0.2", "137.7 ± 10.4")
    table.add_row(*words)
    show(table)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    if width >= 60:  # the longest words of all columns have room
        assert set(" ".join(words).split()) <= set(" ".join(lines).split())
    assert (len(lines) == 2) == (width == 120)


def test_control_characters_of_a_file_do_not_reach_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table()
    table.add_column("id")
    table.add_row(Text("\x1b[31m4711"))
    table.add_row(Text("two\nlines", style="red"))
    show(table)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    assert [r"\x1b[31m4711" in shown, "two" in shown, "lines" in shown, r"two\n" in shown] == [True, True, True, False]


def test_commands_to_go_on_with_are_as_a_shell_takes_them() -> None:
    shown = command("smooth", Path("Läufe ü/rec 1"), "-o", "out")
    assert shlex.split(shown) == ["trackfg", "smooth", "Läufe ü/rec 1", "-o", "out"]
