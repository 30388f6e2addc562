"""Kernels are compiled from C++ where the installation could do so; numpy computes the same without them.

Their sources are in ``kernels/``, their types in ``compiled.pyi``. ``TRACKFG_KERNELS=numpy`` in the environment has
numpy compute everything, which is what the kernels are tested against.
"""

from __future__ import annotations

import os
from functools import cache

import numpy as np

from trackfg.numerics.arrays import Array

_REVISION = 34
"""Revision of the kernels' arguments, as in ``kernels/module.cpp``. A module with another one was compiled from other
sources and is not used.
"""

_DOUBLE = np.dtype(np.float64)
"""What nearly all arrays share; an equal type of their own takes the longer way."""


@cache
def compiled_kernels() -> bool:
    """Return whether :mod:`trackfg.numerics.compiled` is there and may be used: the environment is read once."""
    return _built() and os.environ.get("TRACKFG_KERNELS") != "numpy"


def kernels_in_use() -> str:
    """Return what computes, in one word: ``compiled`` or ``numpy``."""
    return "compiled" if compiled_kernels() else "numpy"


def kernel_argument(values: Array) -> Array:
    """Return numbers as the kernels take them: doubles in C order at addresses that a processor reads at once, which
    views into the bytes of a file need not be.
    """
    flags = values.flags
    if values.dtype is _DOUBLE and flags.aligned:
        return values if flags.c_contiguous else np.ascontiguousarray(values)
    return np.require(values, np.float64, ["C_CONTIGUOUS", "ALIGNED"])


def _built() -> bool:
    try:
        from trackfg.numerics import compiled
    except ImportError:
        return False
    return compiled.REVISION == _REVISION
