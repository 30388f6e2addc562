"""The runs that faults are put into: a minute each of five vehicles, in the three forms that rows come in."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from streaming.arrivals import Form, stream_of
from streaming.fault_injection import BaseCase
from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.driving import Service, Shunting, Wandering

DURATION_S = 62.0
REST_S = 9.0
LAG_S = 8.0
CONFIG = SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))

_SCENARIOS: dict[str, tuple[str, float, Form]] = {
    "line": ("mainline", 100.0, "canonical"),
    "gnss": ("mainline-gnss", 100.0, "raw"),
    "trolley": ("trolley", 4.0, "json"),
    "yard": ("shunting", 20.0, "canonical"),
    "car": ("slippery-line", 100.0, "raw"),
}
"""Scenario, spacing of the balises in m, and form."""

BASE_CASES = tuple(_SCENARIOS)


@cache
def base_case(name: str, seed: int = 0) -> BaseCase:
    """The run of that name, which starts early and passes balises often."""
    scenario_name, spacing_m, form = _SCENARIOS[name]
    run = simulate(_early(scenario(scenario_name), spacing_m), seed=seed, duration_s=DURATION_S)
    return BaseCase(name, run, stream_of(run.recording, form))


def _early(plan: Scenario, spacing_m: float) -> Scenario:
    driver = plan.driver
    assert isinstance(driver, Service | Wandering | Shunting)
    assert plan.balises is not None
    return replace(
        plan,
        driver=replace(driver, start_rest_s=REST_S),
        adhesion=None,
        balises=BaliseModel(spacing_m=spacing_m, sd_m=plan.balises.sd_m),
    )
