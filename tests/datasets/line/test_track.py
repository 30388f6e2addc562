"""The track against finite differences and closed forms."""

import numpy as np
import pytest

from trackfg.datasets.line.irregularities import Irregularities, IrregularityModel, draw_irregularities
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.numerics import rotations

GAUGE_M = 1.067


@pytest.fixture(scope="module")
def rough():
    return draw_irregularities(IrregularityModel("high"), 1500.0, np.random.default_rng(8))


@pytest.fixture
def track(winding_ride, rough):
    """Curves both ways, canted, on gradients, in bad order."""
    return SimulatedTrack(winding_ride.line, rough, GAUGE_M)


S = np.array([50.0, 130.0, 200.0, 330.0, 540.0, 580.3, 730.0, 900.0])


def columns(table):
    return np.moveaxis(table, -1, 0)


def test_perfect_track_is_its_line(winding_ride):
    line = winding_ride.line
    perfect = SimulatedTrack(line, Irregularities.none(line.length_m), GAUGE_M)
    np.testing.assert_allclose(perfect.centre(S), line.position(S), atol=1e-12)
    np.testing.assert_allclose(perfect.rpy(S), line.rpy(S), atol=1e-14)
    np.testing.assert_allclose(perfect.rpy_slopes(S), line.rpy_slopes(S), atol=1e-14)


def test_centre_is_off_the_line_by_level_and_alignment(track):
    level, alignment, _, _ = columns(track.irregularities.at(S))
    off = track.centre(S) - track.line.position(S)
    yaw = track.line.yaw(S)
    np.testing.assert_allclose(off[:, 2], level, atol=1e-12)
    np.testing.assert_allclose(-off[:, 0] * np.sin(yaw) + off[:, 1] * np.cos(yaw), alignment, atol=1e-12)
    np.testing.assert_allclose(off[:, 0] * np.cos(yaw) + off[:, 1] * np.sin(yaw), 0.0, atol=1e-12)


def test_x_axis_is_the_tangent_of_the_centre_line(track):
    step = 1e-3
    tangent = (track.centre(S + step) - track.centre(S - step)) / (2 * step)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    forward = rotations.matrix_from_rpy(*columns(track.rpy(S)))[..., 0]
    np.testing.assert_allclose(forward, tangent, atol=1e-8)


def test_slopes_are_the_derivatives_of_the_attitude(track):
    step = 1e-4
    numeric = (track.rpy(S + step) - track.rpy(S - step)) / (2 * step)
    np.testing.assert_allclose(track.rpy_slopes(S), numeric, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_rails_are_on_the_axle(track, side, sign):
    axle = rotations.matrix_from_rpy(*columns(track.rpy(S)))[..., 1]
    gauge = GAUGE_M + track.irregularities.at(S)[:, 3]
    top = track.rail(S, side) - track.centre(S)
    edge = track.rail(S, side, "edge") - track.centre(S)
    np.testing.assert_allclose(top, sign * 0.5 * track.line.cross_level_base_m * axle, atol=1e-12)
    np.testing.assert_allclose(edge, sign * 0.5 * gauge[:, None] * axle, atol=1e-12)


def test_tops_differ_in_height_by_the_cross_level(track):
    height = track.rail(S, "left")[:, 2] - track.rail(S, "right")[:, 2]
    pitch = track.rpy(S)[:, 1]
    expected = track.line.cant(S) + track.irregularities.at(S)[:, 2]
    np.testing.assert_allclose(track.cross_level(S), expected, atol=1e-15)
    np.testing.assert_allclose(height, expected * np.cos(pitch), atol=1e-12)


def test_heading_deviations_are_those_of_the_paths(track):
    step = 1e-3
    paths = (track.centre, lambda s: track.rail(s, "left", "edge"), lambda s: track.rail(s, "right", "edge"))
    for column, path in enumerate(paths):
        east, north, _ = columns(path(S + step) - path(S - step))
        numeric = np.arctan2(north, east) - track.line.yaw(S)
        np.testing.assert_allclose(track.heading_deviations(S)[:, column], numeric, atol=1e-8)


def test_from_the_other_end_it_is_the_same_track(make_line, rough):
    line = make_line(
        [0, 400, 480, 800, 880, 1500],
        [0, 0, 1 / 300, 1 / 300, 0, 0],
        cant=[0, 0, -0.1, -0.1, 0, 0],
        grade=[0, 0, 0.02, 0.02, 0, 0],
    )
    track = SimulatedTrack(line, rough, GAUGE_M)
    turned = track.reversed()
    s = np.linspace(100.0, 1400.0, 101)
    start = track.centre(np.array(1500.0))
    np.testing.assert_allclose(turned.centre(1500.0 - s), track.centre(s) - start, atol=1e-9)
    np.testing.assert_allclose(turned.rail(1500.0 - s, "left"), track.rail(s, "right") - start, atol=1e-9)
    there, back = (rotations.matrix_from_rpy(*columns(rpy)) for rpy in (track.rpy(s), turned.rpy(1500.0 - s)))
    np.testing.assert_allclose(back, there @ np.diag([-1.0, -1.0, 1.0]), atol=1e-9)
