"""Slips and slides happen where demand exceeds adhesion, and roll what the table of events says."""

from itertools import pairwise

import numpy as np
import pytest

from trackfg.datasets.sensors.odometer import SLIP_COLUMNS, TachModel, rolled_distance, slip_table
from trackfg.datasets.vehicle.adhesion import AdhesionModel, LowAdhesion, WheelSlip, adhesion_limit, draw_slip
from trackfg.datasets.vehicle.motion import Limits, motion, rest, reverse, run
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.datasets.vehicle.ride import Ride

TACH = TachModel()
NO_CREEP = AdhesionModel(top_creep=0.0)


@pytest.fixture
def steady(make_line):
    """200 s at 20 m/s on a level line: no demand at all."""
    return Ride(make_line([0, 5000], [0, 0]), motion(rest(200.0), 0.0, 20.0))


@pytest.fixture
def local_train(make_line):
    """From station to station 1.5 km apart, ten times, at 0.8 m/s^2."""
    leg = [*run(np.array([1500.0]), np.array([20.0]), (0.0, 0.0), Limits(0.8, 0.5)), *rest(20.0)]
    return Ride(make_line([0, 20_000], [0, 0]), motion(leg * 10, 100.0))


def _slip(ride, seed=0, duration_s=None, **model):
    return draw_slip(ride, AdhesionModel(**model), duration_s or ride.motion.duration_s, np.random.default_rng(seed))


def _rolled_too_far(ride, slip, t, tach=TACH):
    return rolled_distance(ride, tach, np.asarray(t), slip) - rolled_distance(ride, tach, np.asarray(t))


def test_a_dry_rail_has_curtius_and_knifflers_adhesion():
    np.testing.assert_allclose(adhesion_limit(np.array([0.0, 20.0, -20.0])), [0.33145, 0.22565, 0.22565], atol=1e-5)


def test_placed_events_roll_what_their_shape_says(steady):
    events = (
        WheelSlip(10.0, 4.0, 0.3, ramp_s=1.0),
        WheelSlip(30.0, 5.0, -0.4, "triangle"),
        WheelSlip(60.0, 6.0, -0.2, "sawtooth", cycle_s=1.5),
        WheelSlip(90.0, 2.0, -1.0, ramp_s=0.25),
    )
    slip = _slip(steady, top_creep=0.0, events=events)
    assert slip.events == events
    # Four cycles of 1.5 s: up from 0 or 0.2 of the peak in 0.7 of a cycle, down to 0.2 or 0 in the rest.
    sawtooth = 1.5 * ((0.5 + 3 * 0.6) * 0.7 + (3 * 0.6 + 0.5) * 0.3)
    expected = 20.0 * np.array([0.3 * 3.0, -0.4 * 2.5, -0.2 * sawtooth, -1.75])
    table = slip_table(steady, TACH, slip)
    assert tuple(table.columns) == SLIP_COLUMNS
    np.testing.assert_allclose(table["distance_error_m"], expected, atol=1e-9)
    assert table["kind"].tolist() == ["slip", "slide", "slide", "slide"]
    assert table["peak_creep"].tolist() == [0.3, -0.4, -0.2, -1.0]
    np.testing.assert_allclose(_rolled_too_far(steady, slip, [9.0, 20.0, 50.0, 80.0, 200.0]), np.cumsum([0, *expected]))
    locked = rolled_distance(steady, TACH, np.array([90.3, 91.7]), slip)
    assert locked[1] == pytest.approx(locked[0], abs=1e-9)


def test_events_that_cannot_be_are_refused(steady):
    for creep, duration in ((-1.01, 1.0), (0.0, 1.0), (0.1, 0.0), (float("nan"), 1.0)):
        with pytest.raises(ValueError, match="expected a creep"):
            WheelSlip(0.0, duration, creep)
    with pytest.raises(ValueError, match="overlap"):
        _slip(steady, events=(WheelSlip(10.0, 2.0, 0.1), WheelSlip(11.0, 2.0, 0.1)))
    in_a_row = _slip(steady, events=(WheelSlip(12.0, 2.0, 0.1), WheelSlip(10.0, 2.0, 0.1)))
    assert [event.start_s for event in in_a_row.events] == [10.0, 12.0]


