"""Vehicles: where their bodies are on curves, on waves and at rest."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from trackfg.datasets import tables
from trackfg.datasets.line.irregularities import Irregularities, IrregularityModel, draw_irregularities
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.sensors.inertial_sensor import ideal_samples
from trackfg.datasets.vehicle.flange import Flanging
from trackfg.datasets.vehicle.motion import Limits, change, motion, rest, run
from trackfg.datasets.vehicle.ride import Ride
from trackfg.datasets.vehicle.suspension import Suspension
from trackfg.datasets.vehicle.vehicle import CarBody, Rigid
from trackfg.numerics import units

LEFT, UP, ROLL, PITCH, YAW = range(5)
VEHICLES = [Rigid(), Rigid(1.2), CarBody(), Flanging(Rigid(), seed=1)]
G = units.STANDARD_GRAVITY


def _even(line):
    return SimulatedTrack(line, Irregularities.none(line.length_m), 1.067)


def _wavy(line, wavelength_m, amplitudes):
    """Sines of one wavelength; amplitudes of level, alignment, cross-level and gauge."""
    s = np.arange(0.0, line.length_m + 0.125, 0.125)
    values = np.sin(2 * np.pi * s / wavelength_m)[:, None] * np.array(amplitudes)
    return SimulatedTrack(line, Irregularities(CubicSpline(s, values), line.length_m), 1.067)


@pytest.fixture
def rough_track(winding_ride):
    line = winding_ride.line
    return SimulatedTrack(
        line, draw_irregularities(IrregularityModel(), line.length_m, np.random.default_rng(2)), 1.067
    )


def test_rigid_on_a_circle_is_inside_by_its_versine(make_line):
    radius, w = 100.0, 3.0
    line = make_line([0, 2000], [1 / radius, 1 / radius])
    edges = tables.clock(2.0, 100.0)
    at = Rigid(w).body_motion(_even(line), motion(rest(3.0), 500.0, 10.0), edges).at(edges)
    inside = radius * (1 - np.cos(w / (2 * radius)))
    np.testing.assert_allclose(at, np.broadcast_to([inside, 0, 0, 0, 0], at.shape), atol=1e-8)


def test_rigid_on_a_vertical_curve_is_above_by_its_versine(make_line):
    radius, w = 2000.0, 3.0
    line = make_line([0, 100], [0, 0], grade=[0, 100 / radius])
    edges = tables.clock(2.0, 100.0)
    drive = motion(rest(3.0), 40.0, 10.0)
    at = Rigid(w).body_motion(_even(line), drive, edges).at(edges)
    gamma = line.grade(drive.distance(edges))
    np.testing.assert_allclose(at[:, UP], radius * (1 - np.cos(w / (2 * radius))) * np.cos(gamma), atol=1e-8)
    np.testing.assert_allclose(at[:, [LEFT, ROLL, PITCH, YAW]], 0.0, atol=1e-8)


@pytest.mark.parametrize(("quantity", "place", "turn", "sign"), [(0, UP, PITCH, -1), (1, LEFT, YAW, 1)])
def test_rigid_on_a_wave_sees_the_mean_and_the_chord(make_line, quantity, place, turn, sign):
    wavelength, amplitude, w = 12.0, 4e-3, 2.5
    line = make_line([0, 600], [0, 0])
    edges = tables.clock(5.0, 200.0)
    drive = motion(rest(6.0), 200.0, 15.0)
    track = _wavy(line, wavelength, [amplitude if i == quantity else 0.0 for i in range(4)])
    at = Rigid(w).body_motion(track, drive, edges).at(edges)
    k, s = 2 * np.pi / wavelength, drive.distance(edges)
    np.testing.assert_allclose(at[:, place], amplitude * np.cos(k * w / 2) * np.sin(k * s), atol=1e-8)
    slope = 2 * amplitude * np.sin(k * w / 2) * np.cos(k * s) / w
    np.testing.assert_allclose(at[:, turn], sign * np.arctan(slope), atol=1e-8)


def test_rigid_rolls_with_the_mean_of_its_wheelsets(make_line):
    w, k = 2.5, 2 * np.pi / 12.0
    line = make_line([0, 600], [0, 0])
    edges = tables.clock(5.0, 200.0)
    drive = motion(rest(6.0), 200.0, 15.0)
    at = Rigid(w).body_motion(_wavy(line, 12.0, [0, 0, 5e-3, 0]), drive, edges).at(edges)
    expected = 5e-3 / line.cross_level_base_m * np.cos(k * w / 2) * np.sin(k * drive.distance(edges))
    np.testing.assert_allclose(at[:, ROLL], expected, atol=1e-7)


def test_a_wheelset_is_where_the_track_is(winding_ride, rough_track):
    edges = tables.clock(60.0, 200.0)
    ride = Ride(
        rough_track.line, winding_ride.motion, body=Rigid().body_motion(rough_track, winding_ride.motion, edges)
    )
    s = ride.motion.distance(edges)
    np.testing.assert_allclose(ride.rpy(edges), rough_track.rpy(s), atol=1e-9)
    np.testing.assert_allclose(ride.position(edges) + ride.origin, rough_track.centre(s), atol=2e-8)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_at_rest_on_level_track_it_measures_gravity(make_line, vehicle):
    line = make_line([0, 200], [0, 0])
    edges = tables.clock(5.0, 200.0)
    drive = motion(rest(5.0), 100.0)
    ride = Ride(line, drive, body=vehicle.body_motion(_even(line), drive, edges))
    gyro, accel = ideal_samples(ride, edges, None)
    np.testing.assert_allclose(gyro, 0.0, atol=1e-9)
    np.testing.assert_allclose(accel, np.broadcast_to([0, 0, G], accel.shape), atol=1e-7)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_after_a_stop_it_comes_to_rest(winding_ride, rough_track, vehicle):
    limits = Limits(0.7, 0.5)
    drive = motion([*change(0.0, 15.0, limits), *rest(10.0), *change(15.0, 0.0, limits), *rest(60.0)], 50.0)
    edges = tables.clock(drive.duration_s, 100.0)
    ride = Ride(rough_track.line, drive, body=vehicle.body_motion(rough_track, drive, edges))
    gyro, accel = ideal_samples(ride, edges, None)
    still = edges[1:] > drive.duration_s - 10.0
    assert np.abs(gyro[still]).max() < 1e-8
    np.testing.assert_allclose(np.linalg.norm(accel[still], axis=1), G, atol=1e-6)


def test_coach_coasting_over_a_wave_swings_as_its_gain(make_line):
    wavelength, v, amplitude = 40.0, 25.0, 5e-3
    line = make_line([0, 3000], [0, 0])
    edges = tables.clock(60.0, 200.0)
    drive = motion(rest(61.0), 200.0, v)
    track = _wavy(line, wavelength, [amplitude, 0, 0, 0])
    suspension = Suspension()
    phases = np.exp(2j * np.pi * np.array(suspension.axles_m) / wavelength)
    gain = suspension.vertical.gain(np.array([v / wavelength]), phases)[0]
    late, lag = edges > 40.0, 2 * np.pi * drive.distance(edges) / wavelength
    body = CarBody().body_motion(track, drive, edges).at(edges)
    expected = amplitude * (gain[:, None] * np.exp(1j * lag)).imag
    np.testing.assert_allclose(body[late, UP], expected[0, late], atol=2e-6)
    np.testing.assert_allclose(body[late, PITCH], -expected[1, late], atol=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_coach_in_a_curve_is_inside_slides_and_leans_outwards(make_line, side):
    radius, v, cant = 400.0, 15.0, 0.02
    line = make_line([0, 3000], [side / radius] * 2, cant=[-side * cant] * 2)
    edges = tables.clock(5.0, 200.0)
    drive = motion(rest(6.0), 500.0, v)
    at = CarBody().body_motion(_even(line), drive, edges).at(edges)
    suspension = Suspension()
    tilt = np.arcsin(cant / line.cross_level_base_m)
    deficiency = v * v / radius - G * tilt
    inside = (suspension.half_pivot_m**2 + suspension.half_wheelbase_m**2) / (2 * radius)
    body, frame = suspension.body_mass_kg, suspension.bogie_mass_kg
    slide = deficiency * (body / (2 * suspension.secondary_lateral[0]))
    slide += deficiency * (body + 2 * frame) / (4 * suspension.primary_lateral[0])
    lean = suspension.roll_coefficient * deficiency / G
    expected = np.array([side * (inside - slide), 0, side * lean, 0, 0])
    np.testing.assert_allclose(at, np.broadcast_to(expected, at.shape), atol=2e-5)


def test_springs_need_even_spacing(make_line):
    line = make_line([0, 200], [0, 0])
    edges = np.array([0.0, 0.01, 0.02, 0.05, 0.06])
    with pytest.raises(ValueError, match="evenly spaced"):
        CarBody().body_motion(_even(line), motion(rest(5.0), 100.0), edges)


def test_knocks_come_in_sharp_curves_alone_and_belong_to_the_place(make_line):
    line = make_line([0, 300, 301, 600, 601, 1200], [0, 0, 1 / 200, 1 / 200, -1 / 1000, -1 / 1000])
    limits = Limits(0.5, 0.5)
    there = run(np.array([1000.0]), np.array([15.0]), (0.0, 0.0), limits)
    drive = motion(there, 100.0)
    edges = tables.clock(drive.duration_s, 200.0)
    plain = Rigid().body_motion(_even(line), drive, edges).at(edges)
    knocked = [Flanging(Rigid(), seed).body_motion(_even(line), drive, edges).at(edges) - plain for seed in (5, 5, 6)]
    s = drive.distance(edges)
    sharp = (s > 302) & (s < 599)
    assert np.abs(knocked[0][(s < 299) | (s > 602)]).max() < 1e-9
    assert knocked[0][sharp, LEFT].min() >= -1e-9
    assert 0.4e-3 < knocked[0][sharp, LEFT].max() < 0.8e-3
    np.testing.assert_array_equal(knocked[0], knocked[1])
    assert np.abs(knocked[0] - knocked[2]).max() > 1e-4
    # One in every 20 m of 300 m.
    starts = np.diff((knocked[0][:, LEFT] > 1e-5).astype(int)) > 0
    assert starts.sum() == pytest.approx(15, abs=1)
