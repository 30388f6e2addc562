"""Motions: exact derivatives, limits kept, places met."""

import numpy as np
import pytest

from trackfg.datasets.vehicle.motion import Limits, change, change_distance, change_time, motion, rest, reverse, run

LIMITS = Limits(acceleration_mps2=0.7, jerk_mps3=0.5)


@pytest.mark.parametrize(("v1", "v2"), [(0.0, 20.0), (20.0, 0.0), (5.0, 5.4), (3.0, 3.0)])
def test_change_of_speed_takes_its_time_and_distance(v1, v2):
    done = motion([*change(v1, v2, LIMITS), *rest(1.0)], 0.0, v1)
    time = change_time(v1, v2, LIMITS) if v1 != v2 else 0.0
    assert done.duration_s == pytest.approx(time + 1.0)
    assert done.speed(time) == pytest.approx(v2, abs=1e-9)
    assert done.acceleration(time + 0.5) == pytest.approx(0.0, abs=1e-9)
    distance = change_distance(v1, v2, LIMITS) if v1 != v2 else 0.0
    assert done.distance(time) == pytest.approx(distance, abs=1e-9)


def test_run_ends_where_it_should_within_every_limit():
    lengths = np.array([800.0, 300.0, 60.0, 1500.0, 400.0])
    limits = np.array([26.0, 15.0, 22.0, 26.0, 10.0])
    done = motion(run(lengths, limits, (0.0, 0.0), LIMITS), 100.0)
    assert done.distance(done.duration_s) == pytest.approx(100.0 + lengths.sum(), abs=1e-6)
    assert done.speed(done.duration_s) == pytest.approx(0.0, abs=1e-6)
    t = np.linspace(0, done.duration_s, 20_001)
    assert np.abs(done.acceleration(t)).max() <= LIMITS.acceleration_mps2 + 1e-9
    assert np.abs(np.diff(done.acceleration(t))).max() <= LIMITS.jerk_mps3 * t[1] + 1e-9
    where = np.searchsorted(np.cumsum(lengths), done.distance(t) - 100.0 - 1e-6)
    assert np.all(done.speed(t) <= limits[np.minimum(where, 4)] + 1e-6)
    assert done.speed(t).max() == pytest.approx(26.0)


def test_run_refuses_what_cannot_be_done():
    with pytest.raises(ValueError, match="cannot go from"):
        run(np.array([5.0]), np.array([20.0]), (20.0, 0.0), LIMITS)


def test_speed_and_acceleration_are_the_derivatives(winding_ride):
    done = winding_ride.motion
    t = np.linspace(1, 119, 500)
    step = 1e-4
    np.testing.assert_allclose(
        done.speed(t), (done.distance(t + step) - done.distance(t - step)) / (2 * step), atol=1e-6
    )
    np.testing.assert_allclose(
        done.acceleration(t), (done.speed(t + step) - done.speed(t - step)) / (2 * step), atol=1e-4
    )


def _to_and_fro():
    leg = run(np.array([100.0]), np.array([5.0]), (0.0, 0.0), LIMITS)
    return motion([*rest(5.0), *leg, *rest(3.0), *reverse(leg), *rest(2.0), *leg], 10.0)


def test_path_grows_whichever_way():
    done = _to_and_fro()
    t = np.linspace(0, done.duration_s, 5001)
    assert np.all(np.diff(done.path(t)) >= -1e-9)
    assert done.path(done.duration_s) == pytest.approx(300.0, abs=1e-6)
    np.testing.assert_allclose(np.abs(np.diff(done.distance(t))).sum(), 300.0, atol=1e-3)


def test_rest_is_exactly_at_rest():
    done = _to_and_fro()
    assert np.all(done.speed(np.linspace(0.1, 4.9, 20)) == 0.0)
    speed = done.speed(done.breaks_s)
    assert np.sum(np.abs(speed) < 1e-6) >= 6


def test_every_passage_is_found():
    done = _to_and_fro()
    places = np.array([60.0, 30.0, 500.0])
    times, which = done.times_at(places)
    np.testing.assert_allclose(done.distance(times), places[which], atol=1e-9)
    assert np.all(np.diff(times) > 0)
    assert which.tolist() == [1, 0, 0, 1, 1, 0]
