"""Recorders stamp a table by a wrong clock, and lose rows of it.

A clock that is wrong by ``offset + drift t`` stamps what happens at ``t`` with

    stamp = t - offset - drift t + jitter,

so the offset is, as everywhere, what is to be added to the stamps. Jitter is white and normal, but cut off short of
half the time to the nearer neighbour: stamps stay in order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.datasets.vehicle.random_spans import random_spans

_REACH = 0.49
"""How much of the time to a neighbour jitter may take: of two neighbours together, less than all."""


@dataclass(frozen=True)
class ClockModel:
    """A recorder's clock. ``drift`` in s/s."""

    offset_s: float = 0.0
    drift: float = 0.0
    jitter_sd_s: float = 0.0


@dataclass(frozen=True)
class DropModel:
    """Rows that get lost: each with ``probability``, and all within bursts of ``burst_s`` (range), so many an hour."""

    probability: float = 0.0
    bursts_per_hour: float = 0.0
    burst_s: tuple[float, float] = (0.1, 1.0)


def stamped(table: pd.DataFrame, clock: ClockModel, rng: np.random.Generator) -> pd.DataFrame:
    """Return the table with ``t_s``, strictly increasing before and after, as the clock stamps it."""
    t = table["t_s"].to_numpy()
    stamps = t - (clock.offset_s + clock.drift * t)
    if clock.jitter_sd_s and len(t):
        gaps = np.concatenate([[np.inf], np.diff(stamps), [np.inf]])
        most = _REACH * np.minimum(gaps[:-1], gaps[1:])
        stamps = stamps + np.clip(clock.jitter_sd_s * rng.standard_normal(len(t)), -most, most)
    return table.assign(t_s=stamps)


def dropped(table: pd.DataFrame, drops: DropModel, rng: np.random.Generator) -> pd.DataFrame:
    """Return the table without the rows that got lost; bursts are on the clock of ``t_s``, from 0."""
    single_rng, burst_rng = rng.spawn(2)
    t = table["t_s"].to_numpy()
    kept = single_rng.random(len(t)) >= drops.probability
    end = float(t[-1]) if len(t) else 0.0
    for start, stop in random_spans(drops.bursts_per_hour / 3600.0, drops.burst_s, end, burst_rng):
        kept[np.searchsorted(t, start) : np.searchsorted(t, stop)] = False
    return table[kept].reset_index(drop=True)