def test_the_sum_of_the_events_is_what_was_rolled_too_far(local_train):
    slip = _slip(local_train, top_creep=0.0, low=(LowAdhesion(0.0, 20_000.0, 0.3),))
    table = slip_table(local_train, TACH, slip)
    assert len(table) > 10
    assert set(table["kind"]) == {"slip", "slide"}
    assert (np.sign(table["distance_error_m"]) == np.where(table["kind"] == "slip", 1, -1)).all()
    np.testing.assert_allclose(
        _rolled_too_far(local_train, slip, table["end_s"]), table["distance_error_m"].cumsum(), atol=1e-8
    )
    # By brute force.
    t = np.linspace(0.0, local_train.motion.duration_s, 2_000_001)
    error = np.trapezoid(local_train.motion.speed(t) * slip.creep(t), t)
    assert table["distance_error_m"].sum() == pytest.approx(error, abs=1e-3)


def test_running_backwards_a_slip_still_turns_the_wheel_more(make_line):
    leg = run(np.array([800.0]), np.array([15.0]), (0.0, 0.0), Limits(0.7, 0.5))
    ride = Ride(make_line([0, 1000], [0, 0]), motion([*rest(5.0), *leg, *rest(5.0), *reverse(leg)], 50.0))
    back = ride.motion.duration_s - 30.0
    slip = _slip(ride, top_creep=0.0, events=(WheelSlip(30.0, 4.0, 0.2), WheelSlip(back, 4.0, 0.2)))
    unsigned, signed = (
        slip_table(ride, tach, slip)["distance_error_m"].to_numpy() for tach in (TACH, TachModel(signed=True))
    )
    np.testing.assert_allclose(unsigned, signed * [1.0, -1.0])
    assert (unsigned > 0).all()


def test_nothing_breaks_away_on_a_dry_rail(local_train):
    slip = _slip(local_train)
    assert slip.events == ()
    assert list(slip_table(local_train, TACH, slip).columns) == list(SLIP_COLUMNS)


def test_events_lie_where_demand_exceeds_adhesion(local_train):
    slip = _slip(local_train, top_creep=0.0, low=(LowAdhesion(100.0, 500.0, 0.3), LowAdhesion(2800.0, 3200.0, 0.1)))
    assert slip.events
    for event in slip.events:
        s, v, a = (f(event.start_s) for f in (local_train.motion.distance, local_train.motion.speed,
                                              local_train.motion.acceleration))  # fmt: skip
        factor = 0.3 if s < 1000.0 else 0.1
        share = 0.5 if a > 0 else 1.0
        assert 100.0 <= s <= 500.0 or 2800.0 <= s <= 3200.0
        assert abs(a) > share * 9.80665 * factor * adhesion_limit(v)
        assert event.kind == ("slip" if a > 0 else "slide")
    rolling = slip.creep.x[slip.creep(slip.creep.x) == 0.0]
    assert local_train.motion.distance(rolling).max() > 10_000.0


def test_gradients_count(make_line):
    ride = Ride(make_line([0, 5000], [0, 0], grade=[0.03, 0.03]), motion(rest(200.0), 0.0, 20.0))
    climbing = _slip(ride, low=(LowAdhesion(0.0, 5000.0, 0.2),))
    assert {event.kind for event in climbing.events} == {"slip"}
    down = Ride(make_line([0, 5000], [0, 0], grade=[-0.03, -0.03]), motion(rest(200.0), 0.0, 20.0))
    assert {event.kind for event in _slip(down, low=(LowAdhesion(0.0, 5000.0, 0.1),)).events} == {"slide"}


