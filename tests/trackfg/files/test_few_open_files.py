"""A process that may open few files: a temporary folder goes all the same, whatever was done in it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="limits are POSIX")

_SCRIPT = """
import os, resource, sys
from pathlib import Path
from trackfg.errors import OutputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.temporary_folder import temporary_folder

target, further = Path(sys.argv[1]), int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_NOFILE, (os.dup(0) + further,) * 2)  # of which the copy is one
held = []
try:
    with temporary_folder(parent=target.parent) as scratch, replaced_folder(target) as new:
        (new / "parts").mkdir()
        (new / "parts" / "0.csv").touch()
        (scratch / "log").mkdir()
        while True:
            held.append(os.open(os.devnull, os.O_RDONLY))
except OSError as error:
    print(os.strerror(error.errno))
"""


@pytest.mark.parametrize("further", [1, 4, 5, 6, 9, 10, 11, 12, 30])
def test_nothing_is_left_where_no_further_file_may_be_opened(further: int, tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "old").touch()
    command = [sys.executable, "-c", _SCRIPT, str(target), str(further)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("Too many open files\n", "")
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.rglob("*"))] == ["out", "out/old"]
