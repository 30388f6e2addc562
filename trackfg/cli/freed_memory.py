"""Freed memory stays with the process, so that the next array of its size need not be mapped and cleared again.

glibc maps each block above 32 MB anew and gives it back when it is freed (``man mallopt``: ``M_MMAP_THRESHOLD``). The
kernel clears every page of it at first use. A run of an hour makes many temporaries of 17 MB and more, one of four
hours nothing but: a third of its CPU time was the kernel's. ``docs/performance.md`` has the measurement.
"""

from __future__ import annotations

import ctypes
import os

_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
"""Numbers of glibc's parameters, as ``malloc.h`` has them."""

_LARGEST = 2**31 - 1
"""Bytes at the end of the heap from which on they are given back: the largest value of the parameter."""


def keep_freed_memory() -> None:
    """Have this process keep what it frees, until it ends; nothing happens where the C library is not glibc."""
    if os.name != "posix":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_TRIM_THRESHOLD, _LARGEST)