def test_durations_and_peaks_are_those_of_the_literature(make_line):
    # A brake that is on all the time: what ends an event is its release.
    downhill = Ride(make_line([0, 90_000], [0, 0], grade=[-0.03, -0.03]), motion(rest(3600.0), 0.0, 20.0))
    events = [
        event
        for seed in range(4)
        for event in _slip(downhill, seed, low=(LowAdhesion(0.0, 90_000.0, 0.05),), slide_protection=False).events
    ]
    durations = np.array([event.duration_s for event in events])
    assert len(durations) > 1000
    assert durations.min() >= 1.0
    assert durations.max() <= 30.0
    assert (durations <= 10.0).mean() == pytest.approx(0.9, abs=0.02)
    peaks = -np.array([event.creep for event in events])
    assert peaks.max() <= 0.6
    assert peaks.min() >= 0.01 - 1e-12
    pauses = np.array([b.start_s - a.end_s for a, b in pairwise(events)])
    assert (pauses[pauses > 0] < 4.1).mean() > 0.99


def test_slide_protection_cycles(local_train):
    low = (LowAdhesion(0.0, 20_000.0, 0.15),)
    shapes = {on: [e.shape for e in _slip(local_train, low=low, slide_protection=on).events] for on in (True, False)}
    assert "sawtooth" in shapes[True]
    assert "sawtooth" not in shapes[False]


def test_below_the_limit_the_creep_follows_the_creep_curve(local_train):
    slip = _slip(local_train, top_creep=0.01)
    t = slip.creep.x
    x = slip.creep(t) / 0.01
    v, a = local_train.motion.speed(t), local_train.motion.acceleration(t)
    used = np.abs(a) / (np.where(a > 0, 0.5, 1.0) * 9.80665 * adhesion_limit(v))
    moving = np.abs(v) > 0
    np.testing.assert_allclose(np.abs(2 * x / (1 + x * x))[moving], used[moving], atol=1e-7)
    assert (np.sign(x) == np.sign(a))[moving & (np.abs(a) > 1e-6)].all()
    assert 1e-3 < np.abs(slip.creep(t)).max() < 1e-2
    assert np.abs(_rolled_too_far(local_train, slip, [local_train.motion.duration_s])) < 10.0


def test_creep_is_continuous_and_never_beyond_locked(local_train):
    slip = _slip(
        local_train,
        low=(LowAdhesion(0.0, 20_000.0, 0.1),),
        events=(WheelSlip(70.0, 12.0, -1.0), WheelSlip(5.0, 1.0, 0.5)),
    )
    creep = slip.creep
    assert creep(creep.x).min() == pytest.approx(-1.0, abs=1e-12)
    left = creep.c[1] + creep.c[0] * np.diff(creep.x)
    np.testing.assert_allclose(left[:-1], creep.c[1][1:], atol=1e-9)
    assert creep.c.shape[0] == 2
    # A placed event is there instead of those drawn.
    for a, b in pairwise(slip.events):
        assert b.start_s >= a.end_s


def test_random_stretches_are_as_many_and_as_long_as_asked():
    spans = [random_spans(0.002, (50.0, 150.0), 100_000.0, np.random.default_rng(seed)) for seed in range(20)]
    assert np.mean([len(drawn) for drawn in spans]) == pytest.approx(100_000 / 600, rel=0.05)
    lengths = np.concatenate([np.diff(drawn)[:, 0] for drawn in spans])
    assert lengths.min() >= 50.0
    assert lengths.max() <= 150.0
    assert (spans[0][1:, 0] > spans[0][:-1, 1]).all()
    shorter = random_spans(0.002, (50.0, 150.0), 50_000.0, np.random.default_rng(0))
    np.testing.assert_array_equal(spans[0][: len(shorter)], shorter)
    assert random_spans(0.0, (1.0, 2.0), 100.0, np.random.default_rng(0)).shape == (0, 2)


def test_a_seed_repeats_two_differ_and_a_longer_run_begins_alike(local_train):
    model = {"stretches_per_km": 1.0, "mu_factor": (0.1, 0.3)}
    long = _slip(local_train, 3, **model)
    assert _slip(local_train, 3, **model).events == long.events
    assert _slip(local_train, 4, **model).events != long.events
    short = _slip(local_train, 3, 500.0, **model)
    assert short.events == tuple(event for event in long.events if event.start_s < 500.0)
    assert len(short.events) < len(long.events)
    t = np.linspace(0.0, 500.0, 1001)
    np.testing.assert_array_equal(short.creep(t), long.creep(t))
