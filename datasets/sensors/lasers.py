"""Displacement sensors: where a rail is relative to the vehicle, along one body axis.

A sensor at ``r`` in body axes is at ``P = p + R r``. It sees the rail (its top for a vertical sensor, its running
edge for a lateral one) in its own transverse plane, at the place ``s*`` where

    e_x^T R^T (X(s*) - P) = 0,

and measures ``d = e^T R^T (X(s*) - P)``, ``e`` the unit vector of the axis: below the sensor or to its right ``d`` is
negative. To it come a constant offset, white noise, and the rounding to whole quanta.

The rails are evaluated once, every :data:`STEP_M`; between these points each coordinate is the cubic through the four
around it (a wave of 1.5 m is off by 2e-4 of its amplitude). ``s*`` is Newton's, from ``s + r_x``, on that same cubic:
it is off by centimetres at most, however sharp the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Laser, Vector3
from trackfg.recording.model import LASER_COLUMNS

STEP_M = 0.125

_CHUNK = 10_000
"""Of samples and of points: small enough to stay in the processor's cache."""
_MARGIN = 4
"""Points of the rails beyond the first and the last one needed."""
_NEWTON = 3
_FOUR = np.arange(-1, 3)[:, None]
_CUBIC = np.linalg.inv(np.vander([-1.0, 0.0, 1.0, 2.0], 4))
"""From values at four points, one step apart, to the cubic's coefficients; 0 is at the second point."""


@dataclass(frozen=True)
class LaserModel:
    """A sensor. ``offset_sd_m`` is the spread of its constant offset; ``quantum_m`` is 0 where it does not round."""

    name: str
    position_m: Vector3
    axis: Literal["y", "z"]
    rail: Literal["left", "right"]
    rate_hz: float = 200.0
    noise_sd_m: float = 1e-4
    offset_sd_m: float = 0.0
    quantum_m: float = 0.0

    @property
    def sd_m(self) -> float:
        """Return the sigma of one sample, without the offset: noise, and rounding uniform over a quantum."""
        return float(np.hypot(self.noise_sd_m, self.quantum_m / np.sqrt(12.0)))

    @property
    def line(self) -> Literal["top", "edge"]:
        """The part of the rail that it sees."""
        return "top" if self.axis == "z" else "edge"


def two_units(
    front_m: float,
    rear_m: float,
    half_width_m: float,
    height_m: float,
    **sensor: float,
) -> tuple[LaserModel, ...]:
    """Return unit A at x = ``front_m`` and B at ``rear_m``, each with a vertical and a lateral sensor over both rails.

    They sit ``half_width_m`` beside the middle and ``height_m`` above the reference point, and are named
    ``A-left-vertical`` and so on. ``sensor`` are rate, noise, offset and quantum of a :class:`LaserModel`.
    """
    return tuple(
        LaserModel(
            name=f"{unit}-{side}-{'vertical' if axis == 'z' else 'lateral'}",
            position_m=(x, half_width_m if side == "left" else -half_width_m, height_m),
            axis=axis,
            rail=side,
            **sensor,
        )
        for (unit, x), side, axis in product((("A", front_m), ("B", rear_m)), _SIDES, _AXES)
    )


_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
_AXES: tuple[Literal["z", "y"], ...] = ("z", "y")


def laser_tables(
    ride: Ride, track: SimulatedTrack, models: Sequence[LaserModel], duration_s: float, rng: np.random.Generator | None
) -> dict[str, pd.DataFrame]:
    """Return the canonical table of each sensor, by name, until ``duration_s``; exact with no ``rng``.

    ``ride`` is on ``track.line``. Sensors of one rate share their times, so that they can share a file.
    """
    exact: dict[str, tuple[Array, Array]] = {}
    rails = _Rails.along(ride, track, models, duration_s)
    for rate in {model.rate_hz: None for model in models}:
        alike = [model for model in models if model.rate_hz == rate]
        t = tables.clock(duration_s, rate)
        chunks = [_displacements(ride, rails, alike, t[i : i + _CHUNK]) for i in range(0, len(t), _CHUNK)]
        exact |= {model.name: (t, d) for model, d in zip(alike, np.concatenate(chunks, axis=1), strict=True)}
    streams = [None] * len(models) if rng is None else rng.spawn(len(models))
    return {
        model.name: tables.table(LASER_COLUMNS, exact[model.name][0], _measured(exact[model.name][1], model, stream))
        for model, stream in zip(models, streams, strict=True)
    }


