"""A car body that is declared rigid leaves the direction in which it points, whether or not it leans in curves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.vehicle.suspension import Suspension
from trackfg.datasets.vehicle.vehicle import CarBody
from trackfg.smoothing.doubts.path_doubts import path_doubts
from trackfg.smoothing.smoother import SmoothedStates, smooth_states


def test_the_geometry_of_a_body_on_springs_that_is_declared_rigid_is_not_trusted(
    smoothed: Callable[..., SmoothedStates],
) -> None:
    """The body does not lean, so that its roll says nothing; the vehicle of the scenario itself is rigid."""
    plan = replace(scenario("mainline"), vehicle=CarBody(Suspension(roll_coefficient=0.0)))
    recording = simulate(plan, seed=1, duration_s=100.0).recording
    imu = recording.description.imu.model_copy(update={"rigid": True})
    description = recording.description.model_copy(update={"imu": imu})
    body = smooth_states(replace(recording, description=description), SmoothConfig())
    verdicts = {verdict.quantity: verdict for verdict in body.verdicts}
    for quantity in ("cross_level", "twist", "level", "alignment"):
        assert verdicts[quantity].status == "not_trusted"
        assert any("leaves the direction" in reason for reason in verdicts[quantity].reasons)
    assert not path_doubts(smoothed("mainline", seed=0, duration_s=200.0))
    assert not path_doubts(smooth_states(recording, SmoothConfig()))
