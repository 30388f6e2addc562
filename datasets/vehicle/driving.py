"""Drivers: each turns a line and a duration into a motion of at least that duration.

* :class:`Service`: from station to station as fast as the line's limits allow, with dwell.
* :class:`Wandering`: changes its speed now and then; from rest (a pushed trolley) or already under way.
* :class:`Shunting`: to and fro between changing places, turning round at rest.
* :class:`Parked`: stands.

Only a service keeps to the line's limits; the others go at speeds of their own. After its last phase a motion goes on
as that phase does: every one ends at rest or holding its speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from trackfg.datasets.line.line import Line
from trackfg.datasets.vehicle.motion import DrivenMotion, Limits, Phase, change, change_time, motion, rest, reverse, run
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array

_SLOWEST_MPS = 1.0
"""Lowest speed limit that is driven by, m/s."""
_SHORTEST_SERVICE_M = 50.0
"""Least way of a service, m."""


class Driver(Protocol):
    """Anything that drives along a line."""

    def furthest_m(self, duration_s: float) -> float:
        """Return how much line it may need."""

    def drive(self, line: Line, duration_s: float, rng: np.random.Generator) -> DrivenMotion:
        """Return a motion of at least ``duration_s``, which begins as that of a shorter duration does.

        Raises :class:`~trackfg.errors.BadInputError` where the line is too short for it.
        """


@dataclass(frozen=True)
class SpeedRestrictions:
    """Temporary ones: how many a kilometre between two of them, and ranges of their speed and their length."""

    per_km: float
    speed_mps: tuple[float, float]
    length_m: tuple[float, float]

    def impose(self, line: Line, rng: np.random.Generator) -> Line:
        """Return the line with restrictions at random places; where limits overlap, the lowest holds."""
        place_rng, speed_rng = rng.spawn(2)
        spans = random_spans(1e-3 * self.per_km, self.length_m, line.length_m, place_rng)
        speeds = speed_rng.uniform(*self.speed_mps, len(spans))
        places = np.union1d(line.limit_from_m, spans)
        limit = line.limit_mps[np.searchsorted(line.limit_from_m, places, side="right") - 1]
        for (start, end), speed in zip(spans, speeds, strict=True):
            limit = np.where((places >= start) & (places < end), np.minimum(limit, speed), limit)
        return replace(line, limit_from_m=places, limit_mps=limit)


@dataclass(frozen=True)
class Service:
    """Stands ``start_rest_s``, then goes from station to station, standing ``dwell_s`` (range) at each, and from the
    last one to ``start_m`` before the line's end, where it stays.

    It goes at the line's limits, at most ``fastest_mps``, times a factor drawn from ``hurry`` (range), but no slower
    than 1 m/s.
    """

    limits: Limits
    fastest_mps: float
    start_m: float
    start_rest_s: float
    dwell_s: tuple[float, float]
    hurry: tuple[float, float] = (1.0, 1.0)
    restrictions: SpeedRestrictions | None = None

    def furthest_m(self, duration_s: float) -> float:
        """Return the highest speed all the time."""
        return 2.0 * self.start_m + self.fastest_mps * duration_s

    def drive(self, line: Line, duration_s: float, rng: np.random.Generator) -> DrivenMotion:
        """The seed of ``rng`` settles the factor, the restrictions and the dwell times."""
        hurry = rng.uniform(*self.hurry)
        if self.restrictions is not None:
            line = self.restrictions.impose(line, rng)
        limit = np.maximum(hurry * np.minimum(line.limit_mps, self.fastest_mps), _SLOWEST_MPS)
        line = replace(line, limit_mps=limit)
        phases, place, end = rest(self.start_rest_s), self.start_m, line.length_m - self.start_m
        if end - place < _SHORTEST_SERVICE_M:
            raise _too_short(line, 2.0 * self.start_m + _SHORTEST_SERVICE_M)
        stations = line.stations_m[(line.stations_m > self.start_m) & (line.stations_m < end)]
        for station in [*stations, end]:
            if _duration(phases) >= duration_s:
                break
            phases += run(*_stretches(line, place, station), (0.0, 0.0), self.limits)
            phases += rest(rng.uniform(*self.dwell_s))
            place = station
        return motion([*phases, *rest(max(duration_s - _duration(phases), 0.0))], self.start_m)


@dataclass(frozen=True)
class Wandering:
    """Stands ``start_rest_s``, then holds speeds drawn from ``speed_mps`` (range) for ``hold_s`` (range) each."""

    limits: Limits
    speed_mps: tuple[float, float]
    hold_s: tuple[float, float]
    start_rest_s: float = 0.0
    start_m: float = 0.0

    def furthest_m(self, duration_s: float) -> float:
        """Return the highest speed all the time, and one change and hold more."""
        beyond = self.hold_s[1] + change_time(*self.speed_mps, self.limits)
        return self.start_m + self.speed_mps[1] * (duration_s + beyond)

    def drive(self, line: Line, duration_s: float, rng: np.random.Generator) -> DrivenMotion:
        """Starts at rest where there is a ``start_rest_s``, else at a speed of the range."""
        start_speed = 0.0 if self.start_rest_s > 0 else rng.uniform(*self.speed_mps)
        phases, speed = rest(self.start_rest_s), start_speed
        while _duration(phases) < duration_s:
            new_speed = rng.uniform(*self.speed_mps)
            phases += change(speed, new_speed, self.limits) + rest(rng.uniform(*self.hold_s))
            speed = new_speed
        return _within(line, motion(phases, self.start_m, start_speed), duration_s)


@dataclass(frozen=True)
class Shunting:
    """Goes to and fro between places drawn from ``near_m`` to ``far_m``, standing ``dwell_s`` (range) at each."""

    limits: Limits
    speed_mps: tuple[float, float]
    near_m: float
    far_m: float
    shortest_m: float
    start_rest_s: float
    dwell_s: tuple[float, float]

    def furthest_m(self, duration_s: float) -> float:
        """Return the far end."""
        return self.far_m

    def drive(self, line: Line, duration_s: float, rng: np.random.Generator) -> DrivenMotion:
        """Starts at the near end."""
        phases, place, forward = rest(self.start_rest_s), self.near_m, True
        while _duration(phases) < duration_s:
            room = (self.far_m - place) if forward else (place - self.near_m)
            length = rng.uniform(min(self.shortest_m, room), room)
            speed = rng.uniform(*self.speed_mps)
            leg = run(np.array([length]), np.array([speed]), (0.0, 0.0), self.limits)
            phases += leg if forward else reverse(leg)
            phases += rest(rng.uniform(*self.dwell_s))
            place += length if forward else -length
            # Turn round where there is room for it.
            forward = place - self.near_m < self.shortest_m or (not forward and place < self.far_m - self.shortest_m)
        return _within(line, motion(phases, self.near_m), duration_s)


@dataclass(frozen=True)
class Parked:
    """Stands at ``place_m`` all the time."""

    place_m: float

    def furthest_m(self, duration_s: float) -> float:
        """Return the place."""
        return self.place_m

    def drive(self, line: Line, duration_s: float, rng: np.random.Generator) -> DrivenMotion:
        """Return a motion of one phase."""
        return _within(line, motion(rest(duration_s), self.place_m), duration_s)


def _duration(phases: list[Phase]) -> float:
    return sum(duration for duration, _ in phases)


def _within(line: Line, motion: DrivenMotion, duration_s: float) -> DrivenMotion:
    """Return the motion, if it stays on the line until ``duration_s``."""
    turns = motion.breaks_s[motion.breaks_s < duration_s]
    furthest = float(np.max(motion.distance(np.append(turns, duration_s))))
    if furthest > line.length_m:
        raise _too_short(line, furthest)
    return motion


def _too_short(line: Line, needed_m: float) -> BadInputError:
    return BadInputError(f"the line is {line.length_m:.0f} m long: expected {needed_m:.0f} m or more, or a shorter run")


def _stretches(line: Line, start: float, end: float) -> tuple[Array, Array]:
    """Return lengths and speed limits of the stretches between two places."""
    inside = line.limit_from_m[(line.limit_from_m > start) & (line.limit_from_m < end)]
    cuts = np.concatenate([[start], inside, [end]])
    which = np.searchsorted(line.limit_from_m, cuts[:-1], side="right") - 1
    return np.diff(cuts), line.limit_mps[which]