def laser_description(model: LaserModel) -> Laser:
    """Return what ``recording.toml`` says of a sensor. The offset is for the user to find."""
    time, displacement = LASER_COLUMNS
    return Laser(
        name=model.name,
        file="lasers.parquet",
        time=time,
        column=displacement,
        position_m=model.position_m,
        axis=model.axis,
        rail=model.rail,
        sd_m=model.sd_m,
    )


def _measured(d: Array, model: LaserModel, rng: np.random.Generator | None) -> Array:
    if rng is None:
        return d
    offset = model.offset_sd_m * rng.standard_normal()
    noisy = d + offset + model.noise_sd_m * rng.standard_normal(len(d))
    return noisy if model.quantum_m == 0.0 else np.rint(noisy / model.quantum_m) * model.quantum_m


@dataclass(frozen=True)
class _Rails:
    """The rails at ``start_m`` and every :data:`STEP_M` from there, (3, n) each, by rail and top or edge."""

    start_m: float
    points: dict[tuple[str, str], Array]

    @classmethod
    def along(cls, ride: Ride, track: SimulatedTrack, models: Sequence[LaserModel], duration_s: float) -> _Rails:
        """Return the rails as far as the sensors get."""
        s = ride.motion.distance(np.append(ride.motion.breaks_s[ride.motion.breaks_s < duration_s], duration_s))
        ahead = [model.position_m[0] for model in models]
        first = np.floor((s.min() + min(ahead, default=0.0)) / STEP_M) - _MARGIN
        last = np.ceil((s.max() + max(ahead, default=0.0)) / STEP_M) + _MARGIN
        places = STEP_M * np.arange(first, last + 1.0)
        pairs = list(dict.fromkeys((model.rail, model.line) for model in models))
        chunks = []
        for i in range(0, len(places), _CHUNK):
            stretch = track.at(places[i : i + _CHUNK])
            chunks.append([stretch.rail(rail, line).T for rail, line in pairs])
        points = (np.concatenate(parts, axis=1) for parts in zip(*chunks, strict=True))
        return cls(float(places[0]), dict(zip(pairs, points, strict=True)))

    def around(self, model: LaserModel, s: Array) -> tuple[Array, Array]:
        """Return the four points around each place, (3, 4, n), and where between the middle two it is, 0 to 1."""
        steps = (s - self.start_m) / STEP_M
        second = np.floor(steps).astype(np.int64)
        return self.points[model.rail, model.line][:, second + _FOUR], steps - second


def _displacements(ride: Ride, rails: _Rails, models: Sequence[LaserModel], t: Array) -> Array:
    """Return exact displacements at times (n,), one row per sensor."""
    s = ride.motion.distance(t)
    place = (ride.position(t) + ride.origin).T
    # By body axis and then component, (3, 3, n): the columns of R.
    axes = np.ascontiguousarray(ride.rotation(t).transpose(2, 1, 0))
    out = np.empty((len(models), len(t)))
    for row, model in enumerate(models):
        sensor = place + np.tensordot(model.position_m, axes, 1)
        points, u = rails.around(model, s + model.position_m[0])
        points -= sensor[:, None]
        ahead, across = (_CUBIC @ np.einsum("cn,cjn->jn", axes[k], points) for k in (0, "xyz".index(model.axis)))
        for _ in range(_NEWTON):
            u = u - _value(ahead, u) / _slope(ahead, u)
        out[row] = _value(across, u)
    return out


def _value(c: Array, u: Array) -> Array:
    return np.asarray(((c[0] * u + c[1]) * u + c[2]) * u + c[3])


def _slope(c: Array, u: Array) -> Array:
    return np.asarray((3.0 * c[0] * u + 2.0 * c[1]) * u + c[2])
