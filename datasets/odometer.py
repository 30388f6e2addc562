"""A wheel tachometer.

The wheel's true circumference is ``scale`` times the nominal one, so with ``D`` the distance rolled and the quantum
``q = pi diameter / pulses_per_rev`` the cumulative count is

    count = floor((D / scale + creep W(D)) / q + phase),

``W`` a Wiener process of the distance (micro-creep, m/sqrt(m)) and ``phase`` uniform in [0, 1). ``D`` is the signed
distance from the start for a tachometer that tells the direction, and the distance rolled whichever way for one that
does not. The count is sampled at a fixed rate; its clock may be early or late by ``clock_offset_s``: what is to be
added to its stamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.ride import Ride
from trackfg.description import Tach
from trackfg.frames import Array
from trackfg.recording import TACH_COLUMNS


@dataclass(frozen=True)
class TachModel:
    """A tachometer and its wheel. ``scale_sd`` is the spread of the wheel's true scale."""

    rate_hz: float = 50.0
    pulses_per_rev: float = 90.0
    wheel_diameter_m: float = 0.86
    scale_sd: float = 0.01
    creep_density: float = 0.0
    signed: bool = False
    clock_offset_s: float = 0.0

    @property
    def quantum_m(self) -> float:
        """The nominal distance of one pulse."""
        return float(np.pi * self.wheel_diameter_m / self.pulses_per_rev)


def draw_scale(model: TachModel, rng: np.random.Generator) -> float:
    """The wheel scale of a run: true distance over nominal distance."""
    return float(1.0 + model.scale_sd * rng.standard_normal())


def rolled_distance(ride: Ride, model: TachModel, t: Array) -> Array:
    """The true distance that the tachometer sees, from 0 at t = 0. Shape (n,)."""
    if model.signed:
        return np.asarray(ride.motion.distance(t) - ride.motion.distance(0.0))
    return np.asarray(ride.motion.path(t))


def pulse_table(
    ride: Ride, model: TachModel, scale: float, duration_s: float, rng: np.random.Generator
) -> pd.DataFrame:
    """The canonical ``tach`` table of a pulse count (distances are whole multiples of the quantum)."""
    creep_rng, phase_rng = rng.spawn(2)
    t = tables.clock(duration_s, model.rate_hz)
    rolled = rolled_distance(ride, model, t)
    steps = np.sqrt(np.abs(np.diff(rolled))) * creep_rng.standard_normal(len(t) - 1)
    nominal = rolled / scale + model.creep_density * np.concatenate([[0.0], np.cumsum(steps)])
    count = np.floor(nominal / model.quantum_m + phase_rng.uniform())
    if not model.signed:
        count = np.maximum.accumulate(count)
    return tables.tach_table(t - model.clock_offset_s, count * model.quantum_m)


def ideal_table(ride: Ride, model: TachModel, duration_s: float) -> pd.DataFrame:
    """The canonical ``tach`` table of a perfect wheel: true distance, neither counted nor late."""
    t = tables.clock(duration_s, model.rate_hz)
    return tables.tach_table(t, rolled_distance(ride, model, t))


def pulse_description(model: TachModel) -> Tach:
    """What ``recording.toml`` says of a pulse count. The clock offset is for the user to find."""
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
    """What ``recording.toml`` says of :func:`ideal_table`."""
    return Tach(
        file="tach.parquet",
        time=TACH_COLUMNS[0],
        column=TACH_COLUMNS[1],
        kind="distance",
        unit="m",
        scale_sd=model.scale_sd,
        signed=model.signed,
    )
