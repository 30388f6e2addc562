"""States to work a factor's residual out by hand from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.factors.states import Kind, Nav, Odo, States


@pytest.fixture(scope="session")
def at_origin() -> Callable[[int], States]:
    """So many keyframes at the origin, level, facing along e1, at rest; a wheel of scale 1; all else zero."""

    def states(keyframes: int) -> States:
        nav = Nav(np.tile(np.eye(3), (keyframes, 1, 1)), *np.zeros((2, keyframes, 3)))
        odo = Odo(np.tile([0.0, 1.0, 0.0, 0.0], (keyframes, 1)))
        shared = (np.zeros((1, kind.dim)) for kind in (Kind.MOUNT, Kind.CLOCK, Kind.IMU, Kind.WHEEL))
        return States(nav, np.zeros((keyframes, Kind.BIAS.dim)), odo, *shared)

    return states
