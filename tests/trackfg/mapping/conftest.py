"""Runs there and back over three kilometres, each with its own speed and sensor errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from trackfg.datasets.positioning import BaliseModel, GnssModel
from trackfg.datasets.scenarios import Scenario, Simulation, scenario, simulate
from trackfg.frames import Array
from trackfg.mapping import build_map
from trackfg.maps.feature_map import FeatureMap
from trackfg.results import Result
from trackfg.smoother import smooth

LENGTH_M = 3000.0


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


def short_line(**changes: object) -> Scenario:
    """``shuttle``, cut to three kilometres."""
    balises = BaliseModel(spacing_m=1000.0, sd_m=0.1, places_m=(100.0, LENGTH_M - 100.0))
    plan = replace(scenario("shuttle"), length_m=LENGTH_M, duration_s=420.0, balises=balises)
    return replace(plan, **changes)  # type: ignore[arg-type]


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
