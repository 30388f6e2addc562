"""A stream doubts what rests on a clock that is off by more than it allows for.

What it has marginalised it cannot build again on moved stamps, as the batch does
(:mod:`trackfg.smoothing.late_clocks`): factors stay linear in an offset that was taken for one within the declared
sigma.
"""

from __future__ import annotations

from trackfg.config import SmoothConfig
from trackfg.numerics.arrays import Array
from trackfg.results.events import DOUBT, Event
from trackfg.smoothing.late_clocks import in_words

_FAR_SIGMAS = 4.0
"""Declared sigmas beyond which an offset is doubted, as priors of the batch are: GNSS that is 1 s late (3.3) has errors
of 1.3 sigmas at a lag of 20 s, 2 s late (6.7) of 2.5 (`late-gnss`, one run of 240 s)."""


def clock_doubts(clock: Array, config: SmoothConfig, until_s: float) -> tuple[Event, ...]:
    """Return an event for each clock whose offset in the state ``clock`` (3,), s, is far from the declared one."""
    offsets = (
        ("tach", float(clock[0]), config.tach.clock_offset_sd_s),
        ("gnss", float(clock[2]), config.position.gnss_clock_offset_sd_s),
    )
    return tuple(_doubt(table, offset, until_s) for table, offset, sd in offsets if abs(offset) > _FAR_SIGMAS * sd)


def _doubt(table: str, offset_s: float, until_s: float) -> Event:
    advice = f"add {offset_s:.2f} to {table}.time_offset_s, or smooth the recording"
    return Event(DOUBT, t_s=until_s, detail=f"chainage, position, speed: {in_words(table, offset_s)}: {advice}")
