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
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.intake.interval_check import FIRST_ROWS, IntervalCheck

IMU = Imu(file="-", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
T = 0.005 * np.arange(FIRST_ROWS)


def rows(t: Array) -> Array:
    return np.column_stack([t, np.random.default_rng(0).standard_normal((len(t), 6))])


def take(t: Array, *, canonical: bool = False, check: IntervalCheck | None = None) -> list[Event]:
    check, samples = check or IntervalCheck(CheckLimits()), rows(t)
    events = [check.take(part, IMU, canonical=canonical) for part in np.array_split(samples, 2)]
    events.append(check.finish(IMU, canonical=canonical))
    return [event for event in events if event is not None]


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


@pytest.mark.parametrize("count", [2, 10, 50])
@pytest.mark.parametrize("spread_s", [0.0, 3e-6])
def test_stamps_of_packets_are_an_event(count: int, spread_s: float) -> None:
    place = np.arange(len(T))
    (event,) = take(T[place // count * count + count - 1] + spread_s * (place % count))
    assert (event.kind, event.table) == (DOUBT, "imu")
    assert f"samples come in packets of {count} with one time each" in event.detail
    assert ("of which one is used" in event.detail) == (spread_s == 0.0)


def test_what_happens_to_clocks_is_no_unit() -> None:
    packets = T[np.minimum(np.arange(len(T)) // 100 * 100 + 99, len(T) - 1)]
    for times in (packets, packets + 1e-6 * (np.arange(len(T)) % 100)):
        take(times)
    for times in (
        0.25 / 0.005 * T,
        T + 1e4 * (T > 2.0),
        np.random.default_rng(0).permutation(T),
        np.where(np.arange(len(T)) % 7 == 0, np.nan, T),
        np.full(len(T), 5.0),
        5.0 * np.arange(20.0),
    ):
        assert take(times) == []


def test_what_waits_is_kept_over_a_checkpoint(saved_and_restored: Callable[..., Any]) -> None:
    check = IntervalCheck(CheckLimits())
    check.take(rows(1e3 * T[:900]), IMU, canonical=False)
    with pytest.raises(BadInputError):
        take(1e3 * T[900:], check=saved_and_restored(check))
