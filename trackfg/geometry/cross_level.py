"""Cross-level: the height of one rail over the other, ``base * sin(track roll)``, and the conventions for its sign.

The base is the distance that cross-level refers to: 1.067 m or 1.5 m. ``sin`` and not ``tan``: the rails' distance is
measured along the sleeper. The response is ``base`` at every wavelength (small roll).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

Convention = Literal["left-high", "right-high", "inner-rail"]
"""What is positive: the left rail higher; the right rail higher; in curves the outer rail higher than designed."""
_PROPORTIONAL = ("cross_level_mm", "twist_mm")
"""Columns of a geometry that grow with the base."""


def cross_level(roll_rad: ArrayLike, base_m: float) -> Array:
    """Return cross-level, m, left rail higher is positive, of track rolls (left side up positive). Any shape."""
    return np.asarray(base_m * np.sin(np.asarray(roll_rad, dtype=np.float64)))


def on_base(geometry: pd.DataFrame, base_m: float, wanted_m: float) -> pd.DataFrame:
    """Return a geometry table whose cross-level and twist refer to ``base_m`` as they are on the base ``wanted_m``.

    Both, and their sigmas, are ``base`` times a function of the roll.
    """
    names = [name for name in geometry if str(name).removesuffix("_sd") in _PROPORTIONAL]
    if base_m == wanted_m or not names:
        return geometry
    return geometry.assign(**{str(name): wanted_m / base_m * geometry[name] for name in names})


def in_convention(
    cross_level_m: ArrayLike,
    convention: Convention,
    *,
    cant_m: ArrayLike | None = None,
    curvature_1pm: ArrayLike | None = None,
) -> Array:
    """Return a cross-level (left rail higher positive) in the sign of ``convention``.

    ``"inner-rail"`` is the Japanese rule: the inner rail is the reference, more than the design cant is positive; on
    straights the left rail is the reference, so that the right rail higher is positive. It needs the design's
    ``cant_m`` (left rail higher positive) and ``curvature_1pm`` (left positive, 0 on straights). The other two are not
    relative to a design. Raises ``BadInputError`` where the design is missing, or given to a convention that has none.
    """
    value = np.asarray(cross_level_m, dtype=np.float64)
    if convention == "inner-rail":
        if cant_m is None or curvature_1pm is None:
            raise BadInputError("cross-level by the inner rail: expected cant_m and curvature_1pm of the design")
        left_is_outer = np.asarray(curvature_1pm) < 0.0
        return np.asarray(np.where(left_is_outer, 1.0, -1.0) * (value - np.asarray(cant_m, dtype=np.float64)))
    if cant_m is not None or curvature_1pm is not None:
        raise BadInputError(f"cross-level, {convention} positive: expected neither cant_m nor curvature_1pm")
    if convention == "left-high":
        return value.copy()
    if convention == "right-high":
        return np.asarray(-value)
    raise BadInputError(f"convention is {convention!r}; expected left-high, right-high or inner-rail")
