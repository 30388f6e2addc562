"""Fixes vote for a place: one that is wrong, or a few, must not convince against those that follow."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.driving import Service
from trackfg.factors.factor_type import FactorType
from trackfg.factors.imu import Preintegration
from trackfg.factors.loss import Cauchy
from trackfg.factors.odometry import absolute_fix, withheld_fix
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.results.events import DOUBT
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.window.fix_voting import FixVotes, shift_interval
from trackfg.streaming.window.moving_window import MovingWindow
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.window import Interval

SD_M, APART_M = 0.2, 100.0
RIGHT, WRONG, OTHER = 0.0, 60.0, -200.0


def at(distance: float) -> States:
    nav = Nav(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    odo = Odo(np.array([[distance, 1.0, 0.0, 0.0]]))
    return States(nav, np.zeros((1, 6)), odo, np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))


def passing(distance: float, fix: float) -> Interval:
    """Of 10 m, with a fix at its end."""
    sigma = np.array([[SD_M]])
    family = absolute_fix(np.array([1]), np.array([fix]), sigma, Cauchy(4.0))
    return Interval(0.0, np.zeros(6), at(distance), cast(Preintegration, None), np.zeros((6, Kind.IMU.dim)), (family,))


def after(offsets: list[float], *, known_m: float = 0.3) -> tuple[FixVotes, float, list[str]]:
    """The votes after fixes off by so much, one after the other; where the vehicle is believed to be then, off the
    truth; what became of each fix.
    """
    votes, believed, became = FixVotes(), 0.0, []
    for i, off in enumerate(offsets):
        votes.distance_scale_covariance = np.diag([1e8 if i == 0 else known_m**2, 1e-6])
        true = APART_M * (i + 1)
        if i == 0:
            believed = off  # who knows nothing believes the first
        new, moved = votes.vote_on_fixes(passing(true + believed, true + off), at(true - 10.0 + believed))
        believed += moved
        became += [family.type for family in new.families]
    return votes, believed, became


@pytest.mark.parametrize("wrong", [1, 2])
def test_whom_one_has_believed_first_is_outvoted(wrong: int) -> None:
    votes, believed, became = after([WRONG] * wrong + [RIGHT] * (wrong + 1))
    assert believed == pytest.approx(RIGHT)
    assert became == [FactorType.ABSOLUTE_FIX] * wrong + [FactorType.WITHHELD_FIX] * wrong + [FactorType.ABSOLUTE_FIX]
    assert [event.kind for event in votes.pop_events()] == ["place-changed"]
    assert not votes.pop_events()


@pytest.mark.parametrize("wrong", [1, 2, 3])
def test_a_few_that_are_wrong_alike_are_not_believed(wrong: int) -> None:
    votes, believed, became = after([RIGHT] * 5 + [WRONG] * wrong)
    assert believed == RIGHT
    assert became == [FactorType.ABSOLUTE_FIX] * 5 + [FactorType.WITHHELD_FIX] * wrong
    assert not votes.pop_events()
    assert after([RIGHT] * 5 + [WRONG] * wrong + [RIGHT] * 4)[0].rivals == ()


def test_many_alike_are_believed() -> None:
    votes, believed, _ = after([RIGHT] * 50 + [WRONG] * 4)
    assert believed == pytest.approx(WRONG)
    assert [event.detail for event in votes.pop_events()] == ["4 fixes agree on a place +60.0 m on"]


def test_a_single_fix_replaces_a_place_that_no_fix_has_shown() -> None:
    votes = FixVotes(distance_scale_covariance=np.diag([0.1, 1e-6]))
    assert votes.vote_on_fixes(passing(100.0, 160.0), at(90.0))[1] == 60.0
    assert [event.detail for event in votes.pop_events()] == ["1 fix agrees on a place +60.0 m on"]


def test_fixes_of_an_interval_are_followed_anew_when_its_place_changes() -> None:
    """One fix is 60 m on, the other is not: shifted by 60 m, the interval follows the first and withholds the other."""
    index, sigma = np.array([0, 1]), np.full((2, 1), SD_M)
    fixes = absolute_fix(index, np.array([90.0 + WRONG, 100.0]), sigma, Cauchy(4.0))
    sorted_before = (fixes.take(np.array([False, True])), withheld_fix(fixes.take(np.array([True, False]))))
    interval = passing(100.0, 100.0)._replace(families=sorted_before)
    shifted = shift_interval(interval, at(90.0), WRONG)
    assert shifted.predicted.odo.distance == pytest.approx(100.0 + WRONG)
    assert {family.type: family.data["distance"].item() for family in shifted.families} == {
        FactorType.ABSOLUTE_FIX: 90.0 + WRONG,
        FactorType.WITHHELD_FIX: 100.0,
    }


def test_wrong_ones_that_differ_do_not_add_up() -> None:
    assert after([RIGHT] * 3 + [WRONG, OTHER, 3.0 * WRONG, 2.0 * OTHER, 5.0 * WRONG])[1] == RIGHT


@pytest.mark.parametrize(
    ("offsets", "probability"),
    [
        ([RIGHT], 0.0),
        ([WRONG, RIGHT], 0.5),
        ([WRONG, RIGHT, RIGHT], 0.1),
        ([WRONG, RIGHT, RIGHT, RIGHT], 0.0),
        ([RIGHT, RIGHT, RIGHT, WRONG], 0.0),
        ([RIGHT, RIGHT, RIGHT, WRONG, WRONG], 0.1),
        ([RIGHT, RIGHT, RIGHT, WRONG, WRONG, WRONG], 0.5),
    ],
)
def test_the_place_is_as_sure_as_the_vote(offsets: list[float], probability: float) -> None:
    assert after(offsets)[0].doubt_m == pytest.approx(np.sqrt(probability) * WRONG, rel=0.02)


def test_who_is_not_sure_where_he_is_follows() -> None:
    assert after([RIGHT, WRONG], known_m=20.0)[2] == [FactorType.ABSOLUTE_FIX] * 2


def test_a_fix_read_again_is_no_second_vote() -> None:
    votes = FixVotes(votes=1, distance_scale_covariance=np.diag([0.1, 1e-6]))
    for _ in range(5):
        votes.vote_on_fixes(passing(100.0, 160.0), at(90.0))
    assert (votes.votes, [rival.votes for rival in votes.rivals]) == (1, [1])


def test_a_fix_that_agrees_is_no_second_vote_when_read_again() -> None:
    votes = FixVotes(votes=1, distance_scale_covariance=np.diag([0.1, 1e-6]))
    for _ in range(5):
        votes.vote_on_fixes(passing(100.0, 100.1), at(90.0))
    assert votes.votes == 2


def test_rivals_are_counted_from_the_place_that_is_believed_now() -> None:
    """Off by +60 m first, then by -200 m, then right twice: from the right place the rivals are at +60 and -200 m."""
    votes, believed, _ = after([WRONG, OTHER, RIGHT, RIGHT])
    assert believed == pytest.approx(RIGHT)
    assert sorted(rival.further_m for rival in votes.rivals) == pytest.approx([OTHER, WRONG])


@pytest.fixture(scope="module")
def run() -> Simulation:
    """A minute past balises, the first of which is 60 m off."""
    plan: Scenario = scenario("mainline")
    assert isinstance(plan.driver, Service)
    assert plan.balises is not None
    balises = BaliseModel(spacing_m=100.0, sd_m=plan.balises.sd_m)
    early = replace(plan, driver=replace(plan.driver, start_rest_s=9.0), adhesion=None, balises=balises)
    made = simulate(early, seed=0, duration_s=52.0)
    assert made.recording.fixes is not None
    fixes = made.recording.fixes.copy()
    fixes.loc[fixes.index[0], "chainage_m"] += 60.0
    return replace(made, recording=replace(made.recording, fixes=fixes))


def test_a_wrong_first_fix_is_got_over(run: Simulation) -> None:
    fixes = run.recording.fixes
    assert fixes is not None
    source, config = RecordingSource(run.recording, batch_s=0.5), SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))
    smoother, other = (FixedLagSmoother(run.recording.description, config, lag_s=6.0) for _ in range(2))
    disputed, intake, pieces, again = (
        fixes["t_s"].iloc[1] + 2.0,
        Intake.of(source),
        list[Estimates](),
        list[Estimates](),
    )
    for batch in source:
        rows = intake.push(batch)[0]
        pieces.append(smoother.put(rows))
        if rows.until_s >= disputed:
            if again:
                again.append(other.put(rows))
            else:
                assert smoother._moving.votes.doubt_m > 30.0
                other.restore(smoother.state())
                again.append(pieces[-1])
    rest = intake.finish()[0]
    pieces += [smoother.put(rest), smoother.finish()]
    again += [other.put(rest), other.finish()]
    for one, same in zip(pieces[-len(again) :], again, strict=True):
        assert one.filtered.equals(same.filtered)
        assert one.smoothed.equals(same.smoothed)
        assert one.events == same.events
    kinds = [event.kind for piece in pieces for event in piece.events]
    assert kinds.count("place-changed") == 1
    doubts = [event for piece in pieces for event in piece.events if event.kind == DOUBT]
    (doubt,) = (event for event in doubts if event.table == "fixes")
    written = pd.concat([piece.smoothed for piece in pieces])
    error = written["chainage_m"] - np.interp(written["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    far = written.loc[np.abs(error) > 4.0 * written["chainage_m_sd"] + 0.02, "t_s"]
    assert len(far)
    assert far.between(doubt.t_s, doubt.until_s).all()
    reported = [kind for kind in kinds if kind in ("fix used", "fix set aside")]
    assert len(reported) == len(fixes)
    assert reported[1:] == ["fix used"] * (len(fixes) - 1)  # the first may be reported before it is known to be wrong
    for name in ("filtered", "smoothed"):
        for piece in pieces:
            table = getattr(piece, name)
            table = table[table["t_s"] > fixes["t_s"].iloc[1] + 1.0]
            error = table["chainage_m"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"])
            assert (np.abs(error) <= 4.0 * table["chainage_m_sd"] + 0.02).all()
    assert pieces[-1].filtered["chainage_m_sd"].iloc[-1] < 1.0


def test_keyframes_that_had_left_the_window_shift_with_it(run: Simulation) -> None:
    source, config = RecordingSource(run.recording, batch_s=0.5), SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))
    smoother, intake = FixedLagSmoother(run.recording.description, config, lag_s=6.0), Intake.of(source)
    for batch in source:
        smoother.put(intake.push(batch)[0])
    assert smoother._tables is not None
    history, running = smoother._tables.history, smoother._running
    before = history.joined_with(running.window, running.root)[1]
    history.shift(6000.0)
    shifted = replace(running.window, states=running.window.states.moved_along(6000.0))
    after = history.joined_with(shifted, running.root)[1]
    assert len(history.parts) > 5
    np.testing.assert_allclose(after.odo.distance - before.odo.distance, 6000.0, atol=1e-6)
    np.testing.assert_allclose(after.nav.p, before.nav.p, atol=1e-6)


@pytest.mark.parametrize("on_map", [False, True])
def test_where_a_map_shows_the_place_fixes_of_the_first_window_do_not_vote_either(
    run: Simulation, on_map: bool
) -> None:
    fixes = pd.DataFrame({"t_s": [2.0, 4.0, 6.0], "chainage_m": [0.0, 0.0, 60.0], "chainage_sd_m": [0.1, 0.1, 0.1]})
    source = RecordingSource(replace(run.recording, fixes=fixes), batch_s=0.5)
    buffer = SampleBuffer(source.description)
    moving, intake = MovingWindow(buffer, SmoothConfig(), 6.0, on_map=on_map), Intake.of(source)
    for batch in source:
        buffer.put(intake.push(batch)[0])
        t = moving.next_keyframe()
        if t is not None and moving.has_rows_for(t):
            moving.add_keyframe(t)
            break
    assert moving.running is not None
    assert moving.votes.doubt_m == pytest.approx(0.0 if on_map else np.sqrt(0.1) * 60.0, rel=0.02)
    assert len(moving.votes.rivals) == (0 if on_map else 1)
