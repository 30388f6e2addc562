"""Memory is not given back or looked through where that only takes time.

Freed memory stays with the process, so that the next array of its size need not be mapped and cleared again.

glibc maps each block above 32 MB anew and gives it back when it is freed (``man mallopt``: ``M_MMAP_THRESHOLD``). The
kernel clears every page of it at first use. A run of an hour makes many temporaries of 17 MB and more, one of four
hours nothing but: a third of its CPU time was the kernel's. ``docs/performance.md`` has the measurement. All
threads share one heap, so that each array may take what any other left.

Python looks through all objects for cycles now and then, and before it ends. Modules are no garbage, and what is left
at the end goes with the process: ten minutes of a run took 0.5 s of 2.7 s for that.
"""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8
"""Numbers of glibc's parameters, as ``malloc.h`` has them."""

_LARGEST = 2**31 - 1
"""Bytes at the end of the heap from which on they are given back: the largest value of the parameter."""


def keep_freed_memory() -> None:
    """Have this process keep what it frees until it ends, or comes near the limit of
    :mod:`trackfg.numerics.bounded_memory`; nothing happens where the C library is not glibc.
    """
    if os.name != "posix":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_TRIM_THRESHOLD, _LARGEST)
        mallopt(_M_ARENA_MAX, 1)


@contextmanager
def without_collection() -> Iterator[None]:
    """Import inside this: what is there at its end is never looked through."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def leave_the_rest() -> None:
    """Have the process end without a last look through what it still holds."""
    gc.freeze()
