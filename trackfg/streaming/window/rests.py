"""Rests are the standstills of the newest keyframes, detected while the vehicle still stands."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.config import MotionConfig
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import Span, subtract, union
from trackfg.sensors.standstills import find_standstills
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.tach_buffer import TachBuffer
from trackfg.streaming.window.window import Window

LOOK_S = 8.0
"""How long before the newest keyframes a rest is looked for, s."""
_MARGIN_S = 1.5
"""Time that a gentle start takes to show, s; as :mod:`trackfg.sensors.standstills` has it."""
_STOPPING_S = 4.0
"""Time before a silence, s, in which the accelerometer shows whether the vehicle stopped: more than the 3.5 s that
:mod:`trackfg.sensors.standstills` looks at."""
_TURNING_MPS = 0.5
"""Wheel speed above which no rest is looked for, m/s: an unsigned speed signal may show that much noise at rest."""
_MOVING_MPS = 2.0
"""A keyframe faster than this, m/s, lies in no rest: a stuck tach on a smooth straight looks like one."""


@dataclass
class Rests:
    """The latest rests, ``spans`` (r, 2), s. They are dropped once they end ``2 lag_s + LOOK_S`` before the span in
    which rests are looked for.
    """

    lag_s: float
    spans: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def update(
        self,
        buffer: SampleBuffer,
        tach: TachBuffer | None,
        window: Window,
        config: MotionConfig,
        span: Span,
    ) -> None:
        """Look for rests in a ``span`` of time, s, with the window's speeds; without a tach by GNSS alone.

        A silence of the tach that began shortly before the span is looked at as a whole: a vehicle that creeps on more
        slowly than a count shows has another force than it had at rest. A vehicle that has stood for longer may tilt
        a little as people board it, and is at rest all the same.
        """
        begin, until = span
        if tach is not None:
            if _wheel_turns(buffer.tach, tach.wheel.quantum, config.min_rest_s, span):
                return
            stopped = _silent_since(buffer.tach, tach.wheel.quantum, begin)
            begin = stopped - _STOPPING_S if begin - LOOK_S < stopped < begin else begin
        recording = buffer.recording(begin, until)
        if recording.imu.empty:  # within a long gap
            return
        if tach is None:
            recording = replace(recording, tach=None)
        silent = tach is not None and tach.silent_at_rest
        rests = find_standstills(recording, config.min_rest_s, silent_at_rest=silent)
        if tach is not None:
            t = buffer.tach[slice(*np.searchsorted(buffer.tach[:, 0], [begin, until])), 0]
            if not silent:  # else no rows are as good as rows that do not change
                if not len(t):
                    return
                begin, until = float(t[0]), float(t[-1])
            elif len(t) and t[-1] > until - _MARGIN_S:
                until = float(t[-1])
        # Rows outside the span could still show that the vehicle moves.
        rests = np.clip(rests, begin + _MARGIN_S, until - _MARGIN_S)
        fast = window.t[np.linalg.norm(window.states.nav.v, axis=1) > _MOVING_MPS]
        moving = np.searchsorted(fast, rests[:, 0]) < np.searchsorted(fast, rests[:, 1])
        spans = np.concatenate([self.spans, rests[(rests[:, 1] > rests[:, 0]) & ~moving]])
        recent = union(spans[spans[:, 1] > begin - 2.0 * self.lag_s - LOOK_S])
        self.spans = subtract(recent, buffer.breaks["imu"])


def _silent_since(rows: Array, quantum: float, t: float) -> float:
    """Return since when the tach, of rows (n, 2), has been silent at ``t``, s: ``t`` where it moves then."""
    earlier = rows[: np.searchsorted(rows[:, 0], t)]
    if not len(earlier):
        return t
    moved = np.flatnonzero(np.abs(earlier[:, 1] - earlier[-1, 1]) > 1.5 * quantum)
    return float(earlier[moved[-1] if moved.size else 0, 0])


def _wheel_turns(rows: Array, quantum: float, duration_s: float, span: Span) -> bool:
    """Return whether a tach's rows (n, 2) cover the span and clearly move in every stretch as long as the shortest
    rest.
    """
    begin, until = span
    if not (len(rows) and rows[0, 0] <= begin and rows[-1, 0] >= until):
        return False
    t = np.arange(begin, until - duration_s, 0.5 * duration_s)
    rolled = np.interp(t + duration_s, *rows.T) - np.interp(t, *rows.T)
    return bool((np.abs(rolled) > np.maximum(1.5 * quantum, _TURNING_MPS * duration_s)).all())
