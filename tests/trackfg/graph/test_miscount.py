"""A count that misses pulses, by the accelerometer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg import SmoothConfig, smooth
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.wheel import MiscountedPulses
from trackfg.datasets.scenarios import simulate
from trackfg.factors.factor_type import FactorType
from trackfg.graph import build_problem
from trackfg.graph.miscount import with_miscount
from trackfg.numerics.arrays import Array
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.tach import Wheel

PULSE_M, DURATION_S, GRAVITY = 0.03, 400.0, 9.81


def density(share: float, pulse_m: float = PULSE_M) -> float:
    """Errors of a count of which a share is missed, and as much counted twice: a pulse has the variance 2 p (1 - p)."""
    return float(np.sqrt(2.0 * share * (1.0 - share) * pulse_m))


def distance(t: Array) -> Array:
    """At 9 to 15 m/s, with accelerations up to 0.3 m/s^2."""
    return 12.0 * t + 30.0 * (1.0 - np.cos(0.1 * t))


def miscounted(distance_m: Array, share: float, pulse_m: float, seed: int = 0) -> Array:
    """Return the distances (n,) of a count of which a share is missed, and as much counted twice."""
    pulses = np.diff(np.rint(distance_m / pulse_m).astype(int), prepend=0)
    rng = np.random.default_rng(seed)
    missed, doubled = rng.binomial(pulses, share), rng.binomial(pulses, share)
    return np.asarray(pulse_m * np.cumsum(pulses - missed + doubled))


def count(*, wrong: float = 0.0, seed: int = 0) -> Wheel:
    """A count at 50 Hz of which the share ``wrong`` is missed, and as much counted twice."""
    t = np.arange(0.0, DURATION_S, 0.02)
    return Wheel(
        t,
        miscounted(distance(t), wrong, PULSE_M, seed),
        PULSE_M / np.sqrt(12.0),
        PULSE_M,
        integrates_speed=False,
        gaps=np.zeros((0, 2)),
    )


def inertial(*, noise: float = 0.01, rocking: float = 0.0) -> Intervals:
    """Forward force at 100 Hz, with white noise, on a gradient; ``rocking`` m/s^2 at 1 Hz."""
    edges = 0.01 * np.arange(round(100 * DURATION_S) + 1)
    accel = np.zeros((len(edges) - 1, 3))
    accel[:, 0] = 3.0 * 0.1 * np.cos(0.1 * edges[1:]) + 0.2 + rocking * np.sin(2.0 * np.pi * 1.07 * edges[1:])
    accel[:, 0] += noise * np.random.default_rng(1).standard_normal(len(accel))
    return Intervals(edges, np.zeros((len(accel), 3)), accel, np.zeros(len(accel), dtype=bool))


def miscount(wheel: Wheel, data: Intervals) -> float:
    return with_miscount(wheel, data, GRAVITY, SmoothConfig()).miscount


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_the_errors_of_a_count_are_found(share: float) -> None:
    found = [miscount(count(wrong=share, seed=seed), inertial()) for seed in range(5)]
    assert np.mean(found) == pytest.approx(density(share), rel=0.15)  # the lowest of three estimates


def test_few_errors_of_a_count_are_found_too() -> None:
    """Of one pulse in 500 the rounding of the count hides some."""
    found = [miscount(count(wrong=0.002, seed=seed), inertial()) for seed in range(5)]
    assert 0.5 * density(0.002) < np.mean(found) < 1.1 * density(0.002)


@pytest.mark.parametrize(("noise", "rocking"), [(0.01, 0.0), (2.0, 0.0), (0.01, 0.5)])
def test_a_good_count_stays_as_it_is(noise: float, rocking: float) -> None:
    """Neither a noisy accelerometer nor a body that rocks on its springs makes errors of the count."""
    wheel = count()
    assert with_miscount(wheel, inertial(noise=noise, rocking=rocking), GRAVITY, SmoothConfig()) is wheel


def test_a_wheel_that_slips_for_a_third_of_the_time_hardly_miscounts() -> None:
    """Slips raise the median of squares a little: a tenth of what one pulse in fifty makes at most."""
    wheel = count()
    slipping = np.sin(2.0 * np.pi * wheel.t / 40.0) > 0.5
    speeds = np.where(slipping, 1.0 + 0.5 * np.sin(wheel.t), 0.0)
    slips = replace(wheel, distance=wheel.distance + 0.02 * np.cumsum(speeds))
    assert miscount(slips, inertial()) < 0.1 * density(0.02)


def test_a_short_run_shows_nothing() -> None:
    wheel = count(wrong=0.1)
    short = replace(wheel, t=wheel.t[:500], distance=wheel.distance[:500])
    assert with_miscount(short, inertial(), GRAVITY, SmoothConfig()) is short


def test_what_noise_settings_allow_for_is_expected() -> None:
    config = SmoothConfig()
    allowed = config.model_copy(
        update={"tach": config.tach.model_copy(update={"creep_m_per_sqrt_m": 1.1 * density(0.02)})}
    )
    wheel = count(wrong=0.02)
    assert with_miscount(wheel, inertial(), GRAVITY, allowed) is wheel


def test_a_run_whose_tach_miscounts_has_sigmas_of_it_and_says_so() -> None:
    """Most of the errors were taken for slips, and the speed erred by 9 sigmas for 50 s (seed 5)."""
    plan = replace(scenario("mainline"), effects=(MiscountedPulses(0.02),))
    run = simulate(plan, seed=5, duration_s=300.0)
    result = smooth(run.recording)
    table = result.trajectory
    error = table["speed_mps"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["speed_mps"])
    assert np.mean(np.abs(error) > 4.0 * table["speed_mps_sd"]) < 0.05
    assert 0.5 < result.summary.noise_ratios["tach"] < 1.5
    (found,) = [finding for finding in result.summary.findings if finding.code == "noise-level-raised"]
    assert found.message.startswith("count of the wheel: its errors add up to 0.03")
    assert (result.events["kind"] != "standstill").sum() < 10


def test_the_errors_of_a_further_tach_are_found() -> None:
    recording = simulate(scenario("slippery-line-two-axles"), seed=1, duration_s=200.0).recording
    ((name, table),) = recording.others.items()
    rolled = table["distance_m"].to_numpy()
    pulse = np.min(np.diff(np.unique(rolled)))
    miscounting = table.assign(distance_m=miscounted(rolled, 0.05, pulse))
    good, bad = (
        next(part for part in build_problem(run, SmoothConfig()).families if part.type is FactorType.TACH_INCREMENT)
        for run in (recording, replace(recording, others={name: miscounting}))
    )
    moved = good.data["counted"] > 1.0
    added = np.median(np.sqrt((bad.sigma[moved, 0] ** 2 - good.sigma[moved, 0] ** 2) / good.data["counted"][moved]))
    assert added == pytest.approx(density(0.05, pulse), rel=0.2)
