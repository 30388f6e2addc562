"""Numbers as a page shows them."""

from __future__ import annotations

import math

NONE = "–"
"""Where there is no number."""


def digits(value: float | None, significant: int = 3) -> str:
    """Format significant digits without trailing dots or exponents of ordinary sizes: ``0.0123``, ``12.3``,
    ``1230``.
    """
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size >= 7:
        return f"{value:.{significant - 1}e}"
    return f"{value:.{max(significant - 1 - size, 0)}f}"


def with_unit(value: float | None, unit: str, significant: int = 3) -> str:
    """Format a number as :func:`digits` does, with its unit."""
    text = digits(value, significant)
    return text if text == NONE or not unit else f"{text} {unit}"


def with_sd(value: float, sd: float | None, unit: str) -> str:
    """Format value and 1-sigma to two digits of the sigma; the value alone where there is no sigma above 0, and
    :data:`NONE` where there is no value.
    """
    if not math.isfinite(value):
        return NONE
    if not (sd is not None and math.isfinite(sd) and sd > 0.0):
        return with_unit(value, unit, 6)
    places = decimals(sd)
    return f"{fixed(value, places)} ± {sd:.{places}f} {unit}".rstrip()


def fixed(value: float, places: int) -> str:
    """Format a number with so many decimals, 0 without a sign."""
    return f"{round(value, places) + 0.0:.{places}f}"


def decimals(sd: float) -> int:
    """Return how many decimals show two digits of a sigma."""
    return max(1 - math.floor(math.log10(sd)), 0) if sd > 0.0 and math.isfinite(sd) else 0


def percent(share: float | None, places: int = 1) -> str:
    """Format a share of 1 in percent."""
    return NONE if share is None or not math.isfinite(share) else f"{100.0 * share:.{places}f} %"


def interval(bounds: tuple[float, float] | None) -> str:
    """Format an interval."""
    return NONE if bounds is None else f"{digits(bounds[0])} – {digits(bounds[1])}"


def duration(seconds: float) -> str:
    """Format hours, minutes and seconds as far as they are needed."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s"


def length(metres: float | None) -> str:
    """Format a length, in m below a kilometre."""
    if metres is None:
        return "not determined"
    return f"{metres:.1f} m" if abs(metres) < 1000.0 else f"{metres / 1000.0:.3f} km"
