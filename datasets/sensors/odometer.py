"""A wheel tachometer.

The wheel's true circumference is ``scale`` times the nominal one, so with ``D`` the distance rolled and the quantum
``q = pi diameter / pulses_per_rev`` the cumulative count is

    count = floor((D / scale + creep W(D)) / q + phase),

``W`` a Wiener process of the distance (micro-creep, m/sqrt(m)) and ``phase`` uniform in [0, 1). ``D`` is signed for a
tachometer that measures the direction, and grows whichever way for one that does not. With ``v`` the vehicle's speed
along the line, ``p`` the distance it has travelled, ``kappa`` the curvature

    dD/dt = v (1 + w p - c kappa + d |kappa| + xi(t)),

``w`` the wear of the wheel (a smaller wheel turns more often: true over nominal distance is ``scale / (1 + w p)``),
``c`` how far to the left of the centre line the rail lies that the wheel follows (at most half the distance of the
rails; a wheel of its own follows its own rail), ``d`` how far to the outside of the curve (a solid axle, whose wheels
cannot both roll in a sharp curve, may follow either rail), ``xi`` the creep of
:mod:`trackfg.datasets.vehicle.adhesion`. The integrals are exact: of piecewise polynomials, and of kappa by the
heading.

The count is sampled at a fixed rate, or the time of each pulse is noted (or of each so-many-th): the tables agree,
since ``W`` is linear between the times of sampling in both. The clock may be early or late by ``clock_offset_s``:
what is to be added to its stamps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import PPoly

from trackfg.datasets import tables
from trackfg.datasets.line.polynomials import restricted
from trackfg.datasets.vehicle.adhesion import AdhesionModel, Slip, draw_slip
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Tach
from trackfg.recording.model import TACH_COLUMNS

SLIP_COLUMNS = ("start_s", "end_s", "kind", "distance_error_m", "peak_creep")

_PULSE_TOLERANCE = 1e-7
"""Of a pulse's time: how far the count may be off then, in pulses."""


@dataclass(frozen=True)
class TachModel:
    """A tachometer and its wheel.

    ``scale_sd`` is the spread of the wheel's true scale, ``wear_per_100km`` the part of its diameter that it loses in
    100 km, ``rail_offset_m`` and ``outward_offset_m`` the place of the rail that it follows, positive to the left and
    to the outside of every curve. ``stamped`` is 0 for a count sampled at ``rate_hz``, 1 for the time of every pulse, n
    for that of every n-th.
    """

    rate_hz: float = 50.0
    pulses_per_rev: float = 90.0
    wheel_diameter_m: float = 0.86
    scale_sd: float = 0.01
    creep_density: float = 0.0
    signed: bool = False
    clock_offset_s: float = 0.0
    wear_per_100km: float = 0.0
    rail_offset_m: float = 0.0
    outward_offset_m: float = 0.0
    stamped: int = 0

    @property
    def quantum_m(self) -> float:
        """The nominal distance of one pulse."""
        return float(np.pi * self.wheel_diameter_m / self.pulses_per_rev)


@dataclass(frozen=True)
class MeasuredWheel:
    """The table of a tachometer on a ride; ``slips`` as of :func:`slip_table`, None where no adhesion was simulated."""

    table: pd.DataFrame
    description: Tach
    scale: float = 1.0
    slips: pd.DataFrame | None = None


def measured_wheel(
    ride: Ride,
    model: TachModel,
    adhesion: AdhesionModel | None,
    duration_s: float,
    rng: np.random.Generator | None,
    kept_rng: np.random.Generator | None = None,
) -> MeasuredWheel:
    """Return what is recorded until ``duration_s``, exact with no ``rng``; ``kept_rng`` is that of a kept scale."""
    if rng is None:
        return MeasuredWheel(ideal_table(ride, model, duration_s), ideal_description(model))
    scale_rng, slip_rng, pulse_rng = rng.spawn(3)
    scale = draw_scale(model, kept_rng or scale_rng)
    slip = None if adhesion is None else draw_slip(ride, adhesion, duration_s, slip_rng)
    table = pulse_table(ride, model, scale, duration_s, pulse_rng, slip)
    return MeasuredWheel(
        table, pulse_description(model), scale, None if slip is None else slip_table(ride, model, slip)
    )


def draw_scale(model: TachModel, rng: np.random.Generator) -> float:
    """Return the wheel scale of a run at its start: true distance over nominal distance."""
    return float(1.0 + model.scale_sd * rng.standard_normal())


def worn_scale(ride: Ride, model: TachModel, scale: float, t: Array) -> Array:
    """Return the wheel scale at times ``t``, from that at the start. Shape (n,)."""
    return np.asarray(scale / (1.0 + 1e-5 * model.wear_per_100km * ride.motion.path(t)))


