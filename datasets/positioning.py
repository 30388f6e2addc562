"""What tells the vehicle where it is: balises on the track and satellites.

A balise is a place of known chainage; the fix is taken as the reference point passes over it, whichever way, and its
chainage is wrong by white noise. A GNSS position is that of the antenna, ``p + R_nb r``, with white noise per axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.ride import Ride
from trackfg.description import Vector3
from trackfg.frames import Array


@dataclass(frozen=True)
class BaliseModel:
    """A balise every ``spacing_m`` of the line, from its start; fixes are good to ``sd_m``."""

    spacing_m: float
    sd_m: float


@dataclass(frozen=True)
class GnssModel:
    """A receiver: noise per axis (east, north, up), antenna, and spans of time (start, end) without positions."""

    rate_hz: float = 1.0
    sd_m: Vector3 = (1.0, 1.0, 2.0)
    antenna_m: Vector3 = (0.0, 0.0, 0.0)
    outages_s: tuple[tuple[float, float], ...] = ()


def balise_table(ride: Ride, model: BaliseModel, duration_s: float, rng: np.random.Generator | None) -> pd.DataFrame:
    """The canonical ``fixes`` table until ``duration_s``; exact with no ``rng``."""
    places = np.arange(0.0, ride.line.length_m, model.spacing_m)
    times, which = ride.motion.times_at(places)
    during = times <= duration_s
    chainage = ride.chainage(places[which[during]])
    if rng is not None:
        chainage = chainage + model.sd_m * rng.standard_normal(len(chainage))
    return tables.fix_table(times[during], chainage, np.full(len(chainage), model.sd_m))


def gnss_table(ride: Ride, model: GnssModel, duration_s: float, rng: np.random.Generator | None) -> pd.DataFrame:
    """The canonical ``gnss`` table until ``duration_s``; exact with no ``rng``."""
    t = tables.clock(duration_s, model.rate_hz)
    noise = np.zeros((len(t), 3)) if rng is None else rng.standard_normal((len(t), 3))
    seen = np.ones(len(t), dtype=bool)
    for start, end in model.outages_s:
        seen &= (t < start) | (t >= end)
    t, sd = t[seen], np.array(model.sd_m)
    antenna: Array = ride.position(t) + ride.rotation(t) @ np.array(model.antenna_m)
    return tables.gnss_table(t, antenna + sd * noise[seen], sd)
