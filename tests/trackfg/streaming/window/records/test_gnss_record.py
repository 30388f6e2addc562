"""A stream learns from their residuals how good GNSS positions are, and how long their errors last."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.positioning import GnssModel
from trackfg.datasets.vehicle.driving import Service
from trackfg.evaluation.scores import rms
from trackfg.evaluation.trajectory_errors import from_the_true_start, trajectory_errors
from trackfg.factors.family import Family
from trackfg.factors.gnss import gnss_position
from trackfg.factors.loss import Huber
from trackfg.factors.states import States
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.window.records.gnss_record import GnssRecord
from trackfg.streaming.window.window import Window

WIDTH = 3.0
CANYON = (60.0, 100.0)
"""From when to when positions are off by the same 8 m, s."""


def record(residual: np.ndarray) -> GnssRecord:
    """A record of positions of 2 m at 1 Hz with these residuals, in declared sigmas."""
    n = len(residual)
    t, ones = np.arange(n) * 1.0, np.ones((n, 3))
    return GnssRecord(t, residual, 0.01 * ones, 2.0 * ones, ones, given=ones, level=ones)


def positions(n: int) -> Family:
    return gnss_position(np.arange(n), np.zeros((n, 3)), np.zeros(3), np.zeros(n), np.full((n, 3), 2.0), Huber(WIDTH))


def test_errors_as_declared_leave_the_sigmas() -> None:
    one = record(np.random.default_rng(0).standard_normal((300, 3)))
    one.judge(heading_known=True)
    assert (one.factor >= 1.0).all()
    assert np.median(one.factor) < 1.1


def test_errors_that_last_widen_the_sigmas_while_they_do() -> None:
    residual = np.random.default_rng(1).standard_normal((300, 3))
    residual[200:240] += 4.0
    one = record(residual)
    one.judge(heading_known=True)
    assert one.factor[205:235].min() > 5.0
    assert np.median(one.factor[:180]) < 1.3


def test_positions_that_contradict_the_other_sensors_are_a_doubt() -> None:
    residual = np.random.default_rng(2).standard_normal((300, 3))
    residual[:140, 0] += 40.0  # less than half of the run
    assert record(residual).events(300.0) == ()
    residual[:160, 0] += 40.0
    (event,) = record(residual).events(300.0)
    assert event.kind == DOUBT
    assert "position, yaw, chainage, speed: most GNSS positions are 40 declared sigmas or more" in event.detail


@pytest.mark.parametrize(("grown", "given", "regains"), [(8.0, 10.0, True), (3.0, 10.0, False), (8.0, 2.0, False)])
def test_positions_that_the_stream_leaves_get_their_weight_again(grown: float, given: float, *, regains: bool) -> None:
    """Errors of 3 declared sigmas took their weight from positions; what grows after that is not the receiver's."""
    residual = np.zeros((300, 3))
    residual[100:, :2] = np.linspace(3.0, grown, 200)[:, None]
    one = record(residual)
    one.given, one.level = np.ones((300, 3)), np.full((300, 3), 3.0)
    one.given[110:] = given
    one.judge(heading_known=True)
    assert one.regained.tolist() == ([[110.0, 299.0]] if regains else [])
    assert (one.since_s == 299.0) == regains
    assert (one.expected == 1.0).all()
    doubts = [event for event in one.events(300.0) if "too little weight" in str(event.detail)]
    assert [(event.t_s, event.until_s) for event in doubts] == ([(110.0, 299.0)] if regains else [])


def test_what_was_learnt_is_forgotten_where_others_err() -> None:
    """Only positions that come later are judged; residuals of all still show positions that no receiver has."""
    residual = np.random.default_rng(1).standard_normal((300, 3))
    residual[200:240] += 4.0
    one = record(residual)
    assert one.judge(heading_known=True)
    kept = one.factor.copy()
    one.forget()
    assert one.lasting == 1.0
    (coming,) = one.weigh_next((positions(1),), WIDTH)
    np.testing.assert_allclose(coming.sigma, 2.0)
    assert not one.judge(heading_known=True)
    np.testing.assert_array_equal(one.factor, kept)


