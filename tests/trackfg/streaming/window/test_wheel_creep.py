"""A wheel that creeps for a while: fixes and the accelerometer show it to a stream, and right fixes stay in it."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.further_axle import FurtherAxle
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.driving import Service
from trackfg.factors.factor_type import FactorType
from trackfg.factors.imu import Preintegration
from trackfg.factors.loss import Cauchy
from trackfg.factors.odometry import MOST_CREEP, absolute_fix, distance_chain
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.window.fix_voting import MOST_VOTES, FixVotes
from trackfg.streaming.window.wheel_creep import Creep, with_creep
from trackfg.streaming.window.window import Interval, Window

SD_M = 0.1
CREEPS = (50.0, 75.0)
"""From when to when the wheel creeps, s."""


@pytest.mark.parametrize(
    ("further_m", "way_m", "likely"),
    [(6.0, 500.0, True), (-6.0, -500.0, True), (30.0, 2000.0, True), (60.0, 500.0, False), (300.0, 2000.0, False)],
)
def test_a_few_per_cent_of_the_way_are_creep_and_more_is_a_wrong_fix(
    further_m: float, way_m: float, likely: bool
) -> None:
    assert Creep(further_m, way_m, 0.0).is_likely(0.3**2) == likely


def test_a_neighbouring_balise_is_no_creep_however_far_the_last_one_is() -> None:
    assert not Creep(3.0, 1.0, 0.0).is_likely(0.1**2)
    assert not any(Creep(apart, 5.0 * apart, 0.0).is_likely(0.3**2) for apart in (100.0, 500.0, 2000.0))


def test_creep_shifts_the_way_since_the_last_fix_and_lets_the_scale_walk_there() -> None:
    """30 m of creep up to the last keyframe, by 3 m: nothing before them moves."""
    odo = np.column_stack([np.arange(0.0, 50.0, 10.0), np.ones(5), np.zeros(5), np.full(5, 10.0)])
    nav = Nav(np.tile(np.eye(3), (5, 1, 1)), np.zeros((5, 3)), np.zeros((5, 3)))
    states = States(nav, np.zeros((5, 6)), Odo(odo), np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))
    chain = distance_chain(np.arange(4), np.full((4, 2), 1e-6))
    window = with_creep(
        Window(np.arange(5.0), states, (), np.zeros((5, 6, Kind.IMU.dim)), (chain,)), Creep(3.0, 30.0, 1.0)
    )
    np.testing.assert_allclose(window.states.odo.distance, [0.0, 10.0, 21.0, 32.0, 43.0])
    walk = MOST_CREEP / np.sqrt(30.0) * np.sqrt(10.0)
    np.testing.assert_allclose(window.families[0].sigma[:, 1], [1e-6, walk, walk, walk])


def passing(distance: float, fix: float, t: float) -> tuple[Interval, States]:
    """The last 10 m to a place, with a fix there, and the state before."""
    nav = Nav(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))

    def at(place: float) -> States:
        odo = Odo(np.array([[place, 1.0, 0.0, 0.0]]))
        return States(nav, np.zeros((1, 6)), odo, np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))

    family = absolute_fix(np.array([1]), np.array([fix]), np.array([[SD_M]]), Cauchy(4.0))
    nothing = cast(Preintegration, None)
    return Interval(t, np.zeros(6), at(distance), nothing, np.zeros((6, Kind.IMU.dim)), (family,)), at(distance - 10.0)


def votes_after(offset: float, others_sd_m: float) -> tuple[FixVotes, list[FactorType]]:
    """The votes after three fixes that agree and one that does not, 500 m apart, and what became of the last."""
    votes = FixVotes(distance_scale_covariance=np.diag([0.1, 1e-6]))
    for i, off in enumerate([0.0, 0.0, 0.0, offset]):
        interval, newest = passing(500.0 * i, 500.0 * i + off, 20.0 * i)
        interval, _ = votes.vote_on_fixes(interval, newest, others_sd_m)
    return votes, [family.type for family in interval.families]


@pytest.mark.parametrize(
    ("offset", "others_sd_m", "follows"),
    [(8.0, np.inf, True), (8.0, 10.0, True), (8.0, 1.0, False), (8.0, 0.0, False), (200.0, np.inf, False)],
)
def test_only_what_nobody_else_would_notice_is_creep(offset: float, others_sd_m: float, follows: bool) -> None:
    votes, became = votes_after(offset, others_sd_m)
    assert became == [FactorType.ABSOLUTE_FIX if follows else FactorType.WITHHELD_FIX]
    assert (votes.pop_creep() is not None) == follows
    assert votes.pop_creep() is None
    assert (votes.walk_per_sqrt_m > 0.0) == follows
    assert [event.kind for event in votes.pop_events()] == ["wheel-crept"] * follows


def test_the_scale_walks_until_so_many_fixes_agree_as_a_place_has_votes() -> None:
    votes, _ = votes_after(8.0, np.inf)
    creep = votes.pop_creep()
    assert creep is not None
    assert (creep.further_m, creep.way_m, creep.since_s) == pytest.approx((8.0, 500.0, 40.0))
    for left in reversed(range(MOST_VOTES)):
        assert votes.walk_per_sqrt_m == pytest.approx(creep.walk_per_sqrt_m)
        place = 2000.0 + 500.0 * (MOST_VOTES - left)
        votes.vote_on_fixes(*passing(place, place, 100.0), np.inf)
    assert votes.walk_per_sqrt_m == 0.0


def creeping(tach: pd.DataFrame) -> pd.DataFrame:
    """Return what a wheel counts that creeps by 1.5 % for 25 s."""
    t, distance = tach["t_s"], tach["distance_m"]
    creep = 0.015 * np.interp(t, [CREEPS[0], CREEPS[0] + 2.0, CREEPS[1] - 2.0, CREEPS[1]], [0.0, 1.0, 1.0, 0.0])
    return tach.assign(distance_m=distance + np.cumsum(distance.diff().fillna(0.0) * creep))


def past_balises(name: str, seed: int) -> Simulation:
    """Two minutes past a balise every 300 m, with wheels that creep."""
    plan = scenario(name)
    assert isinstance(plan.driver, Service)
    balises = BaliseModel(spacing_m=300.0, sd_m=SD_M)
    axles = tuple(replace(axle, adhesion=None) for axle in plan.further_sensors if isinstance(axle, FurtherAxle))
    driver = replace(plan.driver, start_rest_s=9.0)
    plan = replace(plan, driver=driver, adhesion=None, balises=balises, further_sensors=axles)
    made = simulate(plan, seed=seed, duration_s=120.0)
    assert made.recording.tach is not None
    assert np.ptp(made.truth["chainage_m"]) > 1500.0
    others = {name: creeping(table) for name, table in made.recording.others.items()}
    return replace(made, recording=replace(made.recording, tach=creeping(made.recording.tach), others=others))


@pytest.fixture(scope="module")
def run() -> Simulation:
    """A ride with one wheel."""
    return past_balises("mainline", seed=2)


def streamed(recording: Recording, lag_s: float) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Filtered and smoothed rows, and the kinds of events."""
    source = RecordingSource(recording, batch_s=1.0)
    smoother, intake = FixedLagSmoother(source.description, lag_s=lag_s), Intake.of(source)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    kinds = [event.kind for piece in pieces for event in piece.events]
    return pd.concat([piece.filtered for piece in pieces]), pd.concat([piece.smoothed for piece in pieces]), kinds


