"""What no program could do faster: the bytes that a stage has to move and the sums that it has to do, on one core.

Numbers are doubles; K is the dimension of a keyframe, d that of (x_k, s), n counts keyframes, N inertial samples. Bytes
are those that a stage reads and writes at least once, operations those of dense linear algebra of these sizes (Golub
and Van Loan, "Matrix Computations", 4th ed., 5.2 for QR); what is done per sample beside linear algebra is not counted.
The least time is that of the slower of both (the roofline; Williams, Waterman and Patterson, 2009).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq

from speed.process import ProcessUse
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM

_DOUBLE = 8
_COLUMNS = 112
"""Right-hand sides of the self-test: 24 draws and 11 quantities at 8 places (trackfg.solver.influence)."""

_DRAWS = 64
"""Samples of the profile's errors (trackfg.output.track_geometry)."""

_DRAWN = 4
"""Errors of each point that are drawn: height, lateral, heading and tilt."""


@dataclass(frozen=True)
class Machine:
    """What one core does: bytes per second of copies, read and written ones together, and operations per second."""

    bandwidth: float
    rate: float


class Work(NamedTuple):
    """Bytes that a stage moves and operations that it does at least."""

    bytes: float
    operations: float = 0.0

    def least_s(self, machine: Machine) -> float:
        """The least time, s."""
        return max(self.bytes / machine.bandwidth, self.operations / machine.rate)


def measured_machine() -> Machine:
    """Measure copies of 64 MB and products of 512 rows, the best of ten."""
    a, b, M = np.ones(8_000_000), np.zeros(8_000_000), np.ones((512, 512))
    return Machine(2.0 * a.nbytes / _best_s(lambda: np.copyto(b, a)), 2.0 * len(M) ** 3 / _best_s(lambda: M @ M))


def _best_s(run: Callable[[], object]) -> float:
    def once() -> float:
        start = time.perf_counter()
        run()
        return time.perf_counter() - start

    return min(once() for _ in range(10))


def work(use: ProcessUse) -> dict[str, Work]:
    """The least work of each stage of a run (:mod:`speed.stages`)."""
    n, K, d = use.keyframes, KEYFRAME_DIM, KEYFRAME_DIM + SHARED_DIM
    read = [table for table in use.recording.glob("*.parquet") if not table.name.startswith("truth")]
    imu, recording = _numbers(use.recording / "imu.parquet"), sum(map(_numbers, read))
    trajectory, tables = _numbers(use.result / "trajectory.parquet"), sum(map(_numbers, use.result.glob("*.parquet")))
    geometry = use.result / "geometry.parquet"
    drawn = _DRAWS * _DRAWN * pq.read_metadata(geometry).num_rows if geometry.exists() else 0
    conditionals, covariances = n * K * (K + d + 1), 2 * n * K * d
    solved = use.iterations * n * _householder(K + use.rows / n, K + d + 1, 2 * K)
    recursion = n * (2.0 * K * d**2 + 4.0 * K**2 * d)
    tested = 2 * n * _COLUMNS * (2.0 * K * d + K**2)
    return {
        "reading": Work(_DOUBLE * recording),
        "graph": Work(_DOUBLE * 2 * imu),  # the checks of the recording, which run beside it, read the samples too
        "solve": Work(_DOUBLE * use.iterations * 2 * conditionals, solved),
        "covariance": Work(_DOUBLE * (2 * conditionals + 2 * covariances), recursion + tested),
        "output": Work(_DOUBLE * (imu + trajectory)),
        "geometry": Work(_DOUBLE * (2 * drawn + (_numbers(geometry) if geometry.exists() else 0))),
        "writing": Work(_DOUBLE * tables),
    }


def _numbers(table: Path) -> int:
    metadata = pq.read_metadata(table)
    return int(metadata.num_rows * metadata.num_columns)


def _householder(rows: float, columns: int, pivots: int) -> float:
    """Operations that make the first ``pivots`` columns of a matrix triangular."""
    return sum(4.0 * max(rows - j, 1.0) * (columns - j) for j in range(pivots))


def limits_table(use: ProcessUse, machine: Machine) -> list[list[str]]:
    """Each stage's CPU time, its work, and how far the time is from the least; header first."""
    rows = [["stage", "CPU time", "bytes", "operations", "least time", "times the least"]]
    for stage, stage_work in work(use).items():
        took, least = use.stages_s[stage], stage_work.least_s(machine)
        operations = f"{stage_work.operations / 1e9:.2f} G" if stage_work.operations else ""
        rows.append(
            [
                stage,
                f"{took:.2f} s",
                f"{stage_work.bytes / 1e6:.0f} MB",
                operations,
                f"{least:.4f} s",
                f"{took / least:.0f}",
            ]
        )
    return rows