def test_positions_of_the_window_have_their_own_factor_and_those_to_come_the_newest() -> None:
    one = record(np.zeros((12, 3)))
    one.factor = np.repeat(np.arange(1.0, 13.0)[:, None], 3, axis=1)
    nothing = cast(States, None)
    window = Window(np.arange(8.0, 14.0), nothing, (), np.zeros((6, 6, 0)), (positions(6),))
    (weighed,) = one.weigh(window, WIDTH).families
    np.testing.assert_allclose(weighed.sigma[:, 0], [18.0, 20.0, 22.0, 24.0, 2.0, 2.0])
    (coming,) = one.weigh_next((positions(1),), WIDTH)
    np.testing.assert_allclose(coming.sigma, 24.0)


def test_with_too_few_positions_nothing_is_learnt() -> None:
    one = record(np.full((5, 3), 10.0))
    one.judge(heading_known=True)
    assert (one.factor == 1.0).all()


@pytest.fixture(scope="module")
def run() -> Simulation:
    """A train with GNSS of 2 m."""
    plan = scenario("mainline")
    assert isinstance(plan.driver, Service)
    plan = replace(
        plan,
        driver=replace(plan.driver, start_rest_s=9.0),
        adhesion=None,
        gnss=GnssModel(sd_m=(2.0, 2.0, 4.0)),
        latitude_deg=35.2,
        balises=None,
    )
    return simulate(plan, seed=3, duration_s=120.0)


def streamed(recording: Recording, *, batch_s: float = 1.0) -> list[Estimates]:
    source = RecordingSource(recording, batch_s=batch_s)
    smoother, intake = FixedLagSmoother(source.description, lag_s=20.0), Intake.of(source)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    return [*pieces, smoother.put(intake.finish()[0]), smoother.finish()]


@pytest.fixture(scope="module")
def clean(run: Simulation) -> list[Estimates]:
    return streamed(run.recording)


@pytest.mark.slow
def test_a_street_canyon_is_not_followed_at_its_declared_sigmas(run: Simulation, clean: list[Estimates]) -> None:
    assert run.recording.gnss is not None
    gnss = run.recording.gnss.copy()
    inside = gnss["t_s"].between(*CANYON)
    gnss.loc[inside, ["east_m", "north_m"]] += 8.0
    canyon = streamed(replace(run.recording, gnss=gnss))
    table, right = (pd.concat([piece.smoothed for piece in pieces]) for pieces in (canyon, clean))
    error = {}
    for name in ("east_m", "north_m", "chainage_m"):
        off = table[name].to_numpy() - np.interp(table["t_s"], right["t_s"], right[name])
        error[name] = np.abs(off) / table[f"{name}_sd"]
    assert max(values.max() for values in error.values()) < 4.0


@pytest.mark.slow
def test_canyons_that_bend_the_speed_are_blamed_on_gnss() -> None:
    """The wheel's scale is learnt in a canyon, and the sigmas of the speed are doubted for it; in whatever batches the
    rows come.
    """
    plan = scenario("mainline")
    assert isinstance(plan.driver, Service)
    plan = replace(
        plan,
        driver=replace(plan.driver, start_rest_s=20.0),
        line=replace(plan.line, station_spacing_m=2000.0),
        gnss=GnssModel(sd_m=(2.0, 2.0, 4.0), antenna_m=(2.0, 0.0, 3.0)),
        latitude_deg=35.2,
        balises=None,
        effects=(effect("canyon", 10.0),),
    )
    run = simulate(plan, seed=11, duration_s=600.0)
    tables = [
        pd.concat([piece.smoothed for piece in streamed(run.recording, batch_s=batch_s)], ignore_index=True)
        for batch_s in (20.0, 1.0)
    ]
    pd.testing.assert_frame_equal(*tables, check_exact=True)
    errors = trajectory_errors(from_the_true_start(tables[0], run.truth), run.truth)
    assert rms(errors["along_track_m"]) < 1.5 * rms(errors["along_track_m_sd"])


@pytest.mark.slow
def test_east_and_north_exchanged_are_a_doubt_of_the_stream(run: Simulation, clean: list[Estimates]) -> None:
    assert run.recording.gnss is not None
    gnss = run.recording.gnss.rename(columns={"east_m": "north_m", "north_m": "east_m"})
    exchanged = streamed(replace(run.recording, gnss=gnss))
    said = [
        [event.detail for event in pieces[-1].events if "GNSS positions" in event.detail]
        for pieces in (clean, exchanged)
    ]
    assert [len(details) for details in said] == [0, 1]
