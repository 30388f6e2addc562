"""A process killed at any moment leaves the old result or none, whole, and the next run succeeds."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.files.atomic_folder import replaced_folder
from trackfg.results.result import Result

Make = Callable[..., Result]
Forked = Callable[..., subprocess.CompletedProcess[str]]

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
def test_killed_within_a_write(
    make_result: Make, tmp_path: Path, can_exchange: bool, there_before: bool, forked: Forked
) -> None:
    make_result(rows=5, recording_id="old").write(tmp_path / "a")
    make_result(rows=6, recording_id="new").write(tmp_path / "b")
    done = forked(KILLED_AT_EVERY_STEP, can_exchange, there_before, cwd=tmp_path)
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


def test_what_was_killed_while_it_wrote_into_another_write_goes_with_the_next(tmp_path: Path, forked: Forked) -> None:
    """A batch's commands write into the folder that the batch replaces."""
    assert forked(KILLED_WITHIN_ANOTHER, tmp_path / "out").returncode == -signal.SIGKILL
    assert any(path.name == "half" for path in tmp_path.rglob("*"))
    with replaced_folder(tmp_path / "out") as new:
        (new / "whole").touch()
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["out", "out/whole"]


KILLED_WHILE_IT_SMOOTHS = """
    # Children run the command. They are killed at moments spread over its work, densely from when it begins to write.
    import os, shutil, signal, sys, time
    from pathlib import Path
    import numpy as np
    from trackfg.cli.main import main
    from trackfg.results.result import Result

    there_before, new = sys.argv[1] == "True", sys.argv[2]
    out, expected = Path("out"), {"old" if there_before else "none", new}

    def smooth():
        sys.argv = ["trackfg", "smooth", "rec", "-o", "out"]
        try:
            main()
        except SystemExit as end:
            return end.code or 0
        return 0

    def start():
        shutil.rmtree(out, ignore_errors=True)
        if there_before:
            shutil.copytree("old", out)
        child = os.fork()
        if child == 0:
            os._exit(smooth())
        return child

    def has_ended(child):
        return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def killed(child):
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return Result.read(out).summary.recording_id if out.exists() else "none"

    assert smooth() == 0  # imports all that children need
    begun = time.monotonic()
    assert os.waitpid(start(), 0)[1] == 0
    whole_s = time.monotonic() - begun

    for moment_s in np.linspace(0.0, whole_s, 5):
        child = start()
        time.sleep(moment_s)
        assert killed(child) in expected
    for moment_s in np.linspace(0.0, 0.03, 5):
        child = start()
        while not has_ended(child) and not list(Path().glob(".out.trackfg-*")):
            time.sleep(0.0005)
        time.sleep(moment_s)
        assert killed(child) in expected
"""


SMOOTHED = """
    import sys
    from trackfg.cli.main import main
    sys.argv = ["trackfg", "smooth", "rec", "-o", "out"]
    main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("there_before", [True, False])
def test_smooth_killed_at_many_moments(make_result: Make, tmp_path: Path, there_before: bool, forked: Forked) -> None:
    """Forks import nothing, so that every moment is one of its work. An interpreter is started for it once as well."""
    simulate("mainline", seed=1, duration_s=10.0).write(tmp_path / "rec")
    make_result(recording_id="old").write(tmp_path / "old")
    command = [sys.executable, "-m", "trackfg", "smooth", "rec", "-o", "out"]

    def smoothed() -> str:
        assert forked(SMOOTHED, cwd=tmp_path).returncode == 0
        return Result.read(tmp_path / "out").summary.recording_id

    new = smoothed()
    assert new != "old"
    done = forked(KILLED_WHILE_IT_SMOOTHS, there_before, new, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not list(tmp_path.glob(".out.trackfg-*")):
            time.sleep(0.0005)
        process.kill()
    left = Result.read(tmp_path / "out").summary.recording_id if (tmp_path / "out").exists() else "none"
    assert left in {"old" if there_before else "none", new}
    assert smoothed() == new
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old", "out", "rec"]
