"""Drivers keep to the line, its limits and their own ranges, and a longer drive begins as a shorter one."""

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.vehicle.driving import Parked, Service, Shunting, SpeedRestrictions, Wandering
from trackfg.datasets.vehicle.motion import Limits
from trackfg.errors import BadInputError

LIMITS = Limits(acceleration_mps2=0.7, jerk_mps3=0.5)
SERVICE = Service(LIMITS, fastest_mps=25.0, start_m=50.0, start_rest_s=30.0, dwell_s=(20.0, 40.0))
WANDERING = Wandering(LIMITS, speed_mps=(5.0, 15.0), hold_s=(5.0, 20.0), start_rest_s=10.0, start_m=5.0)
SHUNTING = Shunting(
    LIMITS, speed_mps=(3.0, 7.0), near_m=20.0, far_m=600.0, shortest_m=80.0, start_rest_s=20.0, dwell_s=(10.0, 20.0)
)
RESTRICTIONS = SpeedRestrictions(per_km=2.0, speed_mps=(3.0, 8.0), length_m=(50.0, 200.0))
DRIVERS = (SERVICE, replace(SERVICE, hurry=(0.6, 1.0), restrictions=RESTRICTIONS), WANDERING, SHUNTING, Parked(50.0))


@pytest.fixture
def line(make_line):
    """12 km with stations; 20 m/s, 12 m/s between 2 and 3 km, and then more than the trains can."""
    plain = make_line([0, 12_000], [0, 0], stations=[10.0, 1500.0, 4000.0, 9000.0])
    return replace(plain, limit_from_m=np.array([0.0, 2000.0, 3000.0]), limit_mps=np.array([20.0, 12.0, 40.0]))


def drive(driver, line, duration_s, seed=0):
    return driver.drive(line, duration_s, np.random.default_rng(seed))


def stops(motion, duration_s):
    """Places of rest, in order, each once."""
    t = np.arange(0.0, duration_s, 0.1)
    s = motion.distance(t[motion.speed(t) == 0.0])
    return s[np.append(True, np.abs(np.diff(s)) > 1e-6)]


def test_a_service_stops_at_stations_and_before_the_end(line):
    done = drive(SERVICE, line, 1200.0)
    np.testing.assert_allclose(stops(done, 1200.0), [50.0, 1500.0, 4000.0, 9000.0, 11_950.0], atol=1e-6)
    assert done.duration_s >= 1200.0
    assert done.speed(29.9) == 0.0
    assert done.speed(31.0) > 0.0


def test_a_service_keeps_to_the_limits_and_is_as_fast_as_they_let(line):
    done = drive(SERVICE, line, 1200.0)
    t = np.linspace(0.0, 1200.0, 50_001)
    s, v = done.distance(t), done.speed(t)
    for low, high, limit in ((0, 2000, 20.0), (2000, 3000, 12.0), (3000, 12_000, 25.0)):
        inside = (s > low + 1e-3) & (s < high - 1e-3)
        assert v[inside].max() == pytest.approx(limit, abs=1e-6)
    assert np.abs(done.acceleration(t)).max() <= LIMITS.acceleration_mps2 + 1e-9


def test_hurry_is_a_factor_on_every_limit(line):
    slow = drive(replace(SERVICE, hurry=(0.5, 0.5)), line, 1500.0)
    assert slow.speed(np.linspace(0.0, 1500.0, 20_001)).max() == pytest.approx(12.5, abs=1e-6)


def test_restrictions_are_as_many_and_as_slow_as_asked(make_line):
    line = make_line([0, 1_000_000], [0, 0])
    restricted = RESTRICTIONS.impose(line, np.random.default_rng(1))
    slow = restricted.limit_mps < 30.0
    # The distance from one to the next is 500 m and its own length, 125 m, on average.
    assert slow.sum() == pytest.approx(1_000_000 / 625.0, rel=0.08)
    assert np.all((restricted.limit_mps[slow] >= 3.0) & (restricted.limit_mps[slow] <= 8.0))
    lengths = np.diff(restricted.limit_from_m)[slow[:-1]]
    assert np.all((lengths >= 50.0 - 1e-6) & (lengths <= 200.0 + 1e-6))


def test_a_restriction_does_not_raise_a_limit(make_line):
    line = replace(make_line([0, 50_000], [0, 0]), limit_mps=np.array([5.0]))
    assert RESTRICTIONS.impose(line, np.random.default_rng(1)).limit_mps.max() == 5.0


def test_a_wanderer_rests_and_then_stays_within_its_speeds(line):
    done = drive(WANDERING, line, 500.0)
    assert np.all(done.speed(np.linspace(0.0, 9.9, 100)) == 0.0)
    v = done.speed(np.linspace(50.0, 500.0, 5000))
    assert 5.0 - 1e-9 <= v.min() < v.max() <= 15.0 + 1e-9
    under_way = drive(replace(WANDERING, start_rest_s=0.0), line, 500.0)
    assert 5.0 <= under_way.speed(0.0) <= 15.0


def test_shunting_goes_to_and_fro_between_its_ends(line):
    done = drive(SHUNTING, line, 1500.0)
    t = np.linspace(0.0, 1500.0, 20_001)
    assert done.distance(t).min() >= 20.0 - 1e-6
    assert done.distance(t).max() <= 600.0 + 1e-6
    assert np.abs(done.speed(t)).max() <= 7.0 + 1e-6
    legs = np.diff(stops(done, 1500.0))
    assert (legs > 0).any()
    assert (legs < 0).any()


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_longer_drive_begins_as_a_shorter_one(driver, line):
    short, long = drive(driver, line, 200.0, seed=3), drive(driver, line, 700.0, seed=3)
    assert short.duration_s >= 200.0
    t = np.linspace(0.0, 200.0, 4001)
    np.testing.assert_allclose(short.distance(t), long.distance(t), atol=1e-9)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_drive_repeats_and_ends_at_rest_or_at_constant_speed(driver, line):
    first, again = (drive(driver, line, 300.0, seed=5) for _ in range(2))
    assert np.array_equal(first.distance.c, again.distance.c)
    assert float(first.acceleration(first.duration_s)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_line_too_short_is_refused(driver, make_line):
    with pytest.raises(BadInputError, match=r"the line is 40 m long: expected .* m or more, or a shorter run"):
        drive(driver, make_line([0, 40], [0, 0]), 300.0)


@pytest.mark.parametrize("driver", DRIVERS)
def test_furthest_is_far_enough(driver, make_line):
    line = make_line([0, driver.furthest_m(400.0)], [0, 0])
    for seed in range(10):
        done = drive(driver, line, 400.0, seed=seed)
        assert done.distance(np.linspace(0.0, 400.0, 1000)).max() <= line.length_m
