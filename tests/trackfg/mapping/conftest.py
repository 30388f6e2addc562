"""Simulated runs there and back over two kilometres; and a made-up line, with runs over it that need no simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve

from trackfg.datasets.scenarios import Scenario, Simulation, scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel, GnssModel
from trackfg.mapping import build_map
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

LENGTH_M = 2000.0


@dataclass(frozen=True)
class Run:
    """A run as simulated and as smoothed."""

    simulation: Simulation
    result: Result

    def true_place(self, chainage: Array) -> Array:
        """Where the vehicle was when the result says ``chainage``."""
        t, said = (self.result.trajectory[name].to_numpy() for name in ("t_s", "chainage_m"))
        order = np.argsort(said, kind="stable")
        return np.asarray(np.interp(chainage, said[order], self.true_chainage(t)[order]))

    def errors(self, result: Result) -> Array:
        """Of the chainage in another result of the same run."""
        return result.trajectory["chainage_m"].to_numpy() - self.true_chainage(result.trajectory["t_s"].to_numpy())

    def true_chainage(self, t: Array) -> Array:
        """The vehicle's at times ``t``."""
        return np.asarray(np.interp(t, self.simulation.truth["t_s"], self.simulation.truth["chainage_m"]))


def short_line(**changes: Any) -> Scenario:
    """``shuttle``, cut to two kilometres."""
    balises = BaliseModel(spacing_m=1000.0, sd_m=0.1, places_m=(100.0, LENGTH_M - 100.0))
    plan = replace(scenario("shuttle"), length_m=LENGTH_M, duration_s=240.0, balises=balises)
    return replace(plan, **changes)


@pytest.fixture(scope="session")
def ride() -> Callable[..., Run]:
    """``ride(run, seed=3, gnss=False)``."""

    @cache
    def make(run: int, seed: int = 3, gnss: bool = False) -> Run:
        receiver = GnssModel(sd_m=(0.5, 0.5, 1.0), antenna_m=(2.0, 0.0, 3.0))
        plan = short_line(gnss=receiver, latitude_deg=35.2) if gnss else short_line()
        simulation = simulate(plan, seed=seed, run=run)
        return Run(simulation, smooth(simulation.recording))

    return make


@pytest.fixture(scope="session")
def line_map(ride: Callable[..., Run]) -> FeatureMap:
    """Of four runs, two each way."""
    return build_map([ride(run).result for run in range(4)], name="short line")


STEP_M = 0.25
SIZE = {"curvature_1pm": 1.2e-4, "cross_level_mm": 2.0, "versine_level_mm": 1.8}
NOISE = {"curvature_1pm": 3e-6, "cross_level_mm": 0.05, "versine_level_mm": 0.08}
TRANSITION_M = 60.0


@dataclass(frozen=True)
class Curve:
    """From the begin of one transition to the end of the other; ``curvature_1pm`` of the circle."""

    begin_m: float
    end_m: float
    curvature_1pm: float


def smooth_noise(rng: np.random.Generator, count: int, length_m: float) -> Array:
    """Of unit variance, with waves of some ``length_m`` and more, none much longer."""
    x = np.arange(-4.0 * length_m, 4.0 * length_m + STEP_M, STEP_M) / length_m
    kernel = (1.0 - 4.0 * x**2) * np.exp(-2.0 * x**2)
    values = fftconvolve(rng.standard_normal(count + len(x) - 1), kernel, mode="valid")
    return np.asarray(values / np.sqrt((kernel**2).sum()))


@dataclass(frozen=True)
class Line:
    """Features at any place between 0 and its length."""

    features: dict[str, CubicSpline]
    length_m: float

    @classmethod
    def drawn(
        cls,
        length_m: float,
        curves: Sequence[Curve],
        *,
        seed: int,
        rough: float = 1.0,
        changed: tuple[float, float] = (0.0, 0.0),
    ) -> Line:
        """``rough``: size of the irregularities, those of ``changed`` (from, to, m) drawn anew."""
        s = np.arange(round(length_m / STEP_M) + 1) * STEP_M
        curvature = np.zeros(len(s))
        for curve in curves:
            ramp = np.minimum(s - curve.begin_m, curve.end_m - s) / TRANSITION_M
            curvature += curve.curvature_1pm * np.clip(ramp, 0.0, 1.0)
        design = {"curvature_1pm": curvature, "cross_level_mm": 4e4 * curvature, "versine_level_mm": 0.0 * s}
        anew = (s >= changed[0]) & (s < changed[1])
        features = {}
        for number, (name, size) in enumerate(SIZE.items()):
            old, new = (smooth_noise(np.random.default_rng([seed, number, k]), len(s), 6.0) for k in (0, 1))
            features[name] = CubicSpline(s, design[name] + rough * size * np.where(anew, new, old))
        return cls(features, length_m)

    def run(
        self,
        low_m: float,
        high_m: float,
        *,
        place: Callable[[Array], Array] = lambda chainage: chainage,
        noise: float = 1.0,
        seed: int = 0,
        roll_mm: float = 0.0,
        with_sd: bool = True,
    ) -> pd.DataFrame:
        """What a run measures at chainages from ``low_m`` to ``high_m``; it is at ``place`` of the chainage."""
        chainage = np.arange(round(low_m / STEP_M), round(high_m / STEP_M)) * STEP_M
        rng = np.random.default_rng(seed)
        columns = {"chainage_m": chainage}
        for name, spline in self.features.items():
            error = noise * NOISE[name] * smooth_noise(rng, len(chainage), 5.0)
            columns[name] = spline(place(chainage)) + error + (roll_mm if name == "cross_level_mm" else 0.0)
            if with_sd:
                columns[f"{name}_sd"] = np.full(len(chainage), noise * NOISE[name])
        return pd.DataFrame(columns)


def usual_curves(length_m: float, seed: int) -> list[Curve]:
    """One every 700 m or so, of 300 to 1000 m radius to either side."""
    rng = np.random.default_rng(seed)
    curves, at = [], 150.0
    while True:
        at += rng.uniform(150.0, 500.0)
        end = at + 2.0 * TRANSITION_M + rng.uniform(50.0, 300.0)
        if end > length_m - 50.0:
            return curves
        curves.append(Curve(at, end, float(rng.choice([-1.0, 1.0]) / rng.uniform(300.0, 1000.0))))
        at = end


@pytest.fixture(scope="session")
def draw_line() -> Callable[..., Line]:
    """``draw_line(length_m, seed=..., curves=None)``: curves (begin, end, curvature), or the usual ones."""

    def draw(
        length_m: float, *, seed: int, curves: Sequence[tuple[float, float, float]] | None = None, **options: Any
    ) -> Line:
        plan = usual_curves(length_m, seed) if curves is None else [Curve(*curve) for curve in curves]
        return Line.drawn(length_m, plan, seed=seed, **options)

    return draw


@pytest.fixture(scope="session")
def line(draw_line: Callable[..., Line]) -> Line:
    """6 km with curves, well kept."""
    return draw_line(6000.0, seed=1)


@pytest.fixture(scope="session")
def reference(line: Line) -> pd.DataFrame:
    return line.run(0.0, 6000.0, seed=100)