def rolled_distance(ride: Ride, model: TachModel, t: Array, slip: Slip | None = None) -> Array:
    """Return the distance ``D`` that the tachometer sees, from 0 at t = 0. Shape (n,)."""
    return _rolled(ride, model, slip)(t)


def pulse_table(
    ride: Ride, model: TachModel, scale: float, duration_s: float, rng: np.random.Generator, slip: Slip | None = None
) -> pd.DataFrame:
    """Return the canonical ``tach`` table of a pulse count (distances are whole multiples of the quantum).

    Stamped pulses have one row each, with the count after the pulse, and besides a row at the start and one at the end
    of the recording: at rest there are no others.
    """
    creep_rng, phase_rng = rng.spawn(2)
    t = tables.clock(duration_s, model.rate_hz)
    rolled = _rolled(ride, model, slip)
    at_clock = rolled(t)
    steps = np.sqrt(np.abs(np.diff(at_clock))) * creep_rng.standard_normal(len(t) - 1)
    creep = model.creep_density * np.concatenate([[0.0], np.cumsum(steps)])
    phase = phase_rng.uniform()

    def pulses(distance: Array, creep: Array) -> Array:
        return np.asarray((distance / scale + creep) / model.quantum_m + phase)

    if not model.stamped:
        count = _counted(pulses(at_clock, creep), model)
        return tables.tach_table(t - model.clock_offset_s, count * model.quantum_m)
    # Within a phase of the motion nothing turns round.
    breaks = ride.motion.breaks_s
    edges = np.union1d(t, breaks[(breaks > 0) & (breaks < t[-1])])
    times, count = _stamps(lambda at: pulses(rolled(at), np.interp(at, t, creep)), edges, model)
    return tables.tach_table(times - model.clock_offset_s, count * model.quantum_m)


def slip_table(ride: Ride, model: TachModel, slip: Slip) -> pd.DataFrame:
    """Return the truth of the events: columns :data:`SLIP_COLUMNS`, one row each, on the true clock.

    ``distance_error_m`` is what the event adds to ``D``, creep below the limit included; ``peak_creep`` has its sign.
    """
    if not slip.events:
        return pd.DataFrame({name: pd.Series(dtype=str if name == "kind" else float) for name in SLIP_COLUMNS})
    added = _product(_speed(ride, model), slip.creep).antiderivative()
    rows = [
        (event.start_s, event.end_s, event.kind, float(added(event.end_s) - added(event.start_s)), event.creep)
        for event in slip.events
    ]
    return pd.DataFrame(rows, columns=list(SLIP_COLUMNS))


def ideal_table(ride: Ride, model: TachModel, duration_s: float) -> pd.DataFrame:
    """Return the canonical ``tach`` table of a perfect wheel: true distance, neither counted nor late."""
    t = tables.clock(duration_s, model.rate_hz)
    perfect = ride.motion.distance(t) - ride.motion.distance(0.0) if model.signed else ride.motion.path(t)
    return tables.tach_table(t, perfect)


def pulse_description(model: TachModel) -> Tach:
    """Return what ``recording.toml`` says of a pulse count. The clock offset is for the user to find."""
    return Tach(
        file="tach.parquet",
        time=TACH_COLUMNS[0],
        column="count",
        kind="pulses",
        pulses_per_rev=model.pulses_per_rev,
        wheel_diameter_m=model.wheel_diameter_m,
        scale_sd=model.scale_sd,
        signed=model.signed,
    )


def ideal_description(model: TachModel) -> Tach:
    """Return what ``recording.toml`` says of :func:`ideal_table`."""
    return Tach(
        file="tach.parquet",
        time=TACH_COLUMNS[0],
        column=TACH_COLUMNS[1],
        kind="distance",
        unit="m",
        scale_sd=model.scale_sd,
        signed=model.signed,
    )


def _speed(ride: Ride, model: TachModel) -> PPoly:
    """Return what the wheel's speed is proportional to."""
    return ride.motion.speed if model.signed else ride.motion.path.derivative()


def _rolled(ride: Ride, model: TachModel, slip: Slip | None) -> Callable[[Array], Array]:
    """Return ``D`` as a function of time."""
    added: list[PPoly] = []
    if model.wear_per_100km:
        wear = PPoly(1e-5 * model.wear_per_100km * ride.motion.path.c, ride.motion.path.x)
        added.append(_product(_speed(ride, model), wear).antiderivative())
    if slip is not None:
        added.append(_product(_speed(ride, model), slip.creep).antiderivative())

    bent = _bent(ride.line.curvature) if model.outward_offset_m else ride.line.yaw

    def rolled(t: Array) -> Array:
        distance = ride.motion.distance(t) - ride.motion.distance(0.0) if model.signed else ride.motion.path(t)
        for extra in added:
            distance = distance + extra(t)
        if model.rail_offset_m:
            distance = distance - model.rail_offset_m * _gained(ride.line.yaw, ride, model, t)
        if model.outward_offset_m:
            distance = distance + model.outward_offset_m * _gained(bent, ride, model, t)
        return np.asarray(distance)

    return rolled


