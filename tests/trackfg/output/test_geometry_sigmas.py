"""Sigmas of the geometry table, and the tilt of two rails, worked out by hand on a straight level run."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.config import GeometryConfig
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Nav, Odo, States
from trackfg.geometry.curvature import heading_walk
from trackfg.graph.inputs import World
from trackfg.graph.run_context import RunContext
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.profile_samples import Points
from trackfg.output.profiles import Profile, Shapes, View, rows_between_draws
from trackfg.output.rail_profiles import rail_profiles
from trackfg.output.track_geometry import geometry_table
from trackfg.recording.description import Laser
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.displacement import Channel, RailView, Side
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.solver.covariance import Covariance
from trackfg.solver.square_root import SquareRoot

STEP_M, INTERVAL_S, SPEED_MPS = 0.25, 2.0, 10.0
GAUGE_M, BASE_M = 1.0, 1.5
LENGTH_M = 800.0
KEYFRAMES = round(LENGTH_M / SPEED_MPS / INTERVAL_S) + 1
MEANING = GeometryConventions(gauge_m=GAUGE_M, cross_level_base_m=BASE_M, **GeometryConfig(step_m=STEP_M).model_dump())
GYRO_WHITE = 1e-4
READING_SD_M = 2e-4


def straight_run() -> States:
    """Keyframes every 20 m along e1."""
    t = INTERVAL_S * np.arange(KEYFRAMES)
    along = np.stack([SPEED_MPS * t, 0.0 * t, 0.0 * t], axis=1)
    nav = Nav(np.tile(np.eye(3), (KEYFRAMES, 1, 1)), along, np.tile([SPEED_MPS, 0.0, 0.0], (KEYFRAMES, 1)))
    odo = Odo.of(along[:, 0], np.ones(KEYFRAMES), along[:, 0], np.gradient(along[:, 0]))
    return States(nav, np.zeros((KEYFRAMES, 6)), odo, np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))


def context(gyro: float = 1e-12, direction: int = 1) -> RunContext:
    """Of the straight run, by an inertial sensor at the reference point with this white noise."""
    t = INTERVAL_S * np.arange(KEYFRAMES)
    samples = Intervals(t, *np.zeros((2, KEYFRAMES - 1, 3)), np.zeros(KEYFRAMES - 1, dtype=bool))
    return RunContext(
        t=t,
        edges=np.arange(KEYFRAMES),
        inertial=samples,
        world=World(9.8, np.zeros(3), 0.0),
        lever_arm=np.zeros(3),
        noise=WhiteNoise.alike(gyro, 1e-12, KEYFRAMES - 1),
        mount_roll_sd=0.0,
        direction=direction,
        conventions=MEANING,
    )


def table_of(sides: tuple[Side, ...] = (), gyro: float = 1e-12, ahead_m: float = 0.0) -> pd.DataFrame:
    """The geometry of the straight run with keyframes that are known exactly, from the vehicle's own path or from
    rails that sensors ``ahead_m`` of the gyro see with the white noise READING_SD_M on every step.
    """
    cell = np.arange(round(LENGTH_M / STEP_M))
    n = len(cell)
    when = cell * STEP_M / SPEED_MPS / INTERVAL_S
    keyframe = when.astype(np.int64)
    left = np.tile([0.0, 1.0, 0.0], (n, 1))
    every = rows_between_draws(MEANING, keyframe)
    points = Points(keyframe, when - keyframe, left, left, np.tile([-ahead_m, 0.0, 0.0], (n, 1)))[::every]
    zero, silent = np.zeros(n), np.zeros(len(points.fraction))
    noise = np.full_like(silent, READING_SD_M)
    shapes = Shapes(zero, zero, zero, zero, dict.fromkeys(sides, (zero, zero)), zero if sides else None)
    views = tuple(View(side, points, noise, noise, walk=heading_walk(STEP_M)) for side in sides) or (
        View(None, points, silent, silent),
    )
    profile = Profile(cell, keyframe, when - keyframe, np.full(n, SPEED_MPS), shapes, views, every)
    size = KEYFRAME_DIM + SHARED_DIM
    exact = SquareRoot(
        np.tile(1e9 * np.eye(KEYFRAME_DIM), (KEYFRAMES, 1, 1)),
        np.zeros((KEYFRAMES, KEYFRAME_DIM, size)),
        np.zeros((KEYFRAMES, KEYFRAME_DIM)),
        1e9 * np.eye(SHARED_DIM),
        np.zeros(SHARED_DIM),
        np.zeros(KEYFRAMES, dtype=np.int64),
    )
    shared = size - KEYFRAME_DIM
    covariance = Covariance(
        np.zeros((KEYFRAMES, KEYFRAME_DIM, size)), np.zeros((shared, shared)), np.zeros((KEYFRAMES - 1, size, size))
    )
    return geometry_table(context(gyro), [profile], straight_run(), covariance, exact)


def test_cross_level_between_exact_keyframes_is_a_bridge() -> None:
    """The gyro's white noise N, held at both ends of an interval T, leaves the roll N sqrt(T f (1 - f)): nothing at a
    keyframe, 1e-4 sqrt(2 / 4) = 0.071 mrad in the middle, which over a base of 1.5 m are 0.106 mm.
    """
    table = table_of(gyro=GYRO_WHITE)
    f = np.mod(table["chainage_m"].to_numpy() / (SPEED_MPS * INTERVAL_S), 1.0)
    expected = 1e3 * BASE_M * GYRO_WHITE * np.sqrt(INTERVAL_S * f * (1.0 - f))
    np.testing.assert_allclose(table["cross_level_mm_sd"], expected, atol=1e-9)
    assert table["cross_level_mm_sd"].max() == pytest.approx(0.1061, abs=1e-4)


def test_tilt_between_the_rails_is_over_the_gauge() -> None:
    """Each rail's height errs by 0.2 mm, so their difference by 0.2 sqrt(2) mm over the gauge of 1 m, and the
    cross-level, which is that slope over a base of 1.5 m, by 0.2 sqrt(2) 1.5 = 0.424 mm. The twist over its base is
    the difference of two of them: 0.424 sqrt(2) = 0.6 mm.
    """
    table = table_of(("left", "right"))
    cross_level = 1e3 * READING_SD_M * np.sqrt(2.0) * BASE_M / GAUGE_M
    assert table["cross_level_mm_sd"].median() == pytest.approx(cross_level, rel=0.03)
    assert table["twist_mm_sd"].median() == pytest.approx(cross_level * np.sqrt(2.0), rel=0.03)


def test_the_gyro_turns_units_far_ahead_within_the_fitted_slope() -> None:
    """A unit 6 m ahead of a gyro with the white noise N moves across by a random walk of 6 N / sqrt(speed) per root of
    a metre. The slope fitted to it has 1.10 of that, and the curvature two such slopes over 10 m: 3.0e-5 1/m.
    """
    table = table_of(("left", "right"), gyro=GYRO_WHITE, ahead_m=6.0)
    walk = heading_walk(STEP_M) * 6.0 * GYRO_WHITE / np.sqrt(SPEED_MPS)
    expected = np.sqrt(2.0) * walk / MEANING.curvature_base_m
    assert expected == pytest.approx(3.0e-5, abs=0.1e-5)
    assert table["curvature_1pm_sd"].median() == pytest.approx(expected, rel=0.1)


def test_both_rails_under_one_unit_turn_alike() -> None:
    """What the gyro's noise lifts a unit 6 m ahead lifts both rails: their difference has the readings' noise alone."""
    still, turned = (table_of(("left", "right"), gyro, ahead_m=6.0) for gyro in (1e-12, GYRO_WHITE))
    assert turned["level_mm_sd"].median() > 1.5 * still["level_mm_sd"].median()
    for quantity in ("cross_level_mm_sd", "twist_mm_sd"):
        assert turned[quantity].median() == pytest.approx(still[quantity].median(), rel=0.03)


def test_band_keeps_its_share_of_white_noise_however_far_apart_it_is_drawn() -> None:
    """White noise s on every step h is spread evenly over the wave numbers up to 1 / (2 h). A band from B1 to B2 whose
    gain is that of the fourth order run both ways, 1 / (1 + u^8), keeps ``2 h (B2 - B1)`` times the integral of
    (1 + u^8)^-2, which is 7/8 (pi / 8) / sin(pi / 8) = 0.898: from 3 to 25 m 0.132 of the variance, 0.073 mm of 0.2 mm.
    The mean of both rails has it by sqrt(2) less.
    """
    table = table_of(("left", "right"))
    shortest, longest = MEANING.band_m
    order = 0.875 * (np.pi / 8.0) / np.sin(np.pi / 8.0)
    expected = 1e3 * READING_SD_M * np.sqrt(2.0 * STEP_M * (1.0 / shortest - 1.0 / longest) * order)
    assert expected == pytest.approx(0.073, abs=0.001)
    assert table["level_left_mm_sd"].median() == pytest.approx(expected, rel=0.05)
    assert table["alignment_right_mm_sd"].median() == pytest.approx(expected, rel=0.05)
    assert table["level_mm_sd"].median() == pytest.approx(expected / np.sqrt(2.0), rel=0.05)


def seen(side: Side, y: float, z: float) -> RailView:
    """A rail 0.6 m below a unit at the reference point: sensors that always read the same."""
    t = np.linspace(-1.0, INTERVAL_S * KEYFRAMES, 4001)

    def channel(axis: str, position: float, reading: float) -> Channel:
        place = {"y": (0.0, position, 0.0), "z": (0.0, y, position)}[axis]
        laser = Laser.model_validate(
            {
                "file": "laser.csv",
                "column": axis,
                "name": f"{side}-{axis}",
                "position_m": place,
                "axis": axis,
                "rail": side,
                "sd_m": 1e-4,
            }
        )
        return Channel(laser, t, np.full(t.size, reading), reading * (t - t[0]))

    return RailView(side, 0.0, channel("y", y, 0.0), channel("z", 0.1, z - 0.1))


@pytest.mark.parametrize(("direction", "sign"), [(1, 1.0), (-1, -1.0)], ids=["up the line", "down the line"])
def test_the_left_rail_up_is_positive_facing_increasing_chainage(direction: int, sign: float) -> None:
    """Rails 1.2 m apart across and 0.5 m in height, the left one up: the gauge along the slope is 1.3 m, the sine of
    the roll 0.5 / 1.3. Down the line the vehicle's left rail is the right one.
    """
    states, run = straight_run(), context(direction=direction)
    t = np.linspace(0.0, run.t[-1], 50 * (KEYFRAMES - 1) + 1)
    n, along = len(t), np.stack([SPEED_MPS * t, 0.0 * t, 0.0 * t], axis=1)
    nav = Nav(np.tile(np.eye(3), (n, 1, 1)), along, np.tile([SPEED_MPS, 0.0, 0.0], (n, 1)))
    k = np.minimum((t / INTERVAL_S).astype(np.int64), KEYFRAMES - 2)
    motion = DenseMotion(t, nav, along[:, 0], np.zeros((n, 3)), np.full(n, 0.04), k, t / INTERVAL_S - k, np.eye(3)[0])
    views = [seen("left", 0.6, -0.35), seen("right", -0.6, -0.85)]
    (profile,) = rail_profiles(run, motion, states, views)
    shapes = profile.shapes
    assert shapes.gauge is not None
    middle = slice(40, -40)
    np.testing.assert_allclose(shapes.gauge[middle], 1.3, atol=1e-6)
    np.testing.assert_allclose(shapes.tilt[middle], sign * 0.5 / 1.3, atol=1e-6)
    high, low = ("left", "right") if direction > 0 else ("right", "left")
    np.testing.assert_allclose(shapes.rails[high][0][middle], -0.35, atol=1e-6)
    np.testing.assert_allclose(shapes.rails[low][0][middle], -0.85, atol=1e-6)
