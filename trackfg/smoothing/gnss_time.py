"""The stamps of GNSS are set before there is a graph where they are off by more than its variable covers.

The graph estimates a receiver's offset through ``v (t + T)``, which is linear in T: right for some tenths of a second.
A receiver on a serial line is late by up to 2 s, so its stamps are moved by what the shape of the path tells
(:mod:`trackfg.sensors.gnss_clock`), and only what remains is left to the graph.
"""

from __future__ import annotations

from dataclasses import replace

from trackfg.checks.diagnosis_clock import estimate_clock_offset
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.sensors.gnss_clock import gnss_clock

_LEAST_S = 0.15
"""Smaller offsets are left to the graph, s: what is not linear in them makes 1 cm at 1 m/s^2."""

_SIGMAS = 4.0
"""Offsets of so many of their own sigmas are certain."""

_TACH_SIGMAS = 2.0
"""The tach's clock is set, for the path alone, where it is off by so many sigmas."""


def with_gnss_in_time(recording: Recording) -> Recording:
    """Return the recording with the stamps of GNSS on the IMU's clock, and a finding where that moved them."""
    if recording.gnss is None:
        return recording
    offset = gnss_clock(_with_tach_set(recording))
    if offset is None or abs(offset.offset_s) < max(_LEAST_S, _SIGMAS * offset.sd_s):
        return recording
    way = "late" if offset.offset_s < 0 else "early"
    finding = Finding(
        "warning",
        "gnss-clock",
        f"GNSS positions are stamped {abs(offset.offset_s):.2f} s {way} (sigma {offset.sd_s:.2f} s); they were moved",
        hint=f"add {offset.offset_s:.2f} to gnss.time_offset_s",
    )
    gnss = recording.gnss.assign(t_s=recording.gnss["t_s"] + offset.offset_s)
    return replace(recording, gnss=gnss, findings=(*recording.findings, finding))


def _with_tach_set(recording: Recording) -> Recording:
    """Return the recording with its tach on the IMU's clock, as far as accelerations tell."""
    offset = estimate_clock_offset(recording)
    if recording.tach is None or offset is None or abs(offset.offset_s) < _TACH_SIGMAS * offset.sd_s:
        return recording
    return replace(recording, tach=recording.tach.assign(t_s=recording.tach["t_s"] + offset.offset_s))
