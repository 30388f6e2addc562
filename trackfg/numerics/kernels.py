"""Kernels are compiled from C++ where the installation could do so; numpy computes the same without them.

Their sources are in ``kernels/``, their types in ``compiled.pyi``. ``TRACKFG_KERNELS=numpy`` in the environment has
numpy compute everything, which is what the kernels are tested against.
"""

from __future__ import annotations

import os
from functools import cache

_REVISION = 2
"""Revision of the kernels' arguments, as in ``kernels/module.cpp``. A module with another one was compiled from other
sources and is not used.
"""


def compiled_kernels() -> bool:
    """Return whether :mod:`trackfg.numerics.compiled` is there and may be used."""
    return _built() and os.environ.get("TRACKFG_KERNELS") != "numpy"


def kernels_in_use() -> str:
    """Return what computes, in one word: ``compiled`` or ``numpy``."""
    return "compiled" if compiled_kernels() else "numpy"


@cache
def _built() -> bool:
    try:
        from trackfg.numerics import compiled
    except ImportError:
        return False
    return compiled.REVISION == _REVISION
