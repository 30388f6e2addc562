"""The measured axle slips or slides where the driver demands more of the rail than it can give.

The vehicle moves as the driver planned; the axle that the tachometer sits on rolls ``int v (1 + creep) dt`` meanwhile,
creep positive when it slips under traction, negative when it slides under the brake, -1 when it is locked.

**Demand.** With ``a`` the acceleration and ``gamma`` the gradient in the direction of travel (running resistance is
neglected) the wheels must transmit, per mass, ``d = a + g sin gamma``: forward if positive, by the driven axles, else
by the braked ones. Where the axles at work carry a share of the weight, the adhesion needed is ``|d| / (share g)``.

**Supply.** Curtius and Kniffler's curve times a factor for what lies on the rail, 1 where nothing does:

    mu(v) = factor (7.5 / (3.6 v + 44) + 0.161),  v in m/s,

about 0.33 dry at rest; 0.2 wet and below 0.05 on leaves or ice are factors of 0.6 and 0.15.

**Below the limit** the axle creeps. The creep curve ``u = 2 x / (1 + x^2)``, u the adhesion used over that available
and x the creep over that at the curve's top (the curve of Open Rails, in which x is ``mu dv / K``), gives on its
stable side

    x = (1 - sqrt(1 - u^2)) / u;

``top_creep`` is the creep at the top.

**Beyond it** the axle breaks away. It speeds up or slows down ``gain`` times (5 to 10) as fast as the vehicle is
driven, so its creep grows by ``(gain - 1) |d| / v`` a second, up to a peak drawn log-uniformly; it stays there, or on
the brake cycles below it as slide protection releases and applies (a saw-tooth), until the demand falls below the
supply or the driver lets go, after a time drawn log-normally (median 4 s, 90 % within 10 s) and kept to 1-30 s. If the
demand is still there after a pause, it starts again. Creep is piecewise linear in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import PPoly

from trackfg.datasets import tables
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics import units
from trackfg.numerics.arrays import Array

_GRID_HZ = 10.0
"""Rate at which demand and supply are compared, Hz."""
_SLOWEST_MPS = 1.0
"""Speed of the vehicle, m/s, below which no slip is drawn: it would hardly show."""
_SHORTEST_S, _LONGEST_S = 1.0, 30.0
"""Shortest and longest event, s. Assumed."""
_MEDIAN_S = 4.0
"""Median of an event's length, s. Assumed."""
_LOG_SD = float(np.log(10.0 / _MEDIAN_S) / 1.2816)
"""1.2816 is the 90 % point of the normal distribution."""
_GAIN = (5.0, 10.0)
"""Range of the axle's acceleration over the vehicle's, beyond the limit. Assumed."""
_PAUSE_S = (1.0, 4.0)
"""Range of the pause before the next event, s. Assumed."""
_CYCLE_S = (1.0, 2.0)
"""Range of a cycle of slide protection, s. Assumed."""
_APPLYING, _HELD = 0.7, 0.2
"""Of a cycle of slide protection: the share in which the slide grows, and what of its peak is left after a release."""


Shape = Literal["trapezoid", "triangle", "sawtooth"]


@dataclass(frozen=True)
class LowAdhesion:
    """A stretch of the line, in arc length, where adhesion is ``mu_factor`` times that of a dry rail."""

    from_m: float
    to_m: float
    mu_factor: float


