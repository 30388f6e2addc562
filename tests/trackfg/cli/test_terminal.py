"""What commands show on a terminal, and what ``--quiet`` leaves of it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import shlex
import struct
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.table import Table
from rich.text import Text

from trackfg.cli.terminal import command, show
from trackfg.datasets.scenarios import simulate

OnTerminal = Callable[..., str]
_COLUMNS = 80


MAIN = "from trackfg.cli.main import main; main()"


@pytest.fixture
def on_terminal(forked: Any) -> OnTerminal:
    """Return what runs a command of trackfg on a terminal of 80 columns."""

    def run(*arguments: object, stdout: bool = True, status: int = 0) -> str:
        """Return what the command writes to the terminal, by either stream or by stderr alone.

        Its exit status has to be ``status``.
        """
        ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, _COLUMNS, 0, 0))
        terminal, shown = Path(os.ttyname(theirs)), b""
        out = terminal if stdout else Path(os.devnull)
        forked.begin(MAIN, *arguments, streams=(None, out, terminal), environment=_environment())
        while (is_running := forked.runs()) or select.select([ours], [], [], 0.0)[0]:
            if select.select([ours], [], [], 0.01 if is_running else 0.0)[0]:
                shown += os.read(ours, 4096)
        os.close(ours)
        os.close(theirs)
        assert forked.end() == status, shown
        return _text(shown)

    return run


def in_new_interpreter(*arguments: object) -> str:
    """Return what a command of trackfg, which ends well, writes to a terminal of 80 columns."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, _COLUMNS, 0, 0))
    command = [sys.executable, "-m", "trackfg", *map(str, arguments)]
    with subprocess.Popen(command, stdout=theirs, stderr=theirs, env=_environment()) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                shown += os.read(ours, 4096)
            except OSError:  # the terminal is closed when the process ends
                break
    os.close(ours)
    assert process.returncode == 0, shown
    return _text(shown)


def _environment() -> dict[str, str]:
    environment = {name: text for name, text in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    return {**environment, "TERM": "xterm"}


def _text(shown: bytes) -> str:
    """Return what was shown, without control sequences."""
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terminal") / "run"
    simulate("trolley", seed=0, duration_s=40.0).write(folder)
    return folder


def test_progress_of_a_simulation(on_terminal: OnTerminal, tmp_path: Path) -> None:
    shown = on_terminal("simulate", "trolley", "-o", tmp_path / "a", "--duration", 20)
    assert "sensors" in shown
    assert "left" in shown
    assert on_terminal("simulate", "trolley", "-o", tmp_path / "b", "--duration", 20, "--quiet") == ""


def test_progress_of_a_check(on_terminal: OnTerminal, recording: Path) -> None:
    assert re.search(r"reading +━+ +0% \d:\d\d:\d\d .* left", on_terminal("check", recording))
    shown = on_terminal("--quiet", "check", recording)
    assert "━ " not in shown
    assert "Nothing to report" in shown or "Findings" in shown  # the list that was asked for


def test_progress_of_smoothing(on_terminal: OnTerminal, recording: Path, tmp_path: Path) -> None:
    assert "%" in on_terminal("smooth", recording, "-o", tmp_path / "out", stdout=False)


def test_a_command_shows_at_once_that_it_has_begun_and_at_last_what_follows(
    recording: Path, tmp_path: Path, trackfg: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    shown = in_new_interpreter("smooth", recording, "-o", tmp_path / "out")
    assert shown.index("starting") < shown.index("Summary")
    assert shown.rstrip().splitlines()[-1].startswith("next: trackfg report ")
    done = trackfg("check", recording)
    assert done.returncode == 0
    assert "next:" not in done.stdout + done.stderr  # a program that reads it wants what was asked for


def test_messages_break_between_words(on_terminal: OnTerminal, recording: Path) -> None:
    shown = on_terminal("report", recording, "-o", "nowhere/page.html", status=2)
    lines = shown.splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= _COLUMNS
    assert " ".join(lines[-3:]).count("expected a folder that trackfg wrote") == 1


def test_a_stream_shows_where_it_is(on_terminal: OnTerminal, recording: Path, tmp_path: Path) -> None:
    shown = on_terminal("stream", recording, "-o", tmp_path / "a", "--lag", 5)
    status = re.findall(r"([\d.]+) s (-?[\d.]+) m (-?[\d.]+) km/h delay ([\d.]+) s \d+ events?", shown)
    assert float(status[-1][0]) == pytest.approx(40.0, abs=1.0)
    assert "keyframes; " in shown
    assert on_terminal("stream", recording, "-o", tmp_path / "b", "--lag", 5, "-q") == ""


def test_a_comparison_shows_the_names_of_systems_whole(
    on_terminal: OnTerminal, recording: Path, tmp_path: Path
) -> None:
    shown = on_terminal("compare", recording, "-o", tmp_path / "comparison")
    for name in ("complementary", "accelerometer", "dead-reckoning"):
        assert re.search(rf"│ .? ?{name} +│", shown)


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
