"""A coarse tach measures best where it steps: then a place, or a speed, was passed.

A wheel with one pulse per revolution, sampled every dt, is known to a quantum q at any time (sigma q / sqrt(12)), but
at a step of the count to v dt only. Likewise a speed in whole km/h equals the boundary between two values when it steps
from one to the other, to a dt. In between the distance (the speed) is interpolated.

What is between two steps T apart errs by what the vehicle's acceleration (its change) makes of that time, and by no
more than the rounding. The error of a speed lasts as long as the value does: over a minute at one speed it is the same
fraction of a km/h all the time. So the variance of the integrated speed grows by ``s^2 T`` a second while a value with
the error s lasts for T, to ``(s T)^2``.

Whether values are rounded or cut off is a constant, half a quantum: of a count it does not matter, of a speed it is in
the offset that ``WHEEL`` has for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.spans import median_interval
from trackfg.sensors.tach import Wheel
from trackfg.sensors.tach_rows import common_step

_UNIFORM = float(1.0 / np.sqrt(12.0))
"""The 1-sigma of an error that is uniform over 1."""

_FEWEST_STEPS = 3
"""Fewer steps determine neither a speed nor an acceleration."""

_ROWS_PER_STEP = 2.0
"""Fewer rows from one step to the next, on average, resolve no steps: each row has a rounding of its own."""

_ACCELERATION = 1.0
"""m/s^2: what a train brakes or drives with, by which a place interpolated between two steps errs."""

_SAME_MPS = 2e-3
"""Speeds closer than this are one value, m/s: whole km/h written with two decimals. Finer steps are noise."""

_APART_S = 1e-6
"""Rows are at least so far apart, s: a slope between two that only rounding divides means nothing."""

_STALL_S = 1.5
"""Between steps further apart, s, the wheel may have stopped: nothing is interpolated."""

_ACCELERATION_CHANGE = 0.3
"""m/s^2: by so much the acceleration changes while a speed shows one value. A train starts with 0.5 to 1 m/s^2 and
eases off within some seconds.
"""

_BEFORE_A_REST_S = 4.0
"""A speed of 0 that is no rest lasts no longer, s: rests are trimmed by 1.5 s at both ends
(:mod:`trackfg.sensors.standstills`).
"""


def at_steps(wheel: Wheel) -> Wheel:
    """Return the wheel read at its steps, where those are resolved: a coarse count, or a coarse speed."""
    return _speed_at_steps(wheel) if wheel.integrates_speed else _count_at_steps(wheel)


def _count_at_steps(wheel: Wheel) -> Wheel:
    """A place is at its count, plus half a quantum; the step from one count to the next is in the middle of both."""
    quantum = wheel.quantum
    step = np.flatnonzero(np.diff(wheel.distance))
    if quantum == 0.0 or wheel.rounding_sd < 0.9 * _UNIFORM * quantum or not _resolved(np.diff(step)):
        return wheel
    t, count = wheel.t, wheel.distance
    at, place = 0.5 * (t[step] + t[step + 1]), 0.5 * (count[step] + count[step + 1])
    lasted = np.diff(at)
    late = quantum / lasted * (t[step + 1] - t[step])[1:] * _UNIFORM
    sd = np.minimum(np.hypot(late, _ACCELERATION * lasted**2 / 20.0), _UNIFORM * quantum)
    stalled = (lasted > _STALL_S) | (np.diff(place) == 0.0)
    # Where it may have stopped: in the middle of the quantum, to either end of which it goes in a second or so.
    aside = np.minimum(lasted / 3.0, _STALL_S)
    rows = np.concatenate([t[:1], at, (at[:-1] + aside)[stalled], (at[1:] - aside)[stalled], t[-1:]])
    between = count[step[1:]][stalled]
    places = np.concatenate([count[:1], place, between, between, count[-1:]])
    order = np.argsort(rows, kind="stable")
    rows, places = rows[order], places[order]
    apart = np.diff(rows, prepend=-np.inf) > _APART_S
    rows, places = rows[apart], places[apart]
    middle = np.searchsorted(at, 0.5 * (rows[1:] + rows[:-1])) - 1
    sds = np.full(len(middle), _UNIFORM * quantum)
    inside = (middle >= 0) & (middle < len(lasted))
    sds[inside] = np.where(stalled, _UNIFORM * quantum, sd)[middle[inside]]
    return replace(wheel, t=rows, distance=places, coarse=True, reading_sds=sds)


def _speed_at_steps(wheel: Wheel) -> Wheel:
    rows = speed_rows(wheel.t, wheel.distance)
    if rows is None:
        return wheel
    speed, quantum = rows
    t, step = wheel.t, np.flatnonzero(np.diff(speed))
    at, boundary = 0.5 * (t[step] + t[step + 1]), 0.5 * (speed[step] + speed[step + 1])
    value = np.append(speed[step], speed[-1])
    lasted = np.diff(np.concatenate([t[:1], at, t[-1:]]))
    # A value is reached, and left, as fast as the one beside it is passed.
    reach = 0.5 * np.minimum(lasted[1:], lasted[:-1])
    knots = np.concatenate([t[:1], at, at - reach, at + reach, t[-1:]])
    values = np.concatenate([value[:1], boundary, value[:-1], value[1:], value[-1:]])
    order = np.argsort(knots, kind="stable")
    every = np.union1d(t, knots)
    every = every[np.diff(every, prepend=-np.inf) > _APART_S]
    smooth = np.interp(every, knots[order], values[order])
    distance = trapezoid_integral(every, smooth)
    interval = median_interval(t)
    lasted = np.where(value == 0.0, np.minimum(lasted, _BEFORE_A_REST_S), np.maximum(lasted, interval))
    late = np.minimum(quantum / lasted * interval, quantum) * _UNIFORM
    sd = np.hypot(late, np.minimum(_UNIFORM * quantum, _ACCELERATION_CHANGE * lasted / 8.0))
    shown = np.searchsorted(at, 0.5 * (every[1:] + every[:-1]))
    grown = np.concatenate([[0.0], np.cumsum((sd**2 * lasted)[shown] * np.diff(every))])
    distance += wheel.distance[0]
    return replace(wheel, t=every, distance=distance, coarse=True, grown=grown, offset_sd_mps=0.5 * quantum)


def speed_rows(t: Array, distance: Array) -> tuple[Array, float] | None:
    """Return the speeds (n,) of which the trapezoid rule made ``distance`` (n,) at ``t`` (n,), and their step, m/s.

    None where they are no multiples of a step. From the sums of neighbouring speeds each one follows but for a number
    that is added to every other one and taken from the rest: the one that makes the most of them equal to the next.
    """
    sums = 2.0 * np.diff(distance) / np.diff(t)
    quantum = common_step(_merged(np.sort(np.abs(sums))))
    if quantum == 0.0:
        return None
    sign = np.where(np.arange(len(t)) % 2, -1.0, 1.0)
    sums = quantum * np.rint(sums / quantum)
    speed = np.concatenate([[0.0], -sign[1:] * np.cumsum(sign[:-1] * sums)])
    speed = speed + sign * quantum * np.rint(0.5 * np.median(sign[:-1] * np.diff(speed)) / quantum)
    return quantum * np.rint(speed / quantum), quantum


def _merged(values: Array) -> Array:
    """Return the means of ``values`` (n,), in order, that lie together: decimals cut off make many of one."""
    first = np.flatnonzero(np.diff(values, prepend=-np.inf) > _SAME_MPS)
    return np.asarray(np.add.reduceat(values, first) / np.diff(np.append(first, len(values))))


def _resolved(rows_between: Array) -> bool:
    """Return whether there are several rows from a step to the next, of which there are several."""
    return len(rows_between) >= _FEWEST_STEPS and bool(np.mean(np.minimum(rows_between, 10)) >= _ROWS_PER_STEP)
