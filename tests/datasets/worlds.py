"""Lines and rides that the tests of the simulated world share."""

from __future__ import annotations

import numpy as np

from trackfg.datasets.driving import Wandering
from trackfg.datasets.line import Line, piecewise_linear
from trackfg.datasets.motion import Limits
from trackfg.datasets.ride import Ride
from trackfg.frames import Array

BASE_M = 1.067


def line(
    s: list[float], curvature: list[float], *, cant: list[float] | None = None, grade: list[float] | None = None
) -> Line:
    """A line through given curvatures, cants and gradient angles at the places ``s``."""
    places = np.array(s)
    flat = np.zeros(len(s))
    return Line(
        curvature=piecewise_linear(places, np.array(curvature)),
        cant=piecewise_linear(places, flat if cant is None else np.array(cant)),
        grade=piecewise_linear(places, flat if grade is None else np.array(grade)),
        length_m=s[-1],
        cross_level_base_m=BASE_M,
        limit_from_m=np.zeros(1),
        limit_mps=np.array([30.0]),
        stations_m=np.array([]),
    )


def winding_ride(duration_s: float) -> Ride:
    """A ride through curves both ways, with cant, on changing gradients, at changing speed, never at rest."""
    winding = line(
        s=[0, 100, 160, 300, 360, 500, 560, 700, 760, 9000],
        curvature=[0, 0, 1 / 300, 1 / 300, 0, 0, -1 / 400, -1 / 400, 0, 0],
        cant=[0, 0, -0.1, -0.1, 0, 0, 0.08, 0.08, 0, 0],
        grade=[0.01, 0.01, 0.02, 0.02, -0.015, -0.015, 0.01, 0.01, 0, 0],
    )
    driver = Wandering(limits=Limits(0.7, 0.5), speed_mps=(8.0, 20.0), hold_s=(5.0, 10.0))
    return Ride(winding, driver.drive(winding, duration_s, np.random.default_rng(3)))


def allan_deviation(x: Array, samples: int) -> Array:
    """The Allan deviation of each column at an averaging time of ``samples`` samples. Shape (n, c) to (c,)."""
    blocks = x[: len(x) // samples * samples].reshape(-1, samples, x.shape[1]).mean(axis=1)
    return np.sqrt(0.5 * np.mean(np.diff(blocks, axis=0) ** 2, axis=0))
