"""The wheel's scale walks where the data show that it does: another wheel, creep that lasts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.graph.build import Problem
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording
from trackfg.results.verdict import Doubt
from trackfg.smoothing.smoother import SmoothedStates, smooth_states
from trackfg.smoothing.wheel_scale import _edges, _walking_at, _walking_everywhere, wheel_scale
from trackfg.solver.scale_evidence import ScaleEvidence

JUMP = 0.01


@pytest.fixture(scope="module")
def run(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("mainline", seed=2, duration_s=150.0)


@pytest.fixture(scope="module")
def constant(run: Simulation) -> SmoothedStates:
    return smooth_states(run.recording, SmoothConfig())


def with_jump(recording: Recording, at_s: float, jump: float = JUMP) -> Recording:
    """The wheel rolls as much more per turn until a time: it counts as much less, in whole pulses still."""
    assert recording.tach is not None
    t, distance = recording.tach["t_s"].to_numpy(), recording.tach["distance_m"].to_numpy()
    at = np.interp(at_s, t, distance)
    pulse = np.min(np.diff(np.unique(distance)))
    rolled = np.where(distance > at, distance, at + (distance - at) * (1.0 - jump))
    return replace(recording, tach=pd.DataFrame({"t_s": t, "distance_m": pulse * np.round(rolled / pulse)}))


def with_fixes(run: Simulation, times: list[float]) -> pd.DataFrame:
    chainage = np.interp(times, run.truth["t_s"], run.truth["chainage_m"])
    return pd.DataFrame({"t_s": times, "chainage_m": chainage, "chainage_sd_m": 0.2})


def walk(smoothed: SmoothedStates) -> float:
    """How many times as fast the scale walks as the settings say."""
    solved, declared = (p.family(FactorType.DISTANCE_CHAIN) for p in (smoothed.problem, smoothed.declared))
    assert solved is not None
    assert declared is not None
    return float(np.max(solved.sigma[:, 1] / declared.sigma[:, 1]))


def test_a_constant_scale_stays_one(constant: SmoothedStates) -> None:
    assert walk(constant) == 1.0
    assert not [finding for finding in constant.findings if finding.code == "wheel-scale-varies"]


@pytest.mark.parametrize(("likelihoods", "faster"), [([2.0, 40.0, 63.0, 61.0], 1e3), ([2.0, 1.0], 1e2)])
def test_faster_walks_are_tried_while_they_are_likelier(
    constant: SmoothedStates, likelihoods: list[float], faster: float
) -> None:
    chain, seen = constant.problem.family(FactorType.DISTANCE_CHAIN), iter(likelihoods)
    assert chain is not None
    walking = _walking_everywhere(SimpleNamespace(log_likelihood=lambda _: next(seen)), chain, 1e-7)
    np.testing.assert_allclose(walking.sigma[:, 1], faster * chain.sigma[:, 1])
    assert next(seen, None) is None


def test_what_the_data_say_of_changes_is_what_their_likelihood_says(constant: SmoothedStates) -> None:
    """The likelihood of two changes with given sigmas, by the joint information and by two eliminations."""
    problem = constant.problem
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    assert chain is not None
    evidence = ScaleEvidence.of(problem.inertial, problem.families, constant.solution.states)
    edges = np.array([60, 110])
    information, linear = evidence.on_changes(chain, edges)

    def log_likelihood(sd: float) -> float:
        sigma = chain.sigma.copy()
        sigma[edges, 1] = sd
        return evidence.log_likelihood(chain.with_sigma(sigma))

    precision = information + np.eye(2) / 0.01**2
    gain = 0.5 * linear @ np.linalg.solve(precision, linear) - 0.5 * np.linalg.slogdet(0.01**2 * precision)[1]
    assert log_likelihood(0.01) - log_likelihood(1e-9) == pytest.approx(gain, abs=1e-3)


def test_cells_without_a_way_are_one_with_those_before(constant: SmoothedStates) -> None:
    chain = constant.problem.family(FactorType.DISTANCE_CHAIN)
    assert chain is not None
    t = np.arange(101.0)
    distance = np.clip(5.0 * (t - 15.0), 0.0, 200.0)  # at rest up to 15 s, and from 55 s on
    edges = _edges(t, distance)
    assert edges.tolist() == [19, 29, 39, 49, 59]
    chain = chain.take(np.arange(len(chain)) < 100)
    walking = _walking_at(edges, np.full(5, 1e-4), chain)
    added = walking.sigma[:, 1] ** 2 - chain.sigma[:, 1] ** 2
    np.testing.assert_allclose(np.add.reduceat(added, [0, 25, 35, 45, 55]), 1e-4, rtol=1e-6)
    np.testing.assert_array_equal(walking.sigma[:, 0], chain.sigma[:, 0])


def walking(constant: SmoothedStates, times: float) -> SmoothedStates:
    """The same solution, as if of a scale that walks so many times as fast as declared."""
    families = changed(
        constant.problem.families, FactorType.DISTANCE_CHAIN, lambda chain: chain.with_sigma(chain.sigma * [1.0, times])
    )
    return replace(constant, problem=replace(constant.problem, families=families))


def chain_of(problem: Problem) -> Family:
    chain = problem.family(FactorType.DISTANCE_CHAIN)
    assert chain is not None
    return chain


def test_little_is_left_of_a_walk_that_the_data_do_not_show_any_more(constant: SmoothedStates) -> None:
    """Noise that was not known yet may have looked like a scale that walks: a solution with one is judged anew."""
    judged = wheel_scale(walking(constant, 3000.0))
    assert judged.changed
    assert not judged.findings
    left, before = (np.sum(chain_of(run.problem).sigma[:, 1] ** 2) for run in (judged, walking(constant, 3000.0)))
    assert left < 0.01 * before


def test_changes_are_allowed_for_by_their_probability(
    constant: SmoothedStates, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = constant.problem
    edges = _edges(problem.t, constant.solution.states.odo.distance)
    variance = np.full(len(edges), 1e-9)
    monkeypatch.setattr("trackfg.smoothing.wheel_scale.variance_of_changes", lambda *_: variance)
    judged = chain_of(wheel_scale(walking(constant, 3000.0)).problem)
    np.testing.assert_allclose(judged.sigma, _walking_at(edges, variance, chain_of(constant.declared)).sigma)


def test_a_run_without_cells_has_a_constant_scale(constant: SmoothedStates, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trackfg.smoothing.wheel_scale._edges", lambda *_: np.zeros(0, dtype=int))
    judged = chain_of(wheel_scale(walking(constant, 3000.0)).problem)
    np.testing.assert_array_equal(judged.sigma, chain_of(constant.declared).sigma)


def test_a_scale_is_judged_again_only_where_what_shows_it_has_changed(
    constant: SmoothedStates, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, calls = constant.problem, []
    monkeypatch.setattr("trackfg.smoothing.wheel_scale.log_odds_of_change", lambda *_: calls.append(1) or -np.inf)

    def is_judged(kind: FactorType) -> bool:
        calls.clear()
        families = changed(problem.families, kind, lambda family: family.with_sigma(1.1 * family.sigma))
        judged = wheel_scale(replace(constant, problem=replace(problem, families=families), judged_before=problem))
        assert not judged.changed
        return bool(calls)

    assert is_judged(FactorType.TACH_DISTANCE)
    assert is_judged(FactorType.PRIOR_IMU)
    assert not is_judged(FactorType.BIAS_WALK)
    noisier = replace(problem, measured=(*problem.measured,))
    wheel_scale(replace(constant, problem=noisier, judged_before=problem))
    assert calls


def test_a_speed_signal_that_is_off_by_a_constant_is_no_scale_that_walks(run: Simulation) -> None:
    """A speed that is shown 0.14 m/s too low is a scale of its own at each speed: 2 % at 7 m/s, 0.5 % at 28 m/s."""
    t = np.arange(0.0, run.truth["t_s"].iloc[-1], 0.1)
    speed = np.interp(t, run.truth["t_s"], run.truth["speed_mps"])
    shown = np.where(speed > 0.5, speed - 0.14, 0.0) + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    rolled = np.concatenate([[0.0], np.cumsum(0.05 * (shown[1:] + shown[:-1]))])
    tach = run.recording.description.tach
    assert tach is not None
    signal = Tach(file=tach.file, column="speed_mps", kind="speed", unit="m/s", signed=tach.signed)
    description = run.recording.description.model_copy(update={"tach": signal})
    recording = replace(run.recording, description=description, tach=pd.DataFrame({"t_s": t, "distance_m": rolled}))
    fixes = with_fixes(run, [40.0, 60.0, 80.0, 100.0, 120.0, 140.0])
    smoothed = smooth_states(replace(recording, fixes=fixes), SmoothConfig())
    assert walk(smoothed) == 1.0
    assert "speed-offset" in {finding.code for finding in smoothed.findings}
    assert smoothed.solution.states.wheel[0, 4] == pytest.approx(-0.14, abs=0.04)


def test_another_wheel_is_noticed_and_allowed_for(run: Simulation) -> None:
    """At 90 s the scale falls by 1 %. A constant one is somewhere in between, wrong by many of its sigmas on either
    side; one that walks is right before and after.
    """
    fixes = with_fixes(run, [40.0, 75.0, 110.0, 145.0])
    smoothed = smooth_states(replace(with_jump(run.recording, 90.0), fixes=fixes), SmoothConfig())
    assert walk(smoothed) > 10.0
    assert [finding.code for finding in smoothed.findings if "scale" in finding.code] == ["wheel-scale-varies"]
    before, after = np.interp([60.0, 130.0], smoothed.problem.t, smoothed.solution.states.odo.scale)
    assert before - after == pytest.approx(JUMP, rel=0.3)
    trajectory = smoothed.trajectory
    error = trajectory["chainage_m"] - np.interp(trajectory["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    assert (error.abs() < 3.0 * trajectory["chainage_m_sd"]).mean() > 0.9
    assert error.abs().max() < 1.5
    chain, declared = (p.family(FactorType.DISTANCE_CHAIN) for p in (smoothed.problem, smoothed.declared))
    assert chain is not None
    assert declared is not None
    begins = smoothed.problem.t[chain.slots[0].index]
    near = (begins > 70.0) & (begins < 110.0)
    by = [float(np.sqrt(np.sum(chain.sigma[part, 1] ** 2))) for part in (near, ~near)]
    assert by[0] == pytest.approx(JUMP, rel=0.3)
    assert by[1] < 0.1 * JUMP  # it changes at one time, and is a constant before and after


def test_a_scale_that_jumps_between_fixes_far_apart_walks_where_it_does(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=8, duration_s=400.0)
    recording = replace(with_jump(run.recording, 185.3, 0.005), fixes=with_fixes(run, [77.5, 289.6, 386.6]))
    smoothed = smooth_states(recording, SmoothConfig())
    trajectory = smoothed.trajectory
    error = trajectory["chainage_m"] - np.interp(trajectory["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    assert (error.abs() < 3.0 * trajectory["chainage_m_sd"]).mean() > 0.98


@pytest.mark.parametrize(("begin_s", "end_s", "creep"), [(180.0, 240.0, 0.01), (60.0, 150.0, -0.015)])
def test_creep_between_fixes_far_apart_is_in_the_sigmas(
    simulated: Callable[..., Simulation], begin_s: float, end_s: float, creep: float
) -> None:
    """It may begin while the vehicle pulls away, where the accelerometer does not separate it from a gradient."""
    run = simulated("mainline", seed=5, duration_s=400.0)
    fixes = with_fixes(run, [40.0, 140.0, 260.0, 390.0])
    recording = with_jump(with_jump(run.recording, end_s, -creep), begin_s, creep)
    trajectory = smooth_states(replace(recording, fixes=fixes), SmoothConfig()).trajectory
    error = trajectory["chainage_m"] - np.interp(trajectory["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    assert (error.abs() < 3.0 * trajectory["chainage_m_sd"]).mean() > 0.95
    assert np.sqrt(np.mean(error**2)) < 0.5


def test_fixes_that_a_creeping_wheel_explains_are_used_again(run: Simulation) -> None:
    """Of two fixes 30 s and some 500 m from the others, one is 3 m off, as a wheel that creeps by less than 2 % makes
    it, the other one 300 m: the first is used.
    """
    fixes = with_fixes(run, [40.0, 75.0, 110.0, 125.0, 145.0])
    fixes.loc[3, "chainage_m"] += 300.0
    smoothed = smooth_states(replace(with_jump(run.recording, 90.0), fixes=fixes), SmoothConfig())
    withheld = [family for family in smoothed.problem.withheld if family.type is FactorType.WITHHELD_FIX]
    assert [len(family) for family in withheld] == [1]
    assert smoothed.problem.t[withheld[0].slots[0].index[0]] == pytest.approx(125.0, abs=0.1)


def test_a_scale_that_changes_by_more_than_a_wheel_is_no_scale(constant: SmoothedStates) -> None:
    states = constant.solution.states
    scale = np.zeros((len(states), 4))
    scale[:, 1] = np.linspace(0.0, 1.0, len(states))

    def doubts(change: float) -> tuple[Doubt, ...]:
        odo = replace(states.odo, array=states.odo.array + change * scale)
        moved = replace(constant.solution, states=replace(states, odo=odo))
        return wheel_scale(replace(constant, solution=moved)).doubts

    assert not doubts(0.05)
    (doubt,) = doubts(0.12)
    assert np.isinf(doubt.factor)
    assert set(doubt.quantities) == {"chainage", "position", "speed"}
