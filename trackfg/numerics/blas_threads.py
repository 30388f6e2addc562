"""Small matrices, many of them: several threads of the linear algebra would only wait for each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import scipy.linalg.lapack  # noqa: F401  (with its library loaded, the controller finds it)
from threadpoolctl import ThreadpoolController

_inside = 0


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread inside the ``with``; one within another costs nothing."""
    global _inside
    _inside += 1
    try:
        if _inside > 1:
            yield
            return
        with _controller().limit(limits=1, user_api="blas"):
            yield
    finally:
        _inside -= 1


@cache
def _controller() -> ThreadpoolController:
    """Finding the loaded libraries takes milliseconds: once."""
    return ThreadpoolController()
