"""Linear algebra runs on one thread: with many small matrices, several only wait for each other.

What a step need not wait for is computed on one thread beside it (:class:`ThreadBeside`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from functools import cache
from typing import Self, TypeVar

import scipy.linalg.lapack  # noqa: F401  (with its library loaded, the controller finds it)
from threadpoolctl import ThreadpoolController

_Made = TypeVar("_Made")


class _Depth(threading.local):
    """The number of ``with one_thread()`` that the current thread is in."""

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


class ThreadBeside:
    """A thread makes calls beside the one that begins them, one after another; the ``with`` ends when all have."""

    def __enter__(self) -> Self:
        """Begin without a thread: the first call starts it."""
        self._pool = ThreadPoolExecutor(max_workers=1)
        return self

    def __exit__(self, *error: object) -> None:
        """Wait for what was begun."""
        self._pool.shutdown()

    def begin(self, call: Callable[[], _Made]) -> Future[_Made]:
        """Begin a call in the context of this thread, which settings of memory are part of."""
        return self._pool.submit(copy_context().run, call)


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the loaded libraries, which takes milliseconds to find: once."""
    return ThreadpoolController()
