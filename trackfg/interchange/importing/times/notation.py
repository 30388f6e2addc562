"""How a source writes its times."""

from __future__ import annotations

from dataclasses import dataclass

UNIT_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of numeric times, s."""


@dataclass(frozen=True)
class TimeNotation:
    """How a source writes its times.

    ``unit`` is one of ``s, ms, us, ns`` for numbers, which are Unix times where they are as large as those; ``"gps"``
    for seconds since the GPS epoch, or ticks of ``tick_s`` since then; ``"days"`` for those of spreadsheets, of MATLAB
    or Julian dates; ``"hhmmss"`` for a time of day in one number, as receivers write it; ``"ticks"`` for a counter of
    ``tick_s`` that starts again at ``wraps_at``, or for dates as large as those of Windows and .NET.
    ``format`` is a ``strptime`` format for text, or None to find it out. ``zone`` is where times without one were
    written.
    """

    unit: str | None = None
    format: str | None = None
    zone: str = "UTC"
    tick_s: float | None = None
    wraps_at: float | None = None
