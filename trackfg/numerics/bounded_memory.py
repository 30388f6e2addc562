"""The memory of a long run is bounded: what does not fit lies in a scratch file, value by value the same.

Most arrays of a run grow with its length and are read from one end to the other. Those beyond a budget are laid into a
file that is mapped into memory (``kernels/scratch.cpp``): numpy works on them as on any, and their pages are read and
written by the operating system. Code that makes or uses arrays knows nothing of it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from trackfg.numerics.kernels import compiled_kernels

_SHARE_OF_ARRAYS = 0.4
"""Part of the memory that large arrays may take before they go to the file. The rest is for the interpreter and its
modules (0.25 GB), small arrays, what the heap loses between arrays, and pages of the file."""


@contextmanager
def bounded_memory(limit_bytes: int, folder: Path) -> Iterator[None]:
    """Keep the process's memory at about ``limit_bytes`` by arrays in a file of ``folder``.

    It holds for arrays that the calling thread makes inside the ``with``, by compiled kernels and under Linux.
    Elsewhere, and where no such file can be made, nothing happens. The file has no name, so that nothing is left of it
    however the process ends; where the disk is full, arrays stay in memory.

    A ``with`` inside another changes nothing: the outer limit holds. Nothing happens either where another library has
    set numpy's memory handler. A forked process makes its own arrays in memory, but cannot read its parent's in the
    file; a spawned one has no part in this.

    Parameters
    ----------
    limit_bytes
        Memory of the process to stay at, bytes.
    folder
        Where the file is, on a disk with room for the arrays.

    Examples
    --------
    >>> from pathlib import Path
    >>> import trackfg
    >>> recording = trackfg.read_recording("run1")
    >>> with trackfg.bounded_memory(2_000_000_000, Path(".")):
    ...     result = trackfg.smooth(recording)
    """
    if not compiled_kernels() or sys.platform != "linux":
        yield
        return
    from numpy._core.multiarray import _ARRAY_API

    from trackfg.numerics import compiled

    previous = None
    with suppress(OSError), tempfile.TemporaryFile(dir=folder, prefix=".trackfg-scratch-") as file:
        budget = round(_SHARE_OF_ARRAYS * limit_bytes)
        previous = compiled.spill(_ARRAY_API, file.fileno(), budget, limit_bytes)
    try:
        yield
    finally:
        if previous is not None:
            compiled.unspill(_ARRAY_API, previous)