@dataclass(frozen=True)
class WheelSlip:
    """One slip (``creep`` > 0) or slide (< 0, not below -1), whose creep goes up to ``creep``.

    A trapezoid rises and falls within ``ramp_s`` (or half the duration), a triangle within half the duration, a
    saw-tooth in cycles of about ``cycle_s``. Raises ``ValueError`` for a creep or a duration that cannot be.
    """

    start_s: float
    duration_s: float
    creep: float
    shape: Shape = "trapezoid"
    ramp_s: float = 0.5
    cycle_s: float = 1.5

    def __post_init__(self) -> None:
        if not (self.creep >= -1.0 and self.creep != 0.0 and self.duration_s > 0.0):
            raise ValueError(f"{self}: expected a creep of -1 or more but 0, and a duration above 0")

    @property
    def end_s(self) -> float:
        """Return when the axle rolls again."""
        return self.start_s + self.duration_s

    @property
    def kind(self) -> Literal["slip", "slide"]:
        """Return the kind by the sign of the creep."""
        return "slip" if self.creep > 0 else "slide"

    def corners(self) -> tuple[Array, Array]:
        """Return times (k,) and creeps (k,) between which the creep is linear; 0 at both ends."""
        if self.shape == "sawtooth":
            n = max(1, round(self.duration_s / self.cycle_s))
            at = np.sort(np.concatenate([np.arange(n + 1.0), np.arange(n) + _APPLYING])) / n
            share = np.tile([_HELD, 1.0], n + 1)[:-1]
            share[[0, -1]] = 0.0
        else:
            ramp = 0.5 if self.shape == "triangle" else min(self.ramp_s / self.duration_s, 0.5)
            at = np.unique([0.0, ramp, 1.0 - ramp, 1.0])
            share = np.where((at > 0) & (at < 1), 1.0, 0.0)
        return self.start_s + at * self.duration_s, share * self.creep


@dataclass(frozen=True)
class AdhesionModel:
    """Rail and axle. By default the rail is dry, and the axle creeps only.

    ``low`` are places of low adhesion; more are drawn, ``stretches_per_km`` of them, lengths and factors uniform.
    ``traction_share`` and ``braking_share``: of the weight, on the axles that drive and brake. ``peak_creep`` is the
    range of what a slip or slide goes up to. ``events`` happen whatever the demand, and instead of drawn ones.
    """

    low: tuple[LowAdhesion, ...] = ()
    stretches_per_km: float = 0.0
    stretch_m: tuple[float, float] = (50.0, 300.0)
    mu_factor: tuple[float, float] = (0.1, 0.4)
    traction_share: float = 0.5
    braking_share: float = 1.0
    top_creep: float = 0.01
    peak_creep: tuple[float, float] = (0.01, 0.6)
    slide_protection: bool = True
    events: tuple[WheelSlip, ...] = ()


@dataclass(frozen=True)
class Slip:
    """The creep of the measured axle in one run, as a function of time, and the events in it, in order of time."""

    creep: PPoly
    events: tuple[WheelSlip, ...]


def adhesion_limit(speed_mps: Array) -> Array:
    """Return Curtius and Kniffler's adhesion of a dry rail. Shape (...)."""
    return np.asarray(7.5 / (3.6 * np.abs(speed_mps) + 44.0) + 0.161)


def draw_slip(ride: Ride, model: AdhesionModel, duration_s: float, rng: np.random.Generator) -> Slip:
    """Return what happens to the measured axle on ``ride``. Raises ``ValueError`` where placed events overlap."""
    stretch_rng, factor_rng, event_rng = rng.spawn(3)
    spans = random_spans(1e-3 * model.stretches_per_km, model.stretch_m, ride.line.length_m, stretch_rng)
    factors = factor_rng.uniform(*model.mu_factor, len(spans))
    drawn = tuple(LowAdhesion(start, end, factor) for (start, end), factor in zip(spans, factors, strict=True))
    # To the end of the motion, not of the recording: what happens must not depend on where the recording stops.
    t = tables.clock(ride.motion.duration_s, _GRID_HZ)
    demand, used = _demand(ride, model, (*model.low, *drawn), t)
    placed = tuple(sorted(model.events, key=lambda event: event.start_s))
    events = [
        event
        for event in _breakaways(ride, model, t, demand, used, event_rng)
        if not any(event.start_s < other.end_s and other.start_s < event.end_s for other in placed)
    ]
    happened = sorted((*events, *placed), key=lambda event: event.start_s)
    happened = [event for event in happened if event.start_s < duration_s]
    return Slip(_creep(happened, t, _creep_below_limit(model, demand, used)), tuple(happened))


