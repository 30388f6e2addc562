"""The first rows of a stream are judged by how far apart they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu
from trackfg.streaming.intake.interval_check import FIRST_ROWS, IntervalCheck

IMU = Imu(file="-", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
T = 0.005 * np.arange(FIRST_ROWS)


def take(t: Array, *, canonical: bool = False, check: IntervalCheck | None = None) -> None:
    check = check or IntervalCheck(CheckLimits())
    check.take(t[: len(t) // 2], IMU, canonical=canonical)
    check.take(t[len(t) // 2 :], IMU, canonical=canonical)
    check.finish(IMU, canonical=canonical)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (1e3, 'rows are 5 s apart .median., 0.2 a second; .* set imu.time_unit = "ms", and the sensor has 200 rows'),
        (1e6, 'rows are 5000 s apart .* set imu.time_unit = "us", and the sensor has 200 rows a second'),
        (1e-3, "rows are 5e-06 s apart"),
    ],
)
@pytest.mark.parametrize("count", [60, FIRST_ROWS])
def test_times_of_another_unit_are_refused(factor: float, says: str, count: int) -> None:
    with pytest.raises(BadInputError, match=f"the first {count} rows of the stream: imu, column 't': {says}"):
        take(factor * T[:count])


def test_tables_in_memory_have_no_unit_to_declare() -> None:
    with pytest.raises(BadInputError, match=r"the times look like ms: multiply the times by 0\.001"):
        take(1e3 * T, canonical=True)


def test_what_happens_to_clocks_is_no_unit() -> None:
    packets = T[np.minimum(np.arange(len(T)) // 100 * 100 + 99, len(T) - 1)]
    for times in (
        0.25 / 0.005 * T,
        T + 1e4 * (T > 2.0),
        np.random.default_rng(0).permutation(T),
        packets,
        packets + 1e-6 * (np.arange(len(T)) % 100),
        np.where(np.arange(len(T)) % 7 == 0, np.nan, T),
        np.full(len(T), 5.0),
        5.0 * np.arange(20.0),
    ):
        take(times)


def test_what_waits_is_kept_over_a_checkpoint(saved_and_restored: Callable[..., Any]) -> None:
    check = IntervalCheck(CheckLimits())
    check.take(1e3 * T[:900], IMU, canonical=False)
    with pytest.raises(BadInputError):
        take(1e3 * T[900:], check=saved_and_restored(check))
