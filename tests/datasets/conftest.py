"""Lines, rides and data folders that the tests of trackfg.datasets share."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trackfg.datasets.line.irregularities import SHORTEST_M, IrregularityModel, spectra
from trackfg.datasets.line.line import Line, piecewise_linear
from trackfg.datasets.line.wavelength_band import d1_gain
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.vehicle.driving import Wandering
from trackfg.datasets.vehicle.motion import Limits
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array

BASE_M = 1.067


def at_50_hz(plan: Scenario) -> Scenario:
    """The scenario with fewer samples of the IMU, for tests that look at none."""
    return replace(plan, imu=replace(plan.imu, rate_hz=50.0))


@pytest.fixture(scope="session")
def d1_standard_deviations() -> Callable[[IrregularityModel], Array]:
    """The standard deviations in the band D1 that a model's spectra have, m. Shape (4,)."""

    def of(model: IrregularityModel) -> Array:
        w = np.geomspace(2 * np.pi / model.longest_m, 2 * np.pi / SHORTEST_M, 4001)
        density = spectra(model, w) * (d1_gain(w) ** 2 * w)[:, None]
        return np.asarray(np.sqrt(np.trapezoid(density, np.log(w), axis=0)))

    return of


def _line(
    s: list[float],
    curvature: list[float],
    *,
    cant: list[float] | None = None,
    grade: list[float] | None = None,
    stations: list[float] | None = None,
) -> Line:
    places = np.array(s, dtype=float)
    flat = np.zeros(len(s))
    return Line(
        curvature=piecewise_linear(places, np.array(curvature, dtype=float)),
        cant=piecewise_linear(places, flat if cant is None else np.array(cant, dtype=float)),
        grade=piecewise_linear(places, flat if grade is None else np.array(grade, dtype=float)),
        length_m=float(s[-1]),
        cross_level_base_m=BASE_M,
        limit_from_m=np.zeros(1),
        limit_mps=np.array([30.0]),
        stations_m=np.array(stations or [], dtype=float),
    )


@pytest.fixture
def make_line() -> Callable[..., Line]:
    """Makes a line through given curvatures, cants and gradient angles at given places."""
    return _line


@pytest.fixture
def winding_ride() -> Ride:
    """120 s through curves both ways, with cant, on changing gradients, at changing speed, never at rest."""
    winding = _line(
        s=[0, 100, 160, 300, 360, 500, 560, 700, 760, 9000],
        curvature=[0, 0, 1 / 300, 1 / 300, 0, 0, -1 / 400, -1 / 400, 0, 0],
        cant=[0, 0, -0.1, -0.1, 0, 0, 0.08, 0.08, 0, 0],
        grade=[0.01, 0.01, 0.02, 0.02, -0.015, -0.015, 0.01, 0.01, 0, 0],
    )
    driver = Wandering(limits=Limits(0.7, 0.5), speed_mps=(8.0, 20.0), hold_s=(5.0, 10.0))
    return Ride(winding, driver.drive(winding, 120.0, np.random.default_rng(3)))


def _allan_deviation(x: Array, samples: int) -> Array:
    blocks = x[: len(x) // samples * samples].reshape(-1, samples, x.shape[1]).mean(axis=1)
    return np.asarray(np.sqrt(0.5 * np.mean(np.diff(blocks, axis=0) ** 2, axis=0)))


@pytest.fixture
def allan_deviation() -> Callable[[Array, int], Array]:
    """The Allan deviation of each column at an averaging time of so many samples. Shape (n, c) to (c,)."""
    return _allan_deviation


@pytest.fixture
def data_folder() -> Callable[[str], Path]:
    """The folder of a public recording; skips the test where it is absent."""

    def find(name: str) -> Path:
        default = Path(__file__).parents[3] / "shared" / "data"
        folder = Path(os.environ.get("TRACKFG_DATA", default)) / name
        if not folder.is_dir():
            pytest.skip(f"{folder} is absent")
        return folder

    return find
