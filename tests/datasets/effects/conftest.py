"""One train, with and without an effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pytest

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenario import Effect
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.driving import Service

Run = Callable[..., Simulation]


@cache
def _run(*effects: Effect, duration_s: float = 100.0) -> Simulation:
    plan = scenario("mainline-gnss")
    driver = plan.driver
    assert isinstance(driver, Service)
    plan = replace(
        plan,
        balises=BaliseModel(spacing_m=50.0, sd_m=0.1),
        driver=replace(driver, restrictions=None),
        effects=effects,
    )
    return simulate(plan, seed=2, duration_s=duration_s)


@pytest.fixture(scope="session")
def run() -> Run:
    """Return the run of a train with GNSS and balises at 200 Hz, with these effects; 100 s, or so long as asked."""
    return _run
