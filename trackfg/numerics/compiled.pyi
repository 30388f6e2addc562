"""Types of the kernels in C++ (``kernels/``), which an installation may lack: see :mod:`trackfg.numerics.kernels`."""

import numpy as np

from trackfg.numerics.arrays import Array

REVISION: int
DELTA_SIZE: int

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
def preintegrate(
    frame: Array, bias: Array, noise: Array, duration: Array, rotation: Array, velocity: Array, delta: Array, /
) -> None: ...
def inertial_factors(deltas: Array, R: Array, p: Array, v: Array, bias: Array, rows: Array, /) -> None: ...
def predict(delta: Array, R: Array, p: Array, v: Array, bias: Array, end: Array, /) -> None: ...
def spill(table: object, file: int, budget: int, limit: int, /) -> object: ...
def unspill(table: object, handler: object, /) -> None: ...