def _gained(of_place: Callable[[Array], Array], ride: Ride, model: TachModel, t: Array) -> Array:
    """Return the integral of the derivative of ``of_place`` over the distance that the tachometer sees. Shape (n,)."""
    at_t = of_place(ride.motion.distance(t))
    breaks = ride.motion.breaks_s
    at_breaks = of_place(ride.motion.distance(breaks))
    if model.signed:
        return np.asarray(at_t - at_breaks[0])
    sign = np.where(np.diff(ride.motion.distance(breaks)) < 0, -1.0, 1.0)
    sums = np.concatenate([[0.0], np.cumsum(sign * np.diff(at_breaks))])
    phase = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(sign) - 1)
    return np.asarray(sums[phase] + sign[phase] * (at_t - at_breaks[phase]))


def _bent(curvature: PPoly) -> PPoly:
    """Return the integral of the curvature's magnitude, rad, as a function of the place."""
    zeros = curvature.roots(extrapolate=False)
    edges = np.union1d(curvature.x, zeros[np.isfinite(zeros)])
    pieces = restricted(curvature, edges)
    sign = np.where(curvature(0.5 * (edges[1:] + edges[:-1])) < 0, -1.0, 1.0)
    return PPoly(sign * pieces, edges, extrapolate=True).antiderivative()


def _product(a: PPoly, b: PPoly) -> PPoly:
    """Return ``a b`` where both are defined."""
    edges = np.union1d(a.x, b.x)
    edges = edges[(edges >= max(a.x[0], b.x[0])) & (edges <= min(a.x[-1], b.x[-1]))]
    left, right = restricted(a, edges), restricted(b, edges)
    product = np.zeros((len(left) + len(right) - 1, len(edges) - 1))
    for i, row in enumerate(left):
        product[i : i + len(right)] += row * right
    return PPoly(product, edges)


def _counted(pulses: Array, model: TachModel) -> Array:
    count = np.floor(pulses)
    return count if model.signed else np.maximum.accumulate(count)


def _stamps(pulses: Callable[[Array], Array], edges: Array, model: TachModel) -> tuple[Array, Array]:
    """Return times of pulses and the count after each, with the first and the last of ``edges`` about them."""
    at_edges = pulses(edges)
    count = _counted(at_edges, model)
    steps = np.diff(count)
    pulse_count = np.abs(steps).astype(np.int64)
    cell = np.repeat(np.arange(len(steps)), pulse_count)
    nth = np.arange(len(cell)) - np.repeat(np.cumsum(pulse_count) - pulse_count, pulse_count)
    way = np.sign(steps)[cell]
    # Upwards the first number passed is one above the count, downwards it is the count itself.
    number = count[cell] + np.where(way > 0, 1.0 + nth, -nth)
    kept = number % model.stamped == 0
    cell, way, number = cell[kept], way[kept], number[kept]
    times = _crossings(pulses, number, edges[cell], edges[cell + 1], at_edges[cell], at_edges[cell + 1])
    next_count = np.where(way > 0, number, number - 1.0)
    inside = (times > edges[0]) & (times < edges[-1])
    return (
        np.concatenate([edges[:1], times[inside], edges[-1:]]),
        np.concatenate([count[:1], next_count[inside], count[-1:]]),
    )


def _crossings(
    f: Callable[[Array], Array], level: Array, low: Array, high: Array, f_low: Array, f_high: Array
) -> Array:
    """Return where ``f`` passes ``level`` between ``low`` and ``high``, all (n,): regula falsi, Illinois variant."""
    low, high, below, above = low.copy(), high.copy(), f_low - level, f_high - level
    times = np.empty_like(low)
    active = np.arange(len(low))
    for _ in range(100):
        if not active.size:
            break
        a, b = below[active], above[active]
        t = np.clip(low[active] - a * (high[active] - low[active]) / (b - a), low[active], high[active])
        off = f(t) - level[active]
        times[active] = t
        same_as_low = np.sign(off) == np.sign(a)
        # The end that stays counts half, lest it stay for ever.
        above[active] = np.where(same_as_low, 0.5 * b, off)
        below[active] = np.where(same_as_low, off, 0.5 * a)
        low[active] = np.where(same_as_low, t, low[active])
        high[active] = np.where(same_as_low, high[active], t)
        active = active[(np.abs(off) > _PULSE_TOLERANCE) & (high[active] - low[active] > 1e-13)]
    return times
