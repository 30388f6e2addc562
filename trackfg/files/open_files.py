"""Open files are held in reserve for what must not fail for want of them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager


@contextmanager
def files_in_reserve(count: int) -> Iterator[ExitStack]:
    """Hold so many open files until the block ends, or the stack that it yields is closed.

    Raises ``OSError`` where the process may not open as many.
    """
    with ExitStack() as reserve:
        for _ in range(count):
            reserve.callback(os.close, os.open(os.devnull, os.O_RDONLY))
        yield reserve
