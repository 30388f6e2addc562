"""Row checks: sigmas that a place can have, and steps of the tach that a wheel can make.

A counter that starts again, or loses its place, makes one impossible step and is sound afterwards. Rows after such a
step are refused until ``RESET_ROWS`` in succession agree. Later counts are then added to the last value before the
step: what was rolled during the step is not counted, and the event ``tach-reset`` gives its time.

A counter of 16, 24 or 32 bits begins again at the end of its range, and the import continues the count there. Here the
count is continued where the step, with the range added, is one that a wheel can make and a small part of the range.
After an outage the two causes cannot be distinguished, and the count is not continued.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackfg.checks.columns import SMALLEST_SIGMA
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording.canonical import pulse_m
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.streaming.events import LossReport

RESET_ROWS = 10
"""A counter is taken to have restarted after this many rows in succession that agree."""
COARSEST_STEP_M = 10.0
"""No tach counts in coarser steps, m: so much more than the fastest speed gives may lie between two rows."""

_RANGES = (2.0**16, 2.0**24, 2.0**32)
"""Ranges of counters, in pulses."""
_PART = 0.1
"""The most that a wheel may have rolled in a step of a count that goes over its end, in ranges: one in ten counts that
start again at any place is mistaken for it at the most."""

_SIGMAS = {"fixes": slice(2, 3), "gnss": slice(4, 7), "gnss_speed": slice(2, 3)}


@dataclass
class RowChecks:
    """Passes sound rows on and reports the others. ``last``: the last sound row of the tach, time and distance;
    ``offset_m``: what is added to its distances; ``refused``: rows since an impossible step. ``pulse_m``: the distance
    of a pulse, 0 where the tach counts none.
    """

    signed: bool
    fastest_mps: float
    pulse_m: float = 0.0
    last: tuple[float, float] | None = None
    offset_m: float = 0.0
    refused: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def of(cls, description: RecordingDescription, limits: CheckLimits) -> RowChecks:
        """Return the checks before the first row."""
        tach = description.tach
        if tach is None:
            return cls(signed=False, fastest_mps=limits.speed_error_mps)
        return cls(tach.signed, limits.speed_error_mps, pulse_m(tach) if tach.kind == "pulses" else 0.0)

    def sound(self, tables: Mapping[str, Array], report: LossReport) -> dict[str, Array]:
        """Return the rows that can be used. Distances of the tach are free of its resets."""
        out = dict(tables)
        for name, sigmas in _SIGMAS.items():
            if name in out:
                wrong = (out[name][:, sigmas] < SMALLEST_SIGMA).any(axis=1)
                report.lose("bad-sigma", name, out[name][wrong, 0])
                out[name] = out[name][~wrong]
        if "tach" in out and out["tach"].shape[0]:
            out["tach"] = self._tach(out["tach"], report)
        return out

    def _tach(self, rows: Array, report: LossReport) -> Array:
        placed = rows + np.array([0.0, self.offset_m]) if self.offset_m else rows
        chain = placed if self.last is None else np.concatenate([[self.last], placed])
        if not self.refused and self._possible(*np.diff(chain, axis=0).T).all():
            self.last = (float(placed[-1, 0]), float(placed[-1, 1]))
            return placed
        kept, lost = [], []
        for t, counted in rows.tolist():
            if self.last is None or self._follows(self.last, (t, counted + self.offset_m)):
                self.refused = []
            elif not self._goes_over(t, counted) and not self._restarts(t, counted, report):
                lost.append(t)
                continue
            self.last = (t, counted + self.offset_m)
            kept.append(self.last)
        report.lose("tach-jump", "tach", np.array(lost))
        return np.array(kept).reshape(-1, 2)

    def _goes_over(self, t: float, counted: float) -> bool:
        """Return whether the count has passed the end of its range; its offset is then that of the next range."""
        if self.last is None or self.pulse_m == 0.0 or self.refused:
            return False
        previous = self.last[1] - self.offset_m
        limit = self.fastest_mps * (t - self.last[0]) + self.pulse_m
        for pulses in _RANGES:
            reach = pulses * self.pulse_m
            beyond = float(np.copysign(reach, previous - counted))
            step = counted + beyond - previous
            is_within = max(abs(previous), abs(counted)) < reach and limit < _PART * reach
            if is_within and abs(step) <= limit and (self.signed or step >= 0.0):
                self.offset_m += beyond
                return True
        return False

    def _restarts(self, t: float, counted: float, report: LossReport) -> bool:
        """Return whether this row completes a succession of rows that agree; the restarted count is then used."""
        if self.refused and not self._follows(self.refused[-1], (t, counted)):
            self.refused = []
        if self.last is None or len(self.refused) < RESET_ROWS:
            self.refused.append((t, counted))
            return False
        self.offset_m = self.last[1] - self.refused[0][1]
        detail = f"the count goes on from where it stood; up to {self.refused[0][0]:.3f} s nothing was counted"
        report.note(Event("tach-reset", "tach", self.last[0], t, 0, detail))
        self.refused = []
        return True

    def _follows(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        return bool(self._possible(np.float64(b[0] - a[0]), np.float64(b[1] - a[1])))

    def _possible(self, seconds: Array | np.float64, metres: Array | np.float64) -> NDArray[np.bool_] | np.bool_:
        limit = self.fastest_mps * seconds + COARSEST_STEP_M
        return np.abs(metres) <= limit if self.signed else (metres >= 0.0) & (metres <= limit)
