"""Runs of a vehicle on springs, for tests of what its motion does to the track geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.vehicle.suspension import Suspension
from trackfg.datasets.vehicle.vehicle import CarBody
from trackfg.recording.model import Recording


@pytest.fixture(scope="session")
def on_springs() -> Callable[..., tuple[Recording, Recording]]:
    """A run of a body on springs that leans by a share of the cant deficiency: as declared, and declared rigid.

    The vehicle of the scenario itself is rigid.
    """

    def run(share: float, seed: int, duration_s: float) -> tuple[Recording, Recording]:
        plan = replace(scenario("mainline"), vehicle=CarBody(Suspension(roll_coefficient=share)))
        recording = simulate(plan, seed=seed, duration_s=duration_s).recording
        imu = recording.description.imu.model_copy(update={"rigid": True})
        return recording, replace(recording, description=recording.description.model_copy(update={"imu": imu}))

    return run
