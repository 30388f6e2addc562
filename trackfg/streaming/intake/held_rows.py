"""A receiver's rows that its table holds are left out of a stream, as they are of a recording.

:mod:`trackfg.recording.receiver_epochs` says how often a receiver measures, and what a run of equal rows means. A
stream does not know how long a run will last, nor where the vehicle is when the values change again. So it takes the
receiver's interval from the newest runs in motion, one second before there are any, and the tach's distance for
whether the vehicle moves while a position stays. At rest, and in a tunnel without a tach, a row is passed on whenever
one and a half intervals are over: earlier it may be the one before. Where rows come no more often than measurements,
all are passed on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.model import GNSS_SPEED_TABLE
from trackfg.recording.receiver_epochs import FEWEST_RUNS, IN_MOTION_MPS, LONGER, SLOWEST_S
from trackfg.streaming.events import LossReport

NEWEST_RUNS = 15
"""The receiver's interval is the median of so many runs: a change of its rate is followed within as many."""
_BEFORE_TACH = np.array([[-np.inf, np.nan]])
"""A row of the tach before its first one: the distance is not known."""
_EQUAL = 1e-6
"""Values that differ by less, m or m/s, are equal: conversion rounds, and no receiver repeats itself as closely."""


@dataclass
class _Run:
    """Equal rows of one table: ``values`` (k,), since ``first_s``, where the tach's distance was ``first_m`` (NaN
    without a tach); ``kept_s``: time of the newest row that was passed on, ``newest_s`` of the newest one.
    ``lasted_s``: the newest runs in motion.
    """

    values: Array
    first_s: float
    kept_s: float
    newest_s: float
    first_m: float
    lasted_s: list[float] = field(default_factory=list)

    @property
    def interval_s(self) -> float:
        """The time from one measurement of the receiver to the next, s."""
        return float(np.median(self.lasted_s)) if len(self.lasted_s) >= FEWEST_RUNS else SLOWEST_S


@dataclass
class HeldRows:
    """Keeps the newest run of equal rows of each receiver's table, and the newest row (0 or 1, 2) of the tach."""

    runs: dict[str, _Run] = field(default_factory=dict)
    tach: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def without(self, tables: Mapping[str, Array], report: LossReport) -> dict[str, Array]:
        """Return canonical tables without rows that hold values of a row before; these are reported."""
        out = dict(tables)
        tach = tables.get("tach", self.tach[:0])
        for name in ("gnss", GNSS_SPEED_TABLE):
            if name in out and len(out[name]):
                way = _way_m(np.concatenate([_BEFORE_TACH, self.tach, tach]), out[name][:, 0])
                used = np.array([self._measured(name, row, way_m) for row, way_m in zip(out[name], way, strict=True)])
                report.lose("held", name, out[name][~used, 0])
                out[name] = out[name][used]
        if len(tach):
            self.tach = tach[-1:].copy()
        return out

    def _measured(self, name: str, row: Array, way_m: float) -> bool:
        """Return whether a row is a measurement of its own; ``way_m``: the tach's distance then."""
        t, values, run = float(row[0]), row[1:].copy(), self.runs.get(name)
        if run is None or t < run.kept_s or (np.abs(values - run.values) > _EQUAL).any():
            lasted_s = [] if run is None else run.lasted_s
            if run is not None and t > run.first_s and _moved(name, run, values, t):
                lasted_s = [*lasted_s, t - run.first_s][-NEWEST_RUNS:]
            self.runs[name] = _Run(values, t, t, t, way_m, lasted_s)
            return True
        step_s, run.newest_s = t - run.newest_s, t
        if t - run.kept_s < LONGER * run.interval_s and LONGER * step_s < run.interval_s:
            return False
        if name == "gnss" and abs(way_m - run.first_m) > IN_MOTION_MPS * (t - run.first_s):
            return False
        run.kept_s = t
        return True


def _way_m(tach: Array, t: Array) -> Array:
    """Return the newest distance of the tach's rows (m, 2) at times t (n,); NaN before the first."""
    return np.asarray(tach[np.searchsorted(tach[:, 0], t, side="right") - 1, 1])


def _moved(name: str, run: _Run, values: Array, t: float) -> bool:
    """Return whether the vehicle moved, by the receiver, during a run that ends with other values (k,) at t, s."""
    if name == GNSS_SPEED_TABLE:
        return bool(run.values[0] > 0.0)
    return bool(np.linalg.norm(values[:2] - run.values[:2]) > IN_MOTION_MPS * (t - run.first_s))