def beyond(table: pd.DataFrame, run: Simulation, column: str, sigmas: float) -> float:
    """Return the share of the rows that are off by more than so many of their sigmas."""
    error = table[column] - np.interp(table["t_s"], run.truth["t_s"], run.truth[column])
    return float((error.abs() > sigmas * table[f"{column}_sd"]).mean())


def test_right_fixes_stay_while_the_wheel_creeps_and_a_wrong_one_does_not(run: Simulation) -> None:
    fixes = run.recording.fixes
    assert fixes is not None
    fixes = fixes.copy()
    wrong = fixes.index[fixes["t_s"] > CREEPS[1]][0]
    fixes.loc[wrong, "chainage_m"] -= 600.0
    *tables, kinds = streamed(replace(run.recording, fixes=fixes), 20.0)
    filtered, smoothed = (table[table["chainage_m_sd"] < 100.0] for table in tables)
    assert kinds.count("fix set aside") == 1
    assert "place-changed" not in kinds
    assert beyond(smoothed, run, "chainage_m", 4.0) == 0.0
    assert beyond(smoothed, run, "speed_mps", 4.0) < 0.05
    assert beyond(filtered, run, "chainage_m", 4.0) < 0.05
    assert DOUBT not in kinds


def test_right_fixes_stay_while_the_wheels_of_two_axles_creep_together() -> None:
    """Both agree with each other, and only the fixes show that they crept."""
    ride = past_balises("slippery-line-two-axles", seed=3)
    _, smoothed, kinds = streamed(ride.recording, 20.0)
    assert "wheel-crept" in kinds
    assert "fix set aside" not in kinds
    assert beyond(smoothed[smoothed["chainage_m_sd"] < 100.0], ride, "chainage_m", 4.0) == 0.0


def test_without_fixes_the_accelerometer_shows_creep_as_it_begins(run: Simulation) -> None:
    _, smoothed, kinds = streamed(replace(run.recording, fixes=None), 20.0)
    assert "wheel-crept" in kinds
    assert beyond(smoothed, run, "speed_mps", 4.0) < 0.05
