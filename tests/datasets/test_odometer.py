"""The tachometer's counts add up."""

import numpy as np
import pytest

from trackfg.datasets.motion import Limits, motion, rest, reverse, run
from trackfg.datasets.odometer import TachModel, draw_scale, ideal_table, pulse_table
from trackfg.datasets.ride import Ride


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
