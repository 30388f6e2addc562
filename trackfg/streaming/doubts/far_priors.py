"""A stream doubts what rests on a prior that its data contradict.

The batch widens such a prior and solves again (:mod:`trackfg.smoothing.rectification`), or builds its graph on moved
stamps (:mod:`trackfg.smoothing.clocks.late_clocks`). A stream can do neither with what it has marginalised: factors
stay linear in an offset that was taken for one within the declared sigma, and the errors that a narrow prior leaves
stay in the biases.
"""

from __future__ import annotations

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.bias import RECTIFICATION
from trackfg.factors.states import States
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.clocks import late_clocks
from trackfg.smoothing.doubts import clock_doubts
from trackfg.smoothing.rectification import grown_bias
from trackfg.smoothing.wide_priors import far_point

_FAR_SIGMAS = 4.0
"""Declared sigmas beyond which a value is doubted, as priors of the batch are: GNSS that is 1 s late (3.3) has errors
of 1.3 sigmas at a lag of 20 s, 2 s late (6.7) of 2.5 (`late-gnss`, one run of 240 s). With an accelerometer that
rectifies 0.001 m/s^2 per (m/s^2)^2 (2.0) pitch errs by one sigma, with 0.0065 (13) by 3.6 (`rectification`, GNSS)."""


def prior_doubts(states: States, config: SmoothConfig, rectification_sd: float, until_s: float) -> tuple[Event, ...]:
    """Return an event for each prior that is far from the newest ``states``, known at ``until_s``.

    ``rectification_sd``: what is declared of the accelerometer, m/s^2 per (m/s^2)^2.
    """
    rectification = _rectification_doubts(states.imu[0, RECTIFICATION], rectification_sd, until_s)
    return (*_clock_doubts(states.clock[0], config, until_s), *rectification)


def _clock_doubts(clock: Array, config: SmoothConfig, until_s: float) -> tuple[Event, ...]:
    offsets = (
        ("tach", float(clock[0]), config.tach.clock_offset_sd_s),
        ("gnss", float(clock[2]), config.position.gnss_clock_offset_sd_s),
    )
    late = tuple(_late(table, offset, until_s) for table, offset, sd in offsets if abs(offset) > _FAR_SIGMAS * sd)
    drift = float(clock[1])
    if not clock_doubts.is_far(drift, config.tach.clock_drift_sd, 0.0):
        return late
    advice = "stamp both sensors by one clock"
    return (*late, doubt_event(clock_doubts.BY_CLOCK, clock_doubts.in_words(drift), advice, t_s=until_s))


def _late(table: str, offset_s: float, until_s: float) -> Event:
    advice = f"add {offset_s:.2f} to {table}.time_offset_s, or smooth the recording"
    reason = late_clocks.in_words(table, offset_s)
    return doubt_event(("chainage", "position", "speed"), reason, advice, t_s=until_s)


def _rectification_doubts(coefficients: Array, sd: float, until_s: float) -> tuple[Event, ...]:
    if float(np.abs(coefficients).max()) <= _FAR_SIGMAS * sd:
        return ()
    advice = "declare rectification_sd of [imu.noise] as large, or smooth the recording"
    quantities = ("roll", "pitch", "cross_level", "gradient")
    return (doubt_event(quantities, grown_bias(coefficients), advice, t_s=until_s),)


def mounting_doubts(mount: Array, sd: Array, until_s: float) -> tuple[Event, ...]:
    """Return an event where a ``mount`` (5,) has the point that follows the track far from where it was known to be, to
    ``sd`` (3,), m: rows before that was found have it elsewhere.
    """
    return tuple(
        doubt_event(doubt.quantities, doubt.reason, f"{doubt.hint}, or smooth the recording", t_s=until_s)
        for doubt in far_point(mount, sd)
    )
