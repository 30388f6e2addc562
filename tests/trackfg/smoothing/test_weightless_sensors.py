"""Sensors without weight most of the time: a finding, and a doubt where nothing else measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import changed
from trackfg.smoothing.reassessment import SolvedRun
from trackfg.smoothing.smoother import SmoothedStates
from trackfg.smoothing.weightless_sensors import weightless_sensors


def with_sigmas(run: SolvedRun, kind: FactorType, factor: float) -> SolvedRun:
    """Return the run as if its measurements of a kind were as much further off, in sigmas."""
    families = changed(run.problem.families, kind, lambda family: replace(family, sigma=factor * family.sigma))
    return replace(run, problem=replace(run.problem, families=families))


def test_all_sensors_of_a_sound_run_are_heard(smoothed: Callable[..., SmoothedStates]) -> None:
    said = weightless_sensors(smoothed("mainline-gnss", seed=0, duration_s=150.0))
    assert not said.findings
    assert not said.doubts
    assert not said.changed


@pytest.mark.parametrize(
    ("kind", "name"),
    [(FactorType.GNSS_POSITION, "the GNSS positions"), (FactorType.NON_HOLONOMIC, "motion along the vehicle's axis")],
)
def test_a_sensor_far_off_most_of_the_time_is_named(
    smoothed: Callable[..., SmoothedStates], kind: FactorType, name: str
) -> None:
    run = with_sigmas(smoothed("mainline-gnss", seed=0, duration_s=150.0), kind, 1e-5)
    (finding,) = weightless_sensors(run).findings
    assert finding.message.startswith(f"{name} contradict")
    assert bool(weightless_sensors(run).doubts) == (kind is FactorType.GNSS_POSITION)


def test_without_its_only_tach_the_chainage_is_not_to_be_trusted(smoothed: Callable[..., SmoothedStates]) -> None:
    """With fixes it is one of two, and the finding says how far off it is."""
    run = smoothed("mainline", seed=0, duration_s=150.0)
    states = run.solution.states
    odo = replace(states.odo, array=states.odo.array * [1.0, 1.0, 1.0, 1.0 / 3.6])
    slow = replace(run, solution=replace(run.solution, states=replace(states, odo=odo)))
    (finding,) = weightless_sensors(slow).findings
    assert "in km/h, declared in m/s" in finding.message
    fixes = [family for family in slow.problem.families if family.type is not FactorType.ABSOLUTE_FIX]
    alone = weightless_sensors(replace(slow, problem=replace(slow.problem, families=tuple(fixes))))
    (doubt,) = alone.doubts
    assert doubt.quantities == ("chainage", "speed")
    assert np.isinf(doubt.factor)


def test_a_tach_of_the_other_sense_leaves_no_direction_of_travel(smoothed: Callable[..., SmoothedStates]) -> None:
    """Positions do not show which end of the vehicle is ahead: a mounting half a turn off explains them as well."""
    run = smoothed("mainline-gnss", seed=0, duration_s=150.0)
    states = run.solution.states
    odo = replace(states.odo, array=states.odo.array * [1.0, 1.0, -1.0, 1.0])
    said = weightless_sensors(replace(run, solution=replace(run.solution, states=replace(states, odo=odo))))
    assert "moves -0.99" in said.findings[0].message
    (doubt,) = said.doubts
    assert np.isinf(doubt.factor)
    assert {"chainage", "speed", "pitch", "twist"} < set(doubt.quantities)
    assert "position" not in doubt.quantities