def _demand(ride: Ride, model: AdhesionModel, low: Sequence[LowAdhesion], t: Array) -> tuple[Array, Array]:
    """Return the acceleration to be transmitted, m/s^2, positive forward, and the share of the adhesion that it
    needs.
    """
    s, v = ride.motion.distance(t), ride.motion.speed(t)
    g = units.STANDARD_GRAVITY
    demand = np.sign(v) * (ride.motion.acceleration(t) + g * np.sin(ride.line.grade(s)))
    factor = np.ones_like(s)
    for stretch in low:
        within = (s >= stretch.from_m) & (s < stretch.to_m)
        factor[within] = np.minimum(factor[within], stretch.mu_factor)
    share = np.where(demand > 0, model.traction_share, model.braking_share)
    return demand, np.abs(demand) / (share * g * factor * adhesion_limit(v))


def _creep_below_limit(model: AdhesionModel, demand: Array, used: Array) -> Array:
    u = np.clip(used, 1e-9, 1.0)
    return np.asarray(np.sign(demand) * model.top_creep * (1.0 - np.sqrt(1.0 - u * u)) / u)


def _breakaways(
    ride: Ride, model: AdhesionModel, t: Array, demand: Array, used: Array, rng: np.random.Generator
) -> list[WheelSlip]:
    """Return an event after the other wherever more than the whole adhesion is needed."""
    over = (used > 1.0) & (np.abs(ride.motion.speed(t)) > _SLOWEST_MPS)
    way = np.where(over, np.sign(demand), 0.0)
    events: list[WheelSlip] = []
    for first, stop in pairwise(np.flatnonzero(np.diff(way, prepend=0.0, append=0.0)).tolist()):
        if way[first] == 0.0:
            continue
        start, end = float(t[first]), float(t[min(stop, len(t) - 1)])
        while end - start >= _SHORTEST_S:
            i = int(np.searchsorted(t, start))
            event = _breakaway(model, start, end, float(demand[i]), float(abs(ride.motion.speed(start))), rng)
            events.append(event)
            start = event.end_s + rng.uniform(*_PAUSE_S)
    return events


def _breakaway(
    model: AdhesionModel, start: float, end: float, demand: float, speed: float, rng: np.random.Generator
) -> WheelSlip:
    released = np.clip(_MEDIAN_S * np.exp(_LOG_SD * rng.standard_normal()), _SHORTEST_S, _LONGEST_S)
    duration = float(min(released, end - start))
    peak = float(np.exp(rng.uniform(*np.log(model.peak_creep))))
    growth = (rng.uniform(*_GAIN) - 1.0) * abs(demand) / speed
    cycle = rng.uniform(*_CYCLE_S)
    sign = 1.0 if demand > 0 else -1.0
    if demand < 0 and model.slide_protection and duration >= 2.0 * cycle:
        return WheelSlip(start, duration, sign * min(peak, growth * _APPLYING * cycle), "sawtooth", cycle_s=cycle)
    peak = min(peak, growth * 0.5 * duration)
    return WheelSlip(start, duration, sign * peak, ramp_s=peak / growth)


def _creep(events: Sequence[WheelSlip], t: Array, below_limit: Array) -> PPoly:
    """Return creep below the limit, given at ``t``, and the events on top of it; nowhere below -1."""
    for event, following in pairwise(events):
        if following.start_s < event.end_s:
            raise ValueError(f"{event} and {following} overlap")
    corners = [event.corners() for event in events]
    at = np.concatenate([[0.0], *(times for times, _ in corners)])
    values = np.concatenate([[0.0], *(creeps for _, creeps in corners)])
    edges = np.union1d(t, at)
    # Equal times carry equal values, 0: an event that starts as another one ends.
    total = np.maximum(np.interp(edges, t, below_limit) + np.interp(edges, at, values, left=0.0, right=0.0), -1.0)
    return PPoly(np.stack([np.diff(total) / np.diff(edges), total[:-1]]), edges)
