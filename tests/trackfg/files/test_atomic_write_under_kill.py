"""A process killed at any moment leaves the old result or none, whole, and the next run succeeds."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.files.atomic_folder import replaced_folder
from trackfg.results.result import Result

Make = Callable[..., Result]

KILLED_AT_EVERY_STEP = """
    # A child writes and kills itself just before its n-th call that could change the disk or a lock, n = 1, 2, ...
    # until it lives to the end: so every state that a kill can leave behind is met once.
    import errno, os, shutil, signal, sys
    from pathlib import Path
    from trackfg.errors import BadInputError
    from trackfg.files import atomic_folder
    from trackfg.results.result import RESULT_FOLDER, Result

    can_exchange, there_before = sys.argv[1] == "True", sys.argv[2] == "True"
    if not can_exchange:
        def refuse(a, b):
            raise OSError(errno.EINVAL, "Invalid argument")
        atomic_folder._exchange = refuse
    changing = {"open", "mkdir", "rename", "unlink", "rmdir", "flock", "fsync"}
    new, out = Result.read("b"), Path("out")
    files_of = {Result.read(path).summary.recording_id: RESULT_FOLDER.read(Path(path)) for path in ("a", "b")}

    def die_at(n):
        count = 0
        def on_call(frame, event, function):
            nonlocal count
            if event == "c_call" and function.__name__ in changing:
                count += 1
                if count == n:
                    os.kill(os.getpid(), signal.SIGKILL)
        sys.setprofile(on_call)

    def mark():
        # Read as results are, and whole: to the byte what was written before, or now.
        try:
            files = RESULT_FOLDER.read(out)
        except BadInputError as error:
            if not out.exists() and "expected a folder" in str(error):
                return "none"
            raise
        return next(name for name, whole in files_of.items() if files == whole)

    n, found = 0, set()
    while True:
        n += 1
        if there_before:
            shutil.copytree("a", out)
        child = os.fork()
        if child == 0:
            die_at(n)
            new.write(out)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        found.add(mark())
        new.write(out)
        assert {file.name: file.read_bytes() for file in out.iterdir()} == files_of["new"]
        assert [name for name in os.listdir() if name.startswith(".out")] == []
        shutil.rmtree(out)
        if status == 0:
            break
        assert os.WTERMSIG(status) == signal.SIGKILL
    print(n, *sorted(found))
"""


@pytest.mark.parametrize("can_exchange", [True, False])
@pytest.mark.parametrize("there_before", [True, False])
def test_killed_within_a_write(make_result: Make, tmp_path: Path, can_exchange: bool, there_before: bool) -> None:
    make_result(rows=5, recording_id="old").write(tmp_path / "a")
    make_result(rows=6, recording_id="new").write(tmp_path / "b")
    program = [
        sys.executable,
        "-c",
        textwrap.dedent(KILLED_AT_EVERY_STEP),
        str(can_exchange),
        str(there_before),
    ]
    done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    moments, *found = done.stdout.split()
    assert found == ["new", "old" if there_before else "none"]
    assert int(moments) > 15


KILLED_WITHIN_ANOTHER = """
    import os, signal, sys
    from pathlib import Path
    from trackfg.files.atomic_folder import replaced_folder

    with replaced_folder(Path(sys.argv[1])) as new, replaced_folder(new) as nested:
        (nested / "half").touch()
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_was_killed_while_it_wrote_into_another_write_goes_with_the_next(tmp_path: Path) -> None:
    """A batch's commands write into the folder that the batch replaces."""
    program = [sys.executable, "-c", textwrap.dedent(KILLED_WITHIN_ANOTHER), str(tmp_path / "out")]
    assert subprocess.run(program, check=False).returncode == -signal.SIGKILL
    assert any(path.name == "half" for path in tmp_path.rglob("*"))
    with replaced_folder(tmp_path / "out") as new:
        (new / "whole").touch()
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["out", "out/whole"]


@pytest.mark.slow
@pytest.mark.parametrize("there_before", [True, False])
def test_smooth_killed_at_many_moments(make_result: Make, tmp_path: Path, there_before: bool) -> None:
    """The whole command, killed at moments spread over its life, and densely from when it begins to write."""
    simulate("mainline", seed=1, duration_s=10.0).write(tmp_path / "rec")
    command = [sys.executable, "-m", "trackfg", "smooth", "rec", "-o", "out"]
    out = tmp_path / "out"

    def start() -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)

    def set_up() -> None:
        shutil.rmtree(out, ignore_errors=True)
        if there_before:
            make_result(recording_id="old").write(out)

    def kill(process: subprocess.Popen[bytes]) -> str:
        process.kill()
        process.wait()
        return Result.read(out).summary.recording_id if out.exists() else "none"

    begun = time.monotonic()
    assert start().wait() == 0
    whole_s = time.monotonic() - begun
    expected = {"old" if there_before else "none", Result.read(out).summary.recording_id}

    for moment_s in np.linspace(0.0, whole_s, 5):
        set_up()
        process = start()
        time.sleep(moment_s)
        assert kill(process) in expected
    for moment_s in np.linspace(0.0, 0.03, 5):
        set_up()
        process = start()
        while process.poll() is None and not list(tmp_path.glob(".out.trackfg-*")):
            time.sleep(0.0005)
        time.sleep(moment_s)
        assert kill(process) in expected

    assert start().wait() == 0
    assert Result.read(out).summary.recording_id in expected - {"old", "none"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "rec"]
