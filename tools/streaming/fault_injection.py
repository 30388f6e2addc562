"""Faults put into the rows of a stream, drawn from a generator of random numbers: one function for each kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, get_args
from unittest.mock import patch

import numpy as np

from streaming.arrivals import Arriving, Stream, stream_of
from trackfg.datasets.faults import slip_wheel
from trackfg.datasets.scenarios import Simulation
from trackfg.datasets.vehicle.adhesion import Shape, WheelSlip
from trackfg.errors import UnsolvableError
from trackfg.numerics.arrays import Array
from trackfg.streaming.window.window import Window

EARLIEST_S, LATEST_S, LONGEST_S = 18.0, 34.0, 8.0
"""When a fault begins, and how long it lasts at most; clocks may take longer to be believed again."""

_NO_NUMBERS = (np.nan, np.inf, -np.inf, 1e300)
_RANGES = (5.0, 50.0)
"""Of a gyro, rad/s, and of an accelerometer, m/s^2: what they show of a blow."""


@dataclass(frozen=True)
class Damaged:
    """A stream with a fault from ``begin_s`` to ``end_s``, s of true time, and in words what it is.

    ``ahead_s``: by how much the stream's clock is ahead of true time afterwards. ``unsure_s``: as well as one can know.
    ``within``: what the stream runs in.
    """

    stream: Stream
    begin_s: float
    end_s: float
    said: str
    ahead_s: float = 0.0
    unsure_s: float = 0.0
    within: AbstractContextManager[None] = field(default_factory=nullcontext)


@dataclass(frozen=True)
class BaseCase:
    """What is damaged: a simulated run and its rows."""

    name: str
    run: Simulation
    stream: Stream


Damage = Callable[[BaseCase, np.random.Generator], Damaged]


def none(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Nothing: how the rest is when nothing happens."""
    begin = _begin(rng)
    return Damaged(base.stream, begin, begin, "nothing")


