"""What displacement sensors see: readings as means, units and their pairs, and the factors made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.factor_type import FactorType
from trackfg.graph.build import Problem, build_problem
from trackfg.numerics.chainage.passes import passes
from trackfg.recording.model import Recording
from trackfg.sensors.displacement import rail_views, unit_pairs
from trackfg.smoothing.rail_ties import with_rail_factors
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

OPTIONS = {"seed": 1, "duration_s": 80.0, "noise": False}


@pytest.fixture(scope="module")
def run(simulated_in_full: Callable[..., Simulation]) -> Simulation:
    return simulated_in_full("measuring-car", **OPTIONS)


@pytest.fixture(scope="module")
def smoothed(smoothed_in_full: Callable[..., SmoothedStates], run: Simulation) -> SmoothedStates:
    return smoothed_in_full("measuring-car", **OPTIONS)


def with_lasers(recording: Recording, *names: str) -> Recording:
    description = recording.description
    kept = tuple(laser for laser in description.laser if laser.name in names)
    return replace(
        recording,
        description=description.model_copy(update={"laser": kept}),
        lasers={name: recording.lasers[name] for name in names},
    )


def test_units_are_sorted_from_the_front(run: Simulation) -> None:
    views = rail_views(run.recording)
    assert [(view.side, view.along_m) for view in views] == [
        ("left", 2.5),
        ("right", 2.5),
        ("left", -2.5),
        ("right", -2.5),
    ]
    assert [(a.side, a.along_m, b.along_m) for a, b in unit_pairs(views)] == [("left", 2.5, -2.5), ("right", 2.5, -2.5)]


def test_points_are_the_sensors_place_and_reading(run: Simulation) -> None:
    """In vehicle axes: across from the lateral sensor, up from the vertical one."""
    view = rail_views(run.recording)[0]
    table = {axis: run.recording.lasers[f"A-left-{axis}"] for axis in ("lateral", "vertical")}
    t = table["lateral"]["t_s"].to_numpy()[500:9000:700]
    points = view.points(t, 0.0)
    own = {laser.name: laser.position_m for laser in run.recording.description.laser}
    np.testing.assert_allclose(points[:, 0], 2.5)
    for axis, name in ((1, "lateral"), (2, "vertical")):
        reading = np.interp(t, table[name]["t_s"], table[name]["displacement_m"])
        np.testing.assert_allclose(points[:, axis], own[f"A-left-{name}"][axis] + reading, atol=1e-9)


def test_points_are_the_middles_of_the_tops(run: Simulation) -> None:
    """Half a head, 32.5 mm, beyond the running edges of standard gauge; of other rails the edges themselves."""
    recording = run.recording
    t = recording.lasers["A-left-lateral"]["t_s"].to_numpy()[500:9000:700]
    edges = [view.points(t, 0.0) for view in rail_views(recording)]

    def beyond(gauge_m: float, base_m: float) -> list[float]:
        sizes = {"gauge_m": gauge_m, "cross_level_base_m": base_m}
        track = recording.description.track.model_copy(update=sizes)
        views = rail_views(replace(recording, description=recording.description.model_copy(update={"track": track})))
        outwards = {"left": 1.0, "right": -1.0}
        moved = [view.points(t, 0.0) - edge for view, edge in zip(views, edges, strict=True)]
        return [outwards[view.side] * np.median(move[:, 1]) for view, move in zip(views, moved, strict=True)]

    assert beyond(1.435, 1.5) == pytest.approx([0.0325] * 4)
    assert beyond(1.668, 1.5) == pytest.approx([0.0] * 4)
    assert beyond(1.067, 1.5) == pytest.approx([0.0] * 4)


def test_reading_is_the_mean_over_the_window(run: Simulation) -> None:
    channel = rail_views(run.recording)[0].vertical
    assert channel is not None
    t = channel.t[3000]
    inside = np.abs(channel.t - t) < 0.0501
    assert channel.mean(np.array([t]), 0.1)[0] == pytest.approx(np.mean(channel.displacement[inside]), abs=1e-5)
    assert channel.mean_sd(0.1) == pytest.approx(channel.laser.sd_m / np.sqrt(0.1 * channel.rate_hz))
    assert channel.mean_sd(0.0) == pytest.approx(channel.laser.sd_m)


def test_pairs_fit_the_smoothed_run(smoothed: SmoothedStates) -> None:
    """Without noise both units saw one rail to some 10 um, at rest and on the way, where it is roughest to 0.1 mm."""
    states = smoothed.solution.states
    within, apart = (
        [family for family in smoothed.problem.families if family.type is kind]
        for kind in (FactorType.RAIL_WITHIN, FactorType.RAIL_APART)
    )
    assert within
    assert apart
    for family in (*within, *apart):
        residual = family.residual(states)
        assert np.sqrt(np.mean(residual**2)) < 1.5e-5
        assert np.abs(residual).max() < 1e-4
    moving = sum(len(family) for family in (*within, *apart))
    assert moving > 0.8 * len(smoothed.problem.t)


def test_keyframes_at_one_place_are_used_once(run: Simulation) -> None:
    """At rest the leading unit goes on seeing one place: one pair with the unit behind it, which comes by later."""
    config = SmoothConfig()
    problem = build_problem(run.recording, config)
    tied = with_rail_factors(problem, problem.initial, rail_views(run.recording), config.laser)
    resting = problem.t < problem.rests[0, 1]
    for family in tied.families:
        if family.type is FactorType.RAIL_APART:
            assert resting[family.slots[0].index].sum() <= 1


def test_tying_again_replaces_the_pairs(run: Simulation) -> None:
    config, views = SmoothConfig(), rail_views(run.recording)
    problem = build_problem(run.recording, config)

    def names(problem: Problem) -> list[str]:
        return sorted(family.name for family in problem.families)

    once = with_rail_factors(problem, problem.initial, views, config.laser)
    assert names(with_rail_factors(once, once.initial, views, config.laser)) == names(once)
    assert len(names(once)) > len(names(problem))


def test_silence_of_one_sensor_ties_nothing(run: Simulation) -> None:
    """Its record ends at 50 s: no pair needs a reading after that."""
    recording = run.recording
    table = recording.lasers["B-left-vertical"]
    cut = replace(recording, lasers={**recording.lasers, "B-left-vertical": table[table["t_s"] < 50.0]})
    config, views = SmoothConfig(), rail_views(cut)
    problem = build_problem(cut, config)
    tied = with_rail_factors(problem, problem.initial, views, config.laser)
    (_, late), *_ = [
        (pair, family) for pair, family in enumerate(tied.families) if family.type is FactorType.RAIL_APART
    ]
    assert problem.t[late.slots[0].index].max() < 50.0


def test_one_unit_alone_ties_only_rests(run: Simulation) -> None:
    alone = with_lasers(run.recording, "A-left-vertical", "A-left-lateral", "A-right-vertical", "A-right-lateral")
    config = SmoothConfig()
    problem = build_problem(alone, config)
    tied = with_rail_factors(problem, problem.initial, rail_views(alone), config.laser)
    assert tied.family(FactorType.RAIL_APART) is None
    held = [family for family in tied.families if family.type is FactorType.RAIL_WITHIN]
    assert len(held) == 2
    for family in held:
        assert (problem.t[family.slots[1].index] <= problem.rests[-1, 1] + 1e-6).all()


def test_passes_of_the_run_are_what_pairs_are_made_in(smoothed: SmoothedStates) -> None:
    assert len(passes(smoothed.solution.states.odo.distance)) == 1


def test_vertical_sensors_alone_are_enough_for_a_solution(simulated_in_full: Callable[..., Simulation]) -> None:
    run = simulated_in_full("measuring-car", seed=0, duration_s=60.0)
    up = with_lasers(run.recording, *(name for name in run.recording.lasers if name.endswith("vertical")))
    result = smooth_states(up, SmoothConfig())
    assert result.solution.converged
