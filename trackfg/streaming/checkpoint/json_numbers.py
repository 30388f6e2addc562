"""Numbers that may be infinite, in a state that is kept as JSON, which has no infinity: null stands for it."""

from __future__ import annotations

import math


def finite_or_none(value: float) -> float | None:
    """What is written."""
    return float(value) if math.isfinite(value) else None


def finite_or(infinite: float, written: float | None) -> float:
    """What it was, where it can have been infinite with one sign only."""
    return infinite if written is None else written
