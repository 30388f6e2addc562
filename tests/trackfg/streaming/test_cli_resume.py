"""``trackfg stream --resume`` after real kills, through the real entry point."""

from __future__ import annotations

import contextlib
import io
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.cli import main
from trackfg.cli.stream import StreamOptions, _into_folder
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.files.atomic_file import UNFINISHED
from trackfg.files.owned_folder import sole_writer
from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints
from trackfg.streaming.sinks.parquet_parts import read_parts

from .conftest import setting_off

NOTHING = Path("/dev/null")
TRACKFG = [sys.executable, "-m", "trackfg", "stream"]
DESCRIPTION = {
    "id": "lines",
    "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]},
    "tach": {"column": "s", "kind": "distance", "unit": "m", "signed": True},
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stream") / "run"
    simulate(setting_off("trolley", 30.0), seed=0, duration_s=80.0).write(folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def said(arguments: list[object]) -> str:
    """On standard error, where all went well."""
    return _written(0, arguments)


def refused(arguments: list[object]) -> str:
    """On standard error, where the input is bad."""
    return _written(2, arguments)


def _written(status: int, arguments: list[object], lines: Path = NOTHING) -> str:
    """Return what the command, in this process, writes to standard error until it ends with a status."""
    with (
        lines.open() as rows,
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stderr(io.StringIO()) as text,
    ):
        patch.setattr(sys, "stdin", rows)
        patch.setattr(sys, "argv", ["trackfg", "stream", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main.main()
    assert int(ended.value.code or 0) == status, text.getvalue()
    return text.getvalue()


def said_of_lines(arguments: list[object], lines: Path) -> str:
    """On standard error of the command that reads lines on standard input, where all went well."""
    return _written(0, arguments, lines)


def killed(out: Path, arguments: list[object], wait_s: float, lines: Path = NOTHING) -> bool:
    """Killed some time after its next checkpoint; False where it ended before."""
    path = out / "checkpoint"
    before = path.stat().st_mtime_ns if path.exists() else 0
    with lines.open("rb") as rows:
        command = [*TRACKFG, *map(str, arguments), "-o", str(out)]
        process = subprocess.Popen(command, stdin=rows, stderr=subprocess.DEVNULL)
    try:
        while process.poll() is None and (not path.exists() or path.stat().st_mtime_ns == before):
            time.sleep(0.01)
        time.sleep(wait_s)
    finally:
        process.kill()
    return process.wait() == -signal.SIGKILL


def test_a_killed_stream_goes_on_to_the_same_files(recording: Path, tmp_path: Path) -> None:
    out, arguments = tmp_path / "out", [recording, "--lag", "5", "--checkpoint-every", "3"]
    said([*arguments, "-o", tmp_path / "whole"])
    wait_s, kills = np.random.default_rng(0).uniform(0.0, 0.3, 2), 0
    assert killed(out, arguments, wait_s[0])
    assert "holds an unfinished stream: go on with it by --resume" in refused([*arguments, "-o", out])
    for wait in wait_s[1:]:
        if not killed(out, [*arguments, "--resume"], wait):
            break
        kills += 1
    assert kills
    assert " rows, " in said([*arguments, "-o", out, "--resume"])
    assert contents(out) == contents(tmp_path / "whole")
    lock = out / ".unfinished-checkpoint.lock"  # of a stream that was killed when it had just ended
    lock.touch()
    assert "the stream in it is finished" in said([*arguments, "-o", out, "--resume"])
    assert not lock.exists()
    assert "a stream is never added to another" in refused([*arguments, "-o", out])


def lines_of_a_trolley() -> list[str]:
    """Return 30 s of a trolley as JSON lines, the description first."""
    run = simulate("trolley", seed=0, duration_s=30.0).recording
    names = ("t", "wx", "wy", "wz", "fx", "fy", "fz")
    assert run.tach is not None
    keyed = [(row[0], {"table": "tach", "t": row[0], "s": row[1]}) for row in run.tach.to_numpy().tolist()]
    keyed += [
        (row[0], {"table": "imu", **dict(zip(names, row, strict=True))}) for row in run.imu.to_numpy()[::2].tolist()
    ]
    rows = [json.dumps(row) for _, row in sorted(keyed, key=lambda one: one[0])]
    return [json.dumps({"description": DESCRIPTION}), *rows]


def test_a_live_feed_goes_on_from_now(tmp_path: Path) -> None:
    """A device that was off for 3 s sends what it measures now; what it measured meanwhile is a gap."""
    first, *rows = lines_of_a_trolley()
    until = next(i for i, row in enumerate(rows) if json.loads(row)["t"] > 20.0)
    after = next(i for i, row in enumerate(rows) if json.loads(row)["t"] > 23.0)
    lines, out = tmp_path / "lines.jsonl", tmp_path / "out"
    arguments: list[object] = ["-", "--lag", "5", "--checkpoint-every", "3", "-o", out]
    with subprocess.Popen([*TRACKFG, *map(str, arguments)], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as feed:
        assert feed.stdin is not None
        feed.stdin.write("\n".join([first, *rows[:until], ""]).encode())
        feed.stdin.flush()
        while not (out / "checkpoint").exists() or Checkpoints(out / "checkpoint", every_s=3.0).read().until_s is None:
            time.sleep(0.01)
        feed.kill()
    lines.write_text("\n".join([first, *rows[after:]]))
    refusal = _written(2, [*arguments, "--resume"], lines)

    written = said_of_lines([*arguments, "--resume", "--from-now"], lines)

    assert "--from-now takes the description and the lines that come now" in refusal
    assert " s with the lines that come now; what was sent since then is missing" in written
    t = read_parts(out, "smoothed")["t_s"]
    assert t.iloc[-1] > 29.0
    assert "gap" in set(read_parts(out, "events")["kind"])


@pytest.mark.slow
def test_lines_are_passed_over_that_were_sent_before(tmp_path: Path) -> None:
    lines, out = tmp_path / "lines.jsonl", tmp_path / "out"
    lines.write_text("\n".join(lines_of_a_trolley()))
    arguments: list[object] = ["-", "--lag", "5", "--checkpoint-every", "3"]
    said_of_lines([*arguments, "-o", tmp_path / "whole"], lines)
    assert killed(out, arguments, 0.0, lines)
    assert killed(out, [*arguments, "--resume"], 0.3, lines)
    again = said_of_lines([*arguments, "-o", out, "--resume"], lines)
    assert "lines are passed over, which have to be those sent before" in again
    assert contents(out) == contents(tmp_path / "whole")


def test_what_resume_is_refused_for(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert killed(out, [recording, "--lag", "5", "--checkpoint-every", "4"], 0.0)
    (out / "mine.txt").write_text("mine")
    before = contents(out)
    resumed: list[object] = [recording, "-o", out, "--resume", "--lag"]
    assert "made with another lag" in refused([*resumed, "6"])
    (tmp_path / "c.toml").write_text("[output]\nrate_hz = 5.0\n")
    assert "another configuration" in refused([*resumed, "5", "--config", tmp_path / "c.toml"])
    damaged = bytearray(before["checkpoint"])
    damaged[-100] ^= 1
    (out / "checkpoint").write_bytes(damaged)
    assert f"{out}/checkpoint: damaged" in refused([*resumed, "5"])
    (out / "checkpoint").unlink()
    assert "a stream is never added to another" in refused([*resumed, "5"])
    assert "expected a folder" in refused([recording, "-o", "-", "--resume"])
    assert "--from-now: expected --resume and -" in refused([recording, "-o", out, "--resume", "--from-now"])
    assert "expected more than 0 s" in refused([recording, "-o", tmp_path / "new", "--checkpoint-every", "0"])
    assert not (tmp_path / "new").exists()
    # What the kill left of a checkpoint that was being written is removed by whatever command is next.
    kept = {name: content for name, content in before.items() if name != "checkpoint" and UNFINISHED not in name}
    assert contents(out) == kept


def test_a_folder_has_one_writer(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = subprocess.Popen([*TRACKFG, str(recording), "--real-time", "-o", str(out)], stderr=subprocess.DEVNULL)
    try:
        while not (out / "filtered").exists():
            time.sleep(0.02)
        assert "another process is writing to it" in refused([recording, "--resume", "-o", out])
    finally:
        first.kill()
        first.wait()


def test_what_another_process_is_just_beginning_is_left_alone(recording: Path, tmp_path: Path) -> None:
    unfinished = tmp_path / "out" / ".unfinished-checkpoint"
    unfinished.parent.mkdir()
    unfinished.write_bytes(b"half")
    with sole_writer(unfinished.parent):
        assert "another process is writing to it" in refused([recording, "-o", unfinished.parent])
    assert unfinished.read_bytes() == b"half"


def test_a_stream_that_was_written_meanwhile_is_left_alone(recording: Path, tmp_path: Path) -> None:
    """Another process finishes one in the same folder while this one opens its source."""
    out, written = tmp_path / "out", {}

    def opened(saved: Checkpoint | None) -> Any:
        said([recording, "--lag", "5", "-o", out])
        written.update(contents(out))

    with pytest.raises(BadInputError, match="a stream is never added to another"):
        _into_folder(StreamOptions(str(recording), str(out)), opened, lambda step: None)
    assert written
    assert contents(out) == written


def test_resume_begins_where_there_is_nothing(recording: Path, tmp_path: Path) -> None:
    """A service is started by the same command each time."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".unfinished-checkpoint").write_bytes(b"killed while it was written")
    said([recording, "--lag", "5", "--resume", "-o", tmp_path / "out"])
    assert len(read_parts(tmp_path / "out", "filtered")) > 30
