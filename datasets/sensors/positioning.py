"""Balises on the track and satellites locate the vehicle.

A balise is a place of known chainage; the fix is taken as the reference point passes over it, whichever way, and its
chainage is wrong by white noise. Now and then one is missed, or read as another one: wrong by metres, with the same
sigma.

A GNSS position is that of the antenna, ``p + R_nb r``, wrong per axis by white noise and by multipath, a first-order
Gauss-Markov process, stationary from the start:

    m_{k+1} = phi m_k + sqrt(1 - phi^2) sigma n,  phi = exp(-dt / tau).

Its sigma column holds both together, ``sqrt(sd^2 + sigma^2)``, as if they were white. Outliers come on top, in a random
direction in the plane. The receiver's clock may be off by ``clock_offset_s``: what is to be added to its stamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy  # its signal, which takes 0.5 s, when it is first used

from trackfg.datasets import tables
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Vector3
from trackfg.recording.model import FIX_COLUMNS


@dataclass(frozen=True)
class BaliseModel:
    """A balise every ``spacing_m`` of the line, from its start, or at ``places_m`` only; fixes are good to ``sd_m``.

    Each pass is missed with ``miss_probability``; with ``wrong_probability`` the fix is wrong by ``wrong_m`` (range),
    either way.
    """

    spacing_m: float
    sd_m: float
    miss_probability: float = 0.0
    wrong_probability: float = 0.0
    wrong_m: tuple[float, float] = (10.0, 1000.0)
    places_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class GnssModel:
    """A receiver: noise per axis (east, north, up), antenna, and spans of time (start, end) without positions.

    Of random outages there are ``outages_per_hour``, each ``outage_s`` (range) long. With ``outlier_probability`` a
    position is wrong by ``outlier_m`` (range).
    """

    rate_hz: float = 1.0
    sd_m: Vector3 = (1.0, 1.0, 2.0)
    antenna_m: Vector3 = (0.0, 0.0, 0.0)
    outages_s: tuple[tuple[float, float], ...] = ()
    outages_per_hour: float = 0.0
    outage_s: tuple[float, float] = (5.0, 60.0)
    multipath_sd_m: Vector3 = (0.0, 0.0, 0.0)
    multipath_time_s: float = 30.0
    outlier_probability: float = 0.0
    outlier_m: tuple[float, float] = (10.0, 50.0)
    clock_offset_s: float = 0.0


def balise_table(ride: Ride, model: BaliseModel, duration_s: float, rng: np.random.Generator | None) -> pd.DataFrame:
    """Return the canonical ``fixes`` table until ``duration_s``; complete and exact with no ``rng``."""
    places = np.array(model.places_m) if model.places_m else np.arange(0.0, ride.line.length_m, model.spacing_m)
    times, which = ride.motion.times_at(places)
    during = times <= duration_s
    times, chainage = times[during], ride.chainage(places[which[during]])
    if rng is not None:
        miss_rng, wrong_rng, size_rng = rng.spawn(3)
        chainage = chainage + model.sd_m * rng.standard_normal(len(chainage))
        wrong = wrong_rng.random(len(times)) < model.wrong_probability
        size = size_rng.uniform(-1.0, 1.0, len(times))
        low, high = model.wrong_m
        chainage = chainage + np.where(wrong, np.sign(size) * low + size * (high - low), 0.0)
        read = miss_rng.random(len(times)) >= model.miss_probability
        times, chainage = times[read], chainage[read]
    return tables.table(FIX_COLUMNS, times, chainage, np.full(len(chainage), model.sd_m))


def gnss_table(ride: Ride, model: GnssModel, duration_s: float, rng: np.random.Generator | None) -> pd.DataFrame:
    """Return the canonical ``gnss`` table until ``duration_s``; exact but for placed outages with no ``rng``."""
    t = tables.clock(duration_s, model.rate_hz)
    errors, outages = np.zeros((len(t), 3)), np.array(model.outages_s).reshape(-1, 2)
    if rng is not None:
        outage_rng, multipath_rng, outlier_rng = rng.spawn(3)
        errors = np.array(model.sd_m) * rng.standard_normal((len(t), 3))
        errors = errors + _multipath(model, len(t), multipath_rng) + _outliers(model, len(t), outlier_rng)
        drawn = random_spans(model.outages_per_hour / 3600.0, model.outage_s, duration_s, outage_rng)
        outages = np.concatenate([outages, drawn])
    seen = np.ones(len(t), dtype=bool)
    for start, end in outages:
        seen &= (t < start) | (t >= end)
    t = t[seen]
    antenna: Array = ride.position(t) + ride.rotation(t) @ np.array(model.antenna_m)
    stamps = t if rng is None else t - model.clock_offset_s
    return tables.gnss_table(stamps, antenna + errors[seen], np.hypot(model.sd_m, model.multipath_sd_m))


def _multipath(model: GnssModel, n: int, rng: np.random.Generator) -> Array:
    """Return multipath, m, shape (n, 3)."""
    if not any(model.multipath_sd_m):
        return np.zeros((n, 3))
    phi = float(np.exp(-1.0 / (model.rate_hz * model.multipath_time_s)))
    return np.array(model.multipath_sd_m) * gauss_markov(n, phi, rng)


def gauss_markov(n: int, phi: float, rng: np.random.Generator) -> Array:
    """Return three first-order Gauss-Markov processes of variance 1, stationary from the start; ``phi`` is the
    correlation of neighbours. Shape (n, 3).
    """
    driven = rng.standard_normal((n, 3))
    driven[1:] *= np.sqrt(1.0 - phi * phi)
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -phi], driven, axis=0))


def _outliers(model: GnssModel, n: int, rng: np.random.Generator) -> Array:
    """Return outliers, m, shape (n, 3)."""
    happens, size, way = rng.random((n, 3)).T
    low, high = model.outlier_m
    length = np.where(happens < model.outlier_probability, low + size * (high - low), 0.0)
    angle = 2.0 * np.pi * way
    return np.column_stack([length * np.cos(angle), length * np.sin(angle), np.zeros(n)])
