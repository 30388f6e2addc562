"""A process that keeps what it frees has its pages mapped once."""

from __future__ import annotations

import ctypes
import gc
import subprocess
import sys
from types import SimpleNamespace

import pytest

from trackfg.cli.freed_memory import keep_freed_memory, leave_the_rest, without_collection

_PROGRAM = """
import resource
import numpy as np
from trackfg.cli.freed_memory import keep_freed_memory

if {keeps}:
    keep_freed_memory()
np.ones(12_000_000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(12_000_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def page_faults(*, keeps: bool) -> int:
    """Faults of a process that makes and frees an array of 96 MB twenty times."""
    command = [sys.executable, "-c", _PROGRAM.format(keeps=keeps)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library is not glibc")
def test_large_arrays_are_not_mapped_again() -> None:
    assert page_faults(keeps=True) < 0.1 * page_faults(keeps=False)


def test_another_c_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda _: SimpleNamespace())
    keep_freed_memory()


def test_what_is_imported_is_not_looked_through() -> None:
    before = gc.get_freeze_count()
    try:
        with without_collection():
            assert not gc.isenabled()
        assert gc.isenabled()
        assert gc.get_freeze_count() > before
    finally:
        gc.unfreeze()


def test_the_process_ends_without_a_look_through_the_rest() -> None:
    try:
        leave_the_rest()
        assert not gc.get_objects(generation=2)
    finally:
        gc.unfreeze()
