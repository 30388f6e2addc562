"""The tachometer's counts add up."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.sensors.odometer import (
    TachModel,
    draw_scale,
    ideal_table,
    pulse_table,
    rolled_distance,
    slip_table,
    worn_scale,
)
from trackfg.datasets.vehicle.adhesion import AdhesionModel, WheelSlip, draw_slip
from trackfg.datasets.vehicle.motion import Limits, motion, rest, reverse, run
from trackfg.datasets.vehicle.ride import Ride


@pytest.fixture
def to_and_fro(make_line):
    leg = run(np.array([500.0]), np.array([12.0]), (0.0, 0.0), Limits(0.7, 0.5))
    return Ride(make_line([0, 600], [0, 0]), motion([*rest(5.0), *leg, *rest(5.0), *reverse(leg), *rest(5.0)], 20.0))


def _duration(ride):
    return ride.motion.duration_s


def test_unsigned_count_is_the_path_over_scale_and_quantum(to_and_fro):
    model, scale = TachModel(), 1.004
    tach = pulse_table(to_and_fro, model, scale, _duration(to_and_fro), np.random.default_rng(0))
    count = tach["distance_m"].to_numpy() / model.quantum_m
    np.testing.assert_allclose(count, np.rint(count), atol=1e-6)
    assert np.all(np.diff(count) >= -1e-9)
    assert count[-1] == pytest.approx(1000.0 / scale / model.quantum_m, abs=1.01)


def test_signed_count_comes_back(to_and_fro):
    model = TachModel(signed=True)
    tach = pulse_table(to_and_fro, model, 0.99, _duration(to_and_fro), np.random.default_rng(0))
    assert tach["distance_m"].max() == pytest.approx(500.0 / 0.99, abs=1.01 * model.quantum_m)
    assert tach["distance_m"].iloc[-1] == pytest.approx(0.0, abs=1.01 * model.quantum_m)


def test_quantisation_is_within_one_pulse_and_its_phase_random(to_and_fro):
    model = TachModel()
    true = ideal_table(to_and_fro, model, _duration(to_and_fro))
    phases = []
    for seed in range(5):
        tach = pulse_table(to_and_fro, model, 1.0, _duration(to_and_fro), np.random.default_rng(seed))
        error = (tach["distance_m"] - true["distance_m"]) / model.quantum_m
        assert error.max() - error.min() <= 1.0 + 1e-6
        phases.append(error.mean())
    assert np.std(phases) > 0.05


def test_creep_grows_with_the_root_of_distance(make_line):
    ride = Ride(make_line([0, 3000], [0, 0]), motion(rest(200.0), 0.0, 10.0))
    model = TachModel(creep_density=0.02)
    ends = [
        pulse_table(ride, model, 1.0, 200.0, np.random.default_rng(seed))["distance_m"].iloc[-1] for seed in range(100)
    ]
    assert np.std(ends) == pytest.approx(0.02 * np.sqrt(2000.0), rel=0.25)


def test_clock_offset_is_what_must_be_added(to_and_fro):
    late = TachModel(clock_offset_s=0.3)
    shifted = pulse_table(to_and_fro, late, 1.0, 60.0, np.random.default_rng(0))
    right = pulse_table(to_and_fro, TachModel(), 1.0, 60.0, np.random.default_rng(0))
    np.testing.assert_allclose(shifted["t_s"] + 0.3, right["t_s"], atol=1e-12)
    assert shifted["distance_m"].equals(right["distance_m"])


def test_scale_is_drawn_with_its_spread():
    model = TachModel(scale_sd=0.004)
    scales = [draw_scale(model, np.random.default_rng(seed)) for seed in range(400)]
    assert np.mean(scales) == pytest.approx(1.0, abs=0.001)
    assert np.std(scales) == pytest.approx(0.004, rel=0.1)


EVERYTHING = {"creep_density": 2e-3, "wear_per_100km": 0.01, "rail_offset_m": 0.5, "outward_offset_m": 0.2}


@pytest.fixture
def curved_to_and_fro(make_line):
    leg = run(np.array([500.0]), np.array([12.0]), (0.0, 0.0), Limits(0.7, 0.5))
    curved = make_line([0, 100, 150, 300, 350, 600], [0, 0, 1 / 200, 1 / 200, 0, 0])
    return Ride(curved, motion([*rest(5.0), *leg, *rest(5.0), *reverse(leg), *rest(5.0)], 20.0))


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("effects", [{}, EVERYTHING], ids=["ideal wheel", "everything"])
def test_stamped_pulses_are_the_sampled_count(curved_to_and_fro, signed, effects):
    ride = curved_to_and_fro
    model = TachModel(signed=signed, clock_offset_s=0.07, **effects)
    slip = None
    if effects:
        placed = AdhesionModel(events=(WheelSlip(20.0, 5.0, 0.4), WheelSlip(80.0, 5.0, -1.0)))
        slip = draw_slip(ride, placed, _duration(ride), np.random.default_rng(0))
    sampled, stamped, third = (
        pulse_table(ride, replace(model, stamped=n), 1.003, _duration(ride), np.random.default_rng(5), slip)
        for n in (0, 1, 3)
    )
    row = np.searchsorted(stamped["t_s"], sampled["t_s"] + 1e-10, side="right") - 1
    np.testing.assert_array_equal(stamped["distance_m"].to_numpy()[row], sampled["distance_m"])
    assert (np.diff(stamped["t_s"]) > 0).all()
    steps = np.diff(stamped["distance_m"]) / model.quantum_m
    np.testing.assert_allclose(np.abs(steps[:-1]), 1.0, atol=1e-6)
    assert (steps.min() < -0.5) == signed
    # Every third pulse is among them.
    assert set(third["t_s"]) <= set(stamped["t_s"])
    assert len(third) == pytest.approx(len(stamped) / 3, abs=3)
    # At rest nothing is written.
    gaps = np.diff(stamped["t_s"])
    assert np.count_nonzero(gaps > 4.9) >= 2


def test_a_stamp_is_the_time_at_which_the_wheel_passes_a_multiple(to_and_fro):
    model = TachModel(stamped=1)
    tach = pulse_table(to_and_fro, model, 1.0, _duration(to_and_fro), np.random.default_rng(0))
    pulses = tach.iloc[1:-1]
    behind = (pulses["distance_m"] - to_and_fro.motion.path(pulses["t_s"])) / model.quantum_m
    # The same fraction of a pulse each time: the phase.
    assert behind.max() - behind.min() < 1e-6
    assert 0 < behind.mean() < 1
    assert len(pulses) == pytest.approx(1000.0 / model.quantum_m, abs=1.01)


def test_a_parked_vehicle_still_has_a_table(make_line):
    ride = Ride(make_line([0, 100], [0, 0]), motion(rest(60.0), 50.0))
    tach = pulse_table(ride, TachModel(stamped=1), 1.0, 60.0, np.random.default_rng(0))
    assert tach["t_s"].tolist() == [0.0, 60.0]
    assert tach["distance_m"].tolist() == [0.0, 0.0]


def test_a_wheel_wears_by_its_part_per_100_km(make_line):
    ride = Ride(make_line([0, 60_000], [0, 0]), motion(rest(2500.0), 0.0, 20.0))
    model = TachModel(wear_per_100km=0.004)
    t = np.array([0.0, 1000.0, 2500.0])
    np.testing.assert_allclose(
        worn_scale(ride, model, 1.01, t), 1.01 / (1 + 0.004 * np.array([0, 0.2, 0.5])), rtol=1e-12
    )
    # A smaller wheel turns more often, more and more so.
    expected = 20.0 * t * (1 + 0.5 * 0.004 * 20.0 * t / 1e5)
    np.testing.assert_allclose(rolled_distance(ride, model, t), expected, rtol=1e-12)
    tach = pulse_table(ride, model, 1.01, 2500.0, np.random.default_rng(0))
    assert tach["distance_m"].iloc[-1] == pytest.approx(expected[-1] / 1.01, abs=1.01 * model.quantum_m)


@pytest.mark.parametrize("offset", [0.53, -0.53])
def test_in_a_curve_a_wheel_rolls_as_far_as_its_rail_is_long(make_line, offset):
    ride = Ride(make_line([0, 3000], [1 / 300, 1 / 300]), motion(rest(100.0), 0.0, 20.0))
    rolled = rolled_distance(ride, TachModel(rail_offset_m=offset), np.array([50.0, 100.0]))
    np.testing.assert_allclose(rolled, np.array([1000.0, 2000.0]) * (300.0 - offset) / 300.0, rtol=1e-12)


def test_there_and_back_through_curves(curved_to_and_fro):
    ride, end = curved_to_and_fro, np.array([_duration(curved_to_and_fro)])
    # 200 m of curve, 50 of them transition: the heading turns by 1 rad.
    turned = ride.line.yaw(np.array(520.0)) - ride.line.yaw(np.array(20.0))
    unsigned = rolled_distance(ride, TachModel(rail_offset_m=0.5), end)
    assert unsigned[0] == pytest.approx(1000.0 - 2 * 0.5 * turned, abs=1e-6)
    assert rolled_distance(ride, TachModel(rail_offset_m=0.5, signed=True), end)[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("signed", [False, True])
def test_a_wheel_on_the_outer_rail_rolls_further_in_every_curve(make_line, signed):
    line = make_line([0, 100, 150, 250, 350, 450, 500, 800], [0, 0, 1 / 250, 1 / 250, -1 / 400, -1 / 400, 0, 0])
    there = run(np.array([600.0]), np.array([12.0]), (0.0, 0.0), Limits(0.7, 0.5))
    ride = Ride(line, motion([*rest(5.0), *there, *rest(5.0), *reverse(there), *rest(5.0)], 20.0))
    s = np.linspace(20.0, 620.0, 600_001)
    bent = np.trapezoid(np.abs(line.curvature(s)), s)
    middle, end = 0.5 * _duration(ride), _duration(ride)
    model = TachModel(outward_offset_m=0.4, signed=signed)
    rolled = rolled_distance(ride, model, np.array([middle, end]))
    expected = [600.0 + 0.4 * bent, 0.0 if signed else 1200.0 + 0.8 * bent]
    np.testing.assert_allclose(rolled, expected, atol=1e-6)


@pytest.mark.parametrize("stamped", [0, 1])
def test_slips_are_in_the_count(to_and_fro, stamped):
    placed = AdhesionModel(top_creep=0.0, events=(WheelSlip(20.0, 5.0, 0.4), WheelSlip(30.0, 5.0, -0.3)))
    slip = draw_slip(to_and_fro, placed, _duration(to_and_fro), np.random.default_rng(0))
    model = TachModel(stamped=stamped)
    tach = pulse_table(to_and_fro, model, 0.98, _duration(to_and_fro), np.random.default_rng(0), slip)
    expected = (1000.0 + slip_table(to_and_fro, model, slip)["distance_error_m"].sum()) / 0.98
    assert tach["distance_m"].iloc[-1] == pytest.approx(expected, abs=1.01 * model.quantum_m)


@pytest.mark.parametrize("stamped", [0, 1])
def test_a_seed_repeats_two_differ_and_a_longer_run_begins_alike(curved_to_and_fro, stamped):
    model = TachModel(stamped=stamped, **EVERYTHING)

    def table(seed, duration):
        return pulse_table(curved_to_and_fro, model, 1.003, duration, np.random.default_rng(seed))

    long = table(1, 100.0)
    assert table(1, 100.0).equals(long)
    assert not table(2, 100.0).equals(long)
    short = table(1, 50.0)[:-1]
    np.testing.assert_allclose(long[: len(short)], short, atol=1e-9)
