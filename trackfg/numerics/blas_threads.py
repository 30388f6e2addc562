"""Linear algebra on one thread: with many small matrices, several threads only wait for each other."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import scipy.linalg.lapack  # noqa: F401  (with its library loaded, the controller finds it)
from threadpoolctl import ThreadpoolController


class _Depth(threading.local):
    """How many ``with one_thread()`` the current thread is in."""

    value = 0


_DEPTH = _Depth()


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra on one thread inside the ``with``; one within another costs nothing.

    The number of threads belongs to the process. Where several threads use this at once, the first of them sets it and,
    when it leaves, puts it back (threadpoolctl 3.8 ignores what the others set meanwhile).
    """
    _DEPTH.value += 1
    try:
        if _DEPTH.value > 1:
            yield
            return
        with _controller().limit(limits=1, user_api="blas"):
            yield
    finally:
        _DEPTH.value -= 1


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the loaded libraries, which takes milliseconds to find: once."""
    return ThreadpoolController()
