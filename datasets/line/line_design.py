"""Random lines with realistic parameters.

Plan: straights and circles joined by clothoids. A curve of radius R has the speed limit at which its cant and cant
deficiency are both at their limit, ``v^2 = (cant_max + deficiency_max) g R / base``, rounded down to 5 km/h and capped
by the line's; its cant is the equilibrium cant at that speed, ``base v^2 / (g R)``, less the usual deficiency, rounded
to 5 mm. Transitions are ``400 x cant`` long, at least ``transition_min_m``, and cant ramps linearly over them.

Profile: constant gradients of random length and slope, held near zero height and flat at stations, joined by circular
vertical curves.

Limits: see "Construction" in the reference list of docs/datasets.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.datasets.line.line import Line, piecewise_linear
from trackfg.numerics import units
from trackfg.numerics.arrays import Array

Range = tuple[float, float]


@dataclass(frozen=True)
class LineDesign:
    """Ranges from which a line is drawn (uniformly, radii log-uniformly), SI."""

    gauge_m: float
    cross_level_base_m: float
    line_speed_mps: float
    radius_m: Range
    straight_m: Range
    circle_m: Range
    max_turn_rad: float
    cant_max_m: float
    deficiency_max_m: float
    usual_deficiency_m: float
    transition_min_m: float
    max_gradient: float
    station_gradient: float
    gradient_length_m: Range
    vertical_radius_m: Range
    station_spacing_m: float


@dataclass(frozen=True)
class _Plan:
    """Points of the plan: place, curvature, cant; and speed limits from their places on."""

    s: Array
    curvature: Array
    cant: Array
    limit_from: Array
    limit: Array
    straights: Array


_STATION_HALF_M = 150.0
"""Half of the level, straight track at a station, m. Chosen here."""
_HEIGHT_SCALE_M = 50.0
"""Height above the start, m, at which the mean gradient back is the steepest one. Chosen here."""


def random_line(design: LineDesign, length_m: float, rng: np.random.Generator, *, start_yaw_rad: float = 0.0) -> Line:
    """Return a line of at least ``length_m``. The same ``rng`` state gives the same line; a longer one begins the same
    way.
    """
    plan_rng, profile_rng = rng.spawn(2)
    plan = _random_plan(design, length_m, plan_rng)
    stations = _stations(design, plan.straights)
    profile_s, gamma = _random_profile(design, plan.s[-1], stations, profile_rng)
    return Line(
        curvature=piecewise_linear(plan.s, plan.curvature),
        cant=piecewise_linear(plan.s, plan.cant),
        grade=piecewise_linear(profile_s, gamma),
        length_m=float(plan.s[-1]),
        cross_level_base_m=design.cross_level_base_m,
        limit_from_m=plan.limit_from,
        limit_mps=plan.limit,
        stations_m=stations,
        start_yaw_rad=start_yaw_rad,
    )


def curve_speed(design: LineDesign, radius_m: float) -> float:
    """Return the speed limit of a curve, m/s."""
    lateral = (design.cant_max_m + design.deficiency_max_m) * units.STANDARD_GRAVITY / design.cross_level_base_m
    step = 5.0 * units.KMH
    return min(float(np.floor(np.sqrt(lateral * radius_m) / step) * step), design.line_speed_mps)


def curve_cant(design: LineDesign, radius_m: float, speed_mps: float) -> float:
    """Return the cant of a curve, m."""
    equilibrium = design.cross_level_base_m * speed_mps**2 / (units.STANDARD_GRAVITY * radius_m)
    return float(np.clip(np.round((equilibrium - design.usual_deficiency_m) / 0.005) * 0.005, 0.0, design.cant_max_m))


def _random_plan(design: LineDesign, length_m: float, rng: np.random.Generator) -> _Plan:
    s, curvature, cant = [0.0], [0.0], [0.0]
    limit_from, limit, straights = [0.0], [design.line_speed_mps], []

    def advance(length: float, to_curvature: float, to_cant: float) -> None:
        s.append(s[-1] + length)
        curvature.append(to_curvature)
        cant.append(to_cant)

    while True:
        start = s[-1]
        advance(rng.uniform(*design.straight_m), 0.0, 0.0)
        straights.append((start, s[-1]))
        if s[-1] >= length_m:
            break
        radius = float(np.exp(rng.uniform(*np.log(design.radius_m))))
        side = rng.choice([-1.0, 1.0])
        speed = curve_speed(design, radius)
        # The outer rail is the higher one: the right rail in a curve to the left.
        high = -side * curve_cant(design, radius, speed)
        transition = max(design.transition_min_m, 400.0 * abs(high))
        circle = min(rng.uniform(*design.circle_m), max(design.max_turn_rad * radius - transition, 20.0))
        limit_from.append(s[-1])
        limit.append(speed)
        advance(transition, side / radius, high)
        advance(circle, side / radius, high)
        advance(transition, 0.0, 0.0)
        limit_from.append(s[-1])
        limit.append(design.line_speed_mps)
    return _Plan(*(np.array(column) for column in (s, curvature, cant, limit_from, limit, straights)))


def _stations(design: LineDesign, straights: Array) -> Array:
    """Return the middles of straights that are long enough, at least the spacing apart."""
    stations: list[float] = []
    for start, end in straights:
        middle = 0.5 * (start + end)
        far = middle >= (stations[-1] if stations else 0.0) + design.station_spacing_m
        if far and end - start >= 2 * _STATION_HALF_M:
            stations.append(middle)
    return np.array(stations)


def _random_profile(
    design: LineDesign, length_m: float, stations: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return places and angles (n,) of the piecewise linear gradient angle."""
    s, gamma = [0.0], [0.0]
    place, height, angle = 0.0, 0.0, 0.0
    while place < length_m:
        length = rng.uniform(*design.gradient_length_m)
        near = np.any((stations > place - _STATION_HALF_M) & (stations < place + length + _STATION_HALF_M))
        limit = design.station_gradient if near else design.max_gradient
        slope = np.clip(limit * (rng.uniform(-1.0, 1.0) - height / _HEIGHT_SCALE_M), -limit, limit)
        new_angle = float(np.round(np.arcsin(slope), 4))
        if place > 0.0 and new_angle != angle:
            # A circle of this radius tangent to both gradients, its middle at the point where they meet.
            half = 0.5 * rng.uniform(*design.vertical_radius_m) * abs(new_angle - angle)
            s += [place - half, place + half]
            gamma += [angle, new_angle]
        elif place == 0.0:
            gamma[0] = new_angle
        place, height, angle = place + length, height + length * np.sin(new_angle), new_angle
    return np.array([*s, place]), np.array([*gamma, angle])
