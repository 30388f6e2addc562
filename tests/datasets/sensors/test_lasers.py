"""Displacement sensors see the rails where they are."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq

from trackfg.datasets.line.irregularities import Irregularities, IrregularityModel, draw_irregularities
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.sensors.lasers import LaserModel, laser_description, laser_tables, two_units
from trackfg.datasets.vehicle.motion import motion, rest
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.rotations import matrix_from_rpy

BASE_M, GAUGE_M = 1.067, 1.0
UNITS = two_units(5.0, -4.0, 0.6, 0.4, rate_hz=20.0)


@dataclass(frozen=True)
class TiltedRide(Ride):
    """A body that is turned against the track by a fixed rotation."""

    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def rotation(self, t):
        return super().rotation(t) @ matrix_from_rpy(*self.tilt)


def _perfect(line):
    return SimulatedTrack(line, Irregularities.none(line.length_m), GAUGE_M)


def _exact(ride, track, models=UNITS, duration_s=10.0):
    tables = laser_tables(ride, track, models, duration_s, None)
    return {name: table["displacement_m"].to_numpy() for name, table in tables.items()}


def test_two_units_are_eight_sensors():
    assert [model.name for model in UNITS] == [
        f"{unit}-{side}-{axis}"
        for unit in "AB"
        for side in ("left", "right")
        for axis in ("vertical", "lateral")
    ]  # fmt: skip
    by_name = {model.name: model for model in UNITS}
    right = by_name["B-right-lateral"]
    assert (right.position_m, right.axis, right.rail, right.line) == ((-4.0, -0.6, 0.4), "y", "right", "edge")
    assert by_name["A-left-vertical"].line == "top"


def test_on_straight_track_with_a_known_tilt(make_line):
    tilt = (0.03, -0.02, 0.015)
    line = make_line([0, 1000], [0, 0])
    ride = TiltedRide(line, motion(rest(20.0), 100.0, 15.0), tilt=tilt)
    R = matrix_from_rpy(*tilt)
    found = _exact(ride, _perfect(line))
    for model in UNITS:
        sensor = R @ model.position_m
        side = 1.0 if model.rail == "left" else -1.0
        y = 0.5 * side * (BASE_M if model.axis == "z" else GAUGE_M)
        # The rail is (x, y, 0); its point with (rail - sensor) across the body's x axis.
        ahead, across = R[:, 0], R[:, "xyz".index(model.axis)]
        x = sensor[0] - (ahead[1] * (y - sensor[1]) + ahead[2] * (0.0 - sensor[2])) / ahead[0]
        expected = across @ (np.array([x, y, 0.0]) - sensor)
        np.testing.assert_allclose(found[model.name], expected, atol=1e-11)


def test_on_a_circle(make_line):
    radius = 200.0
    line = make_line([0, 1000], [1 / radius, 1 / radius])
    ride = Ride(line, motion(rest(20.0), 100.0, 15.0))
    found = _exact(ride, _perfect(line))
    for model in UNITS:
        x, y, z = model.position_m
        side = 1.0 if model.rail == "left" else -1.0
        if model.axis == "z":
            np.testing.assert_allclose(found[model.name], -z, atol=1e-9)
        else:
            own = radius - 0.5 * side * GAUGE_M
            np.testing.assert_allclose(found[model.name], radius - np.sqrt(own**2 - x**2) - y, atol=1e-9)


def test_on_rough_track_it_is_the_rail_in_the_sensors_plane(winding_ride):
    line = winding_ride.line
    rough = IrregularityModel("high", 1.5e-3, 1.5e-3, 1.5e-3, 1.0e-3)
    track = SimulatedTrack(line, draw_irregularities(rough, line.length_m, np.random.default_rng(0)), GAUGE_M)
    ride = TiltedRide(line, winding_ride.motion, tilt=(0.02, 0.01, -0.02))
    units = two_units(8.0, -8.0, 0.6, 0.4, rate_hz=1.0)
    found = _exact(ride, track, units, 100.0)
    t = np.arange(101.0)
    R, place = ride.rotation(t), ride.position(t) + ride.origin
    for model in units:
        sensor = place + R @ np.array(model.position_m)
        for k in range(20, 101, 9):

            def seen(s, k=k, model=model, sensor=sensor):
                return R[k].T @ (track.rail(np.array([s]), model.rail, model.line)[0] - sensor[k])

            about = ride.motion.distance(t[k]) + model.position_m[0]
            s = brentq(lambda s, seen=seen: seen(s)[0], about - 2.0, about + 2.0, xtol=1e-13)
            assert found[model.name][k] == pytest.approx(seen(s)["xyz".index(model.axis)], abs=1e-6)


def test_irregularities_come_out_in_both_units(make_line):
    line = make_line([0, 2000], [0, 0])
    track = SimulatedTrack(
        line, draw_irregularities(IrregularityModel("high"), 2000.0, np.random.default_rng(1)), GAUGE_M
    )
    ride = Ride(line, motion(rest(60.0), 100.0, 9.0))
    found = _exact(ride, track, duration_s=60.0)
    # The body follows the designed line, and unit B passes a second after A.
    for rail in ("left", "right"):
        for axis in ("vertical", "lateral"):
            a, b = found[f"A-{rail}-{axis}"], found[f"B-{rail}-{axis}"]
            np.testing.assert_allclose(a[:-20], b[20:], atol=1e-9)
            assert a.std() > 1e-4


@pytest.fixture
def straight(make_line):
    line = make_line([0, 4000], [0, 0])
    return Ride(line, motion(rest(200.0), 100.0, 10.0)), _perfect(line)


def test_noise_and_offset_have_their_sigmas(straight):
    ride, track = straight
    models = two_units(5.0, -4.0, 0.6, 0.4, rate_hz=20.0, noise_sd_m=2e-4, offset_sd_m=1e-3)
    exact = _exact(ride, track, models, 100.0)
    means, residuals = [], []
    for seed in range(20):
        for name, table in laser_tables(ride, track, models, 100.0, np.random.default_rng(seed)).items():
            error = table["displacement_m"] - exact[name]
            means.append(error.mean())
            residuals.append(error - error.mean())
    assert np.std(means) == pytest.approx(1e-3, rel=0.2)
    assert np.std(residuals) == pytest.approx(2e-4, rel=0.01)
    correlation = np.corrcoef(residuals[:8])
    assert np.abs(correlation - np.eye(8)).max() < 0.1


def test_quantisation_is_exact(straight):
    ride, track = straight
    fine = LaserModel("a", (5.0, 0.6, 0.4), "z", "left", noise_sd_m=1e-3)
    coarse = replace(fine, quantum_m=1e-4)
    smooth, rounded = (
        laser_tables(ride, track, [model], 10.0, np.random.default_rng(0))["a"]["displacement_m"]
        for model in (fine, coarse)
    )
    np.testing.assert_array_equal(rounded, np.rint(smooth / 1e-4) * 1e-4)
    assert coarse.sd_m == pytest.approx(np.hypot(1e-3, 1e-4 / np.sqrt(12)))


def test_sensors_may_have_rates_of_their_own(straight):
    ride, track = straight
    slow = replace(UNITS[0], name="slow", rate_hz=5.0)
    tables = laser_tables(ride, track, [slow, *UNITS], 10.0, np.random.default_rng(0))
    assert list(tables) == ["slow", *(model.name for model in UNITS)]
    assert len(tables["slow"]) == 51
    assert {len(tables[model.name]) for model in UNITS} == {201}
    assert laser_tables(ride, track, [], 10.0, np.random.default_rng(0)) == {}


def test_a_seed_repeats_two_differ_and_a_longer_run_begins_alike(straight):
    ride, track = straight
    models = two_units(5.0, -4.0, 0.6, 0.4, rate_hz=20.0, offset_sd_m=1e-3)

    def table(seed, duration):
        return laser_tables(ride, track, models, duration, np.random.default_rng(seed))["B-left-vertical"]

    long = table(1, 20.0)
    assert table(1, 20.0).equals(long)
    assert not table(2, 20.0).equals(long)
    np.testing.assert_allclose(long[:201], table(1, 10.0), atol=1e-11)


def test_a_description_says_where_it_is():
    described = laser_description(UNITS[3])
    assert described.name == "A-right-lateral"
    assert described.position_m == (5.0, -0.6, 0.4)
    assert (described.axis, described.rail, described.sd_m) == ("y", "right", 1e-4)
    assert (described.time, described.column, described.unit) == ("t_s", "displacement_m", "m")
