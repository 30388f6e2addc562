"""Small matrices, many of them: several threads of the linear algebra would only wait for each other."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

import scipy.linalg.lapack  # noqa: F401  (with its library loaded, the controller finds it)
from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Linear algebra on one thread inside the ``with``."""
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


@cache
def _controller() -> ThreadpoolController:
    """Finding the loaded libraries takes milliseconds: once."""
    return ThreadpoolController()
