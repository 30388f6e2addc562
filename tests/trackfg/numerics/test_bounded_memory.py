"""Arrays beyond a limit lie in a file: the memory is bounded, and every value the same."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trackfg.datasets import Simulation
from trackfg.numerics.bounded_memory import bounded_memory
from trackfg.numerics.kernels import compiled_kernels
from trackfg.smoothing.smoother import smooth

in_file = pytest.mark.skipif(
    not compiled_kernels() or sys.platform != "linux", reason="arrays lie in a file with compiled kernels under Linux"
)

_PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from trackfg.numerics.bounded_memory import bounded_memory

with bounded_memory(200_000_000, Path(sys.argv[1])):
    columns = [np.full(1_000_000, float(i)) for i in range(100)]
    assert [(2.0 * column).max() for column in columns] == [2.0 * i for i in range(100)]
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
"""Makes 0.8 GB of arrays, reads them all, and prints its peak memory, kB."""

_FREED = """
import sys
from pathlib import Path
import numpy as np
from trackfg.cli.freed_memory import keep_freed_memory
from trackfg.numerics.bounded_memory import bounded_memory

keep_freed_memory()
with bounded_memory(500_000_000, Path(sys.argv[1])):
    blocks = [bytes(100_000) for _ in range(6_000)]
    newest = blocks.pop()  # the free memory is below it
    del blocks
    columns = [np.full(1_000_000, float(i)) for i in range(100)]
    assert [column.max() for column in columns] == list(range(100))
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("RssAnon")))
"""
"""Frees 0.6 GB of small blocks, makes 0.8 GB of arrays, and prints the memory that is not of files, kB."""

_FORK = """
import os
import sys
from pathlib import Path
import numpy as np
from trackfg.numerics.bounded_memory import bounded_memory

with bounded_memory(1, Path(sys.argv[1])):
    column = np.arange(1_000_000.0)
    child = os.fork()
    if child == 0:
        assert np.arange(1_000_000.0).sum() == 499_999_500_000.0
        del column
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert column.sum() == 499_999_500_000.0
"""
"""Makes an array in a forked process, which frees its parent's array, too."""

_NESTED = """
import sys
from pathlib import Path
import numpy as np
from trackfg.numerics.bounded_memory import bounded_memory

with bounded_memory(1, Path(sys.argv[1])):
    with bounded_memory(1_000_000_000, Path(sys.argv[1])):
        columns = [np.ones(2**18) for _ in range(3)]  # whole places, one next to the other
    assert sum(column.sum() for column in columns) == 3 * 2**18
"""
"""Makes arrays in the file of the outer of two limits."""

_FRAGMENTED = """
import os
import sys
from pathlib import Path
import numpy as np
from trackfg.numerics.bounded_memory import bounded_memory

def size():
    links = [entry.path for entry in os.scandir("/proc/self/fd") if os.readlink(entry.path).startswith(sys.argv[1])]
    return os.stat(links[0]).st_size

with bounded_memory(1, Path(sys.argv[1])):
    columns = [np.full(2**20, float(i)) for i in range(16)]
    allocated = size()
    for _ in range(2):
        del columns[::2]
        long = np.arange(7.0 * 2**20)
        assert long.sum() == 0.5 * 7 * 2**20 * (7 * 2**20 - 1)
        assert [column.min() for column in columns] == [column.max() for column in columns] == list(range(1, 16, 2))
        del long
        columns = [column for i, column in enumerate(columns) for column in (np.full(2**20, 2.0 * i), column)]
    assert size() == allocated
"""
"""Makes an array of 56 MiB twice where the file has gaps of 8 MiB."""


@in_file
def test_memory_is_bounded_and_nothing_is_left(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _PROGRAM, str(tmp_path)]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    assert 1024 * int(run.stdout) < 400_000_000
    assert not list(tmp_path.iterdir())


@in_file
def test_what_small_blocks_freed_is_not_kept(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _FREED, str(tmp_path)]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    assert 1024 * int(run.stdout) < 400_000_000


@in_file
def test_a_run_is_the_same_with_all_its_arrays_in_the_file(
    simulated: Callable[..., Simulation], tmp_path: Path
) -> None:
    recording = simulated("mainline", duration_s=120.0).recording
    usual = smooth(recording)
    with bounded_memory(1, tmp_path):
        spilled = smooth(recording)
    assert usual.trajectory.equals(spilled.trajectory)
    assert usual.geometry.equals(spilled.geometry)
    assert np.array_equal(usual.covariance.matrix, spilled.covariance.matrix)


@in_file
def test_arrays_outlive_the_limit(tmp_path: Path) -> None:
    with bounded_memory(1, tmp_path):
        column = np.arange(1_000_000.0)
        grown = np.arange(500_000.0)
        grown.resize(2_000_000, refcheck=False)
    assert column.sum() == 499_999_500_000.0
    column.resize(100, refcheck=False)
    assert column.sum() == 4950.0
    assert grown[:500_000].sum() == grown.sum() == 124_999_750_000.0


@in_file
@pytest.mark.parametrize("program", [_FORK, _NESTED, _FRAGMENTED], ids=["forked", "nested", "fragmented"])
def test_forks_and_nested_limits_do_no_harm_and_gaps_are_filled(program: str, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", "-c", program, str(tmp_path)]
    run = subprocess.run(command, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@in_file
def test_without_a_place_for_a_file_arrays_are_in_memory(tmp_path: Path) -> None:
    with bounded_memory(1, tmp_path / "missing"):
        column = np.arange(1_000_000.0)
    assert column.sum() == 499_999_500_000.0


@pytest.mark.parametrize("kernels", ["numpy"], indirect=True)
@pytest.mark.usefixtures("kernels")
def test_numpy_alone_computes_without_a_file(tmp_path: Path) -> None:
    with bounded_memory(1, tmp_path):
        column = np.arange(1_000_000.0)
    assert column.sum() == 499_999_500_000.0