def gap_imu(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The IMU is silent."""
    return _silent(base, ["imu"], _begin(rng), _log_uniform(rng, 0.01, LONGEST_S))


def gap_tach(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The tachometer is silent; its count goes on."""
    return _silent(base, ["tach"], _begin(rng), _log_uniform(rng, 0.2, 12.0))


def gap_positions(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """No fix and no GNSS for some time."""
    names = [name for name in ("fixes", "gnss") if name in base.stream.tables]
    return _silent(base, names, _begin(rng), rng.uniform(5.0, 20.0))


def gap_all(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The line to the recorder is cut."""
    return _silent(base, list(base.stream.tables), _begin(rng), _log_uniform(rng, 0.05, LONGEST_S))


def not_numbers(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Some values, or all, are no numbers or far too large; times too."""
    name, begin = _table(base, rng), _begin(rng)
    end = begin + _log_uniform(rng, 0.05, LONGEST_S)
    table = base.stream.tables[name]
    rows = table.rows.copy()
    hit = _some(table, begin, end, rng, [0.01, 0.1, 1.0])
    columns = rng.random((len(rows), rows.shape[1])) < rng.choice([0.15, 1.0])
    columns[:, 0] &= rng.random() < 0.5
    columns[:, 1] |= ~columns.any(axis=1)
    wrong = hit[:, None] & columns
    rows[wrong] = rng.choice(_NO_NUMBERS, np.count_nonzero(wrong))
    stream = base.stream.with_table(name, table.with_rows(rows))
    return Damaged(stream, begin, end, f"{np.count_nonzero(wrong.any(axis=1))} rows of {name} with no numbers")


def duplicates(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Rows come again, as they are or with other values, at once or a little later."""
    name, begin = _table(base, rng), _begin(rng)
    end = begin + _log_uniform(rng, 0.1, LONGEST_S)
    table = base.stream.tables[name]
    again = table.take(_some(table, begin, end, rng, [0.05, 1.0]))
    delay, changed = rng.choice([1e-4, 0.1, 1.0]), rng.random() < 0.5
    rows = again.rows.copy()
    if changed:
        rows[:, 1:] += rng.normal(0.0, 1.0, rows[:, 1:].shape)
    stream = base.stream.with_table(name, table.joined(Arriving(again.at + delay, rows)))
    text = f"{len(rows)} rows of {name} again {delay:g} s later" + (" with other values" if changed else "")
    return Damaged(stream, begin, end, text)


def reordered(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Rows overtake each other: in one table, or one table another."""
    name, begin = _table(base, rng), _begin(rng)
    end = begin + rng.uniform(0.5, LONGEST_S)
    most, each = rng.choice([0.02, 0.18, 0.5, 1.5]), rng.random() < 0.5
    table = base.stream.tables[name]
    inside = _within(table, begin, end)
    delay = np.where(inside, most * (rng.random(len(table.at)) if each else 1.0), 0.0)
    stream = base.stream.with_table(name, Arriving(table.at + delay, table.rows))
    return Damaged(stream, begin, end, f"{name} comes up to {most:g} s late, {'each row otherwise' if each else 'all'}")


def wrong_stamps(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Single stamps are nonsense."""
    name, begin = _table(base, rng), _begin(rng)
    end = begin + _log_uniform(rng, 0.05, LONGEST_S)
    table = base.stream.tables[name]
    inside = np.flatnonzero(_some(table, begin, end, rng, [1.0]))
    hit = rng.choice(inside, min(len(inside), int(rng.integers(1, 20))), replace=False)
    rows = table.rows.copy()
    rows[hit, 0] += rng.choice([-1.0, 1.0], len(hit)) * 10.0 ** rng.uniform(-2.0, 9.0, len(hit))
    return Damaged(
        base.stream.with_table(name, table.with_rows(rows)), begin, end, f"{len(hit)} wrong stamps of {name}"
    )


def clock_forward(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """All clocks are set forward."""
    begin, by = _begin(rng), _log_uniform(rng, 0.01, 50.0)
    return Damaged(_set_clock(base.stream, None, begin, by), begin, begin, f"clock set forward by {by:.3f} s", by)


def clock_far(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """All clocks are set forward by minutes or by decades."""
    begin, by = _begin(rng), _log_uniform(rng, 70.0, 2e9)
    stream = _set_clock(base.stream, None, begin, by)
    return Damaged(stream, begin, begin + 5.0, f"clock set forward by {by:.3g} s", by)


def clock_back(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """All clocks are set back."""
    begin, by = _begin(rng), _log_uniform(rng, 0.01, 1e9)
    stream = _set_clock(base.stream, None, begin, -by)
    return Damaged(stream, begin, begin + 5.0, f"clock set back by {by:.3g} s", 0.0, 0.01)


def clock_of_table(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The clock of one table other than the IMU's is off for some time."""
    names = [name for name in base.stream.tables if name != "imu"]
    name, begin = str(rng.choice(names)), _begin(rng)
    end, by = begin + _log_uniform(rng, 0.5, LONGEST_S), rng.choice([-1.0, 1.0]) * _log_uniform(rng, 0.3, 1e9)
    stream = _set_clock(_set_clock(base.stream, name, begin, by), name, end, -by)
    return Damaged(stream, begin, end, f"clock of {name} off by {by:.3g} s")


def stuck_imu(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """A channel of the IMU, or all of them, stays as it is."""
    begin, channels = _begin(rng), rng.choice([1, 2, 3, 4, 5, 6], int(rng.choice([1, 6])), replace=False)
    end = begin + _log_uniform(rng, 0.1, LONGEST_S)
    table = base.stream.tables["imu"]
    rows, inside = table.rows.copy(), np.flatnonzero(_within(table, begin, end))
    rows[np.ix_(inside, channels)] = rows[inside[0], channels]
    stream = base.stream.with_table("imu", table.with_rows(rows))
    return Damaged(stream, begin, end, f"{len(channels)} channels of the IMU stuck")


def stuck_tach(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The tachometer counts nothing for some time, or the GNSS receiver gives one position again and again."""
    name = "gnss" if "gnss" in base.stream.tables and rng.random() < 0.5 else "tach"
    begin = _begin(rng)
    end = begin + _log_uniform(rng, 0.5, LONGEST_S)
    table = base.stream.tables[name]
    rows, inside = table.rows.copy(), np.flatnonzero(_within(table, begin, end))
    if name == "tach":
        counted = np.concatenate([[0.0], np.diff(rows[:, 1])])
        counted[inside] = 0.0
        rows[:, 1] = rows[0, 1] + np.cumsum(counted)
    elif inside.size:
        rows[inside, 1:] = rows[inside[0], 1:]
    return Damaged(base.stream.with_table(name, table.with_rows(rows)), begin, end, f"{name} stuck")


def tach_reset(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The count begins again, or leaps."""
    begin = _begin(rng)
    table = base.stream.tables["tach"]
    rows, later = table.rows.copy(), table.at >= begin
    first = rows[np.argmax(later), 1]
    rows[later, 1] += -first if rng.random() < 0.5 else rng.choice([-1.0, 1.0]) * _log_uniform(rng, 1e3, 1e9)
    return Damaged(base.stream.with_table("tach", table.with_rows(rows)), begin, begin + 0.5, "the count leaps")


def blow(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The IMU is hit: for some time its channels show either end of their ranges."""
    begin = _begin(rng)
    end = begin + _log_uniform(rng, 0.01, 0.3)
    table = base.stream.tables["imu"]
    rows, inside = table.rows.copy(), np.flatnonzero(_within(table, begin, end))
    scale = np.repeat(_RANGES, 3) * rng.choice([-1.0, 1.0], (len(inside), 6))
    rows[inside, 1:] = scale * _per_si(base.stream)
    return Damaged(base.stream.with_table("imu", table.with_rows(rows)), begin, end, f"IMU hit for {end - begin:.3f} s")


def saturated(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The range of a channel is too small for some time."""
    begin, channel = _begin(rng), int(rng.integers(1, 7))
    end = begin + _log_uniform(rng, 0.5, LONGEST_S)
    table = base.stream.tables["imu"]
    rows, inside = table.rows.copy(), np.flatnonzero(_within(table, begin, end))
    values = rows[inside, channel]
    low, high = np.quantile(values, [0.0, rng.uniform(0.3, 0.95)])
    rows[inside, channel] = np.clip(values, low, high)
    stream = base.stream.with_table("imu", table.with_rows(rows))
    return Damaged(stream, begin, end, f"channel {channel} of the IMU cut off at {high:.3g}")


def slip(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """The wheel slips, slides or is locked."""
    begin = _begin(rng)
    duration = rng.uniform(1.0, LONGEST_S)
    creep = -1.0 if rng.random() < 0.2 else rng.choice([-1.0, 1.0]) * _log_uniform(rng, 0.02, 0.8)
    shape = get_args(Shape)[int(rng.choice(3))]
    run = slip_wheel(base.run, [WheelSlip(begin, duration, creep, shape)])
    stream = stream_of(run.recording, base.stream.form)
    return Damaged(stream, begin, begin + duration, f"{shape} of creep {creep:.2f} for {duration:.1f} s")


def wild(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Some fixes or positions of GNSS are far off."""
    names = [name for name in ("fixes", "gnss") if name in base.stream.tables]
    name, begin = str(rng.choice(names)), _begin(rng)
    end = begin + LONGEST_S
    table = base.stream.tables[name]
    rows, inside = table.rows.copy(), np.flatnonzero(_within(table, begin, end))
    hit = inside[: int(rng.integers(1, 4))]
    size = _log_uniform(rng, 5.0, 1000.0)
    rows[hit, 1] += rng.choice([-1.0, 1.0]) * size
    return Damaged(
        base.stream.with_table(name, table.with_rows(rows)), begin, end, f"{len(hit)} of {name} off by {size:.0f} m"
    )


def thrown(base: BaseCase, rng: np.random.Generator) -> Damaged:
    """Steps of the smoother fail, as those of an undetermined graph do: one, or that of what takes over too."""
    begin, count = _begin(rng), int(rng.integers(1, 3))
    text = f"{count} step{'s' if count > 1 else ''} thrown"
    return Damaged(base.stream, begin, begin + 0.5, text, within=_failing(begin, count))


@contextmanager
def _failing(begin: float, count: int) -> Iterator[None]:
    """So many steps of more than the newest two keyframes, and all of these until then."""
    updated_by, failures = Window.updated_by, count

    def failing(window: Window, *arguments: Any) -> Window:
        nonlocal failures
        if window.t[-1] >= begin and failures:
            failures -= len(window) > 2
            raise UnsolvableError("thrown on purpose")
        return updated_by(window, *arguments)

    with patch.object(Window, "updated_by", failing):
        yield


DAMAGES: Mapping[str, Damage] = MappingProxyType(
    {
        "none": none,
        "gap-imu": gap_imu,
        "gap-tach": gap_tach,
        "gap-positions": gap_positions,
        "gap-all": gap_all,
        "nan": not_numbers,
        "duplicates": duplicates,
        "reordering": reordered,
        "wrong-stamps": wrong_stamps,
        "clock-forward": clock_forward,
        "clock-far": clock_far,
        "clock-back": clock_back,
        "clock-of-table": clock_of_table,
        "stuck-imu": stuck_imu,
        "stuck-tach": stuck_tach,
        "tach-reset": tach_reset,
        "blow": blow,
        "saturation": saturated,
        "slip": slip,
        "wild-position": wild,
        "throw": thrown,
    }
)


def _begin(rng: np.random.Generator) -> float:
    return float(rng.uniform(EARLIEST_S, LATEST_S))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _table(base: BaseCase, rng: np.random.Generator) -> str:
    """The IMU in half of all cases, the tachometer in a third."""
    others = [name for name in base.stream.tables if name not in ("imu", "tach")]
    return str(rng.choice(["imu", "tach", rng.choice(others)], p=[0.5, 0.35, 0.15]))


def _within(table: Arriving, begin: float, end: float) -> np.ndarray:
    return (table.at >= begin) & (table.at < end)


def _some(table: Arriving, begin: float, end: float, rng: np.random.Generator, shares: list[float]) -> np.ndarray:
    """One of these shares of the rows, drawn at random; one row at least."""
    some = _within(table, begin, end) & (rng.random(len(table.at)) < rng.choice(shares))
    if not some.any():
        some[min(int(np.searchsorted(table.at, begin)), len(some) - 1)] = True
    return some


def _silent(base: BaseCase, names: list[str], begin: float, duration: float) -> Damaged:
    stream = base.stream
    for name in names:
        stream = stream.with_table(
            name, stream.tables[name].take(~_within(stream.tables[name], begin, begin + duration))
        )
    return Damaged(stream, begin, begin + duration, f"no {', '.join(names)} for {duration:.2f} s")


def _set_clock(stream: Stream, name: str | None, begin: float, by: float) -> Stream:
    """From ``begin`` on stamps are greater by ``by``: those of one table, or of all."""
    tables = dict(stream.tables)
    for key in tables if name is None else [name]:
        rows = tables[key].rows.copy()
        rows[tables[key].at >= begin, 0] += by
        tables[key] = tables[key].with_rows(rows)
    return replace(stream, tables=tables)


def _per_si(stream: Stream) -> Array:
    """Units of the IMU's channels per SI unit."""
    if stream.form == "canonical":
        return np.ones(6)
    return np.repeat([np.degrees(1.0), 1.0 / 9.80665], 3)
