"""Types of the kernels in C++ (``kernels/``), which an installation may lack: see :mod:`trackfg.numerics.kernels`."""

import numpy as np

from trackfg.numerics.arrays import Array

REVISION: int

def eliminate(
    rows: Array,
    starts: np.ndarray,
    widths: np.ndarray,
    nav: tuple[int, int],
    indeterminate: float,
    left: Array,
    left_rows: int,
    R: Array,
    S: Array,
    d: Array,
    alone: Array,
    /,
) -> tuple[int, int] | None: ...
