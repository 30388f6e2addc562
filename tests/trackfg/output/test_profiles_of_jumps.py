"""Passes that a jump of a clock or a tachometer makes of two places far apart."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from trackfg.numerics.chainage.passes import Pass
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.profiles import Ascent


@pytest.mark.parametrize(
    ("places", "holds"),
    [
        (np.linspace(0.0, 20.0, 100), True),
        (np.linspace(0.0, 5.0, 100), False),  # shorter than a chord
        (np.repeat([0.0, 1e9], 50), False),
        (np.repeat([0.0, 10.0, 1e300], 50), False),
        (np.array([0.0, 5.0, 10.0, 15.0]), True),
        (np.array([]), False),  # between two keyframes that a clock has put at one time
    ],
)
def test_a_profile_needs_rows_in_enough_cells(places: np.ndarray, *, holds: bool) -> None:
    nothing = cast("DenseMotion", None), cast("Pass", None)
    assert Ascent(*nothing, x=places, rows=slice(0), backwards=False).holds_profile(0.25) == holds
