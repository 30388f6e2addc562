"""Level and correlation time of GNSS errors from residuals, and runs through street canyons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from trackfg.datasets.scenarios import scenario, simulate
from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.results.result import Result
from trackfg.smoothing.gnss_errors import gnss_errors
from trackfg.smoothing.lasting_errors import errors_seen, have_grown
from trackfg.smoothing.smoother import SmoothedStates, smooth


def lasting(n: int, time_s: float, sd: float, rng: np.random.Generator) -> Array:
    """A first-order Gauss-Markov process, once a second, shape (n, 3)."""
    phi = np.exp(-1.0 / time_s)
    driven = rng.standard_normal((n, 3))
    driven[1:] *= np.sqrt(1.0 - phi * phi)
    return np.asarray(sd * lfilter([1.0], [1.0, -phi], driven, axis=0))


def test_white_errors_as_declared_change_nothing() -> None:
    t = np.arange(600.0)
    seen = errors_seen(t, np.random.default_rng(1).standard_normal((600, 3)), np.full((600, 3), 0.01))
    assert np.abs(np.log(seen.factor)).max() < 0.4
    assert np.sqrt(np.mean(np.log(seen.factor) ** 2)) < 0.15


def test_a_level_is_that_of_the_errors_although_outliers_come_on_top() -> None:
    rng = np.random.default_rng(2)
    error = 4.0 * rng.standard_normal((600, 3))
    error[rng.choice(600, 12)] += 100.0
    seen = errors_seen(np.arange(600.0), error, np.zeros((600, 3)))
    assert np.median(seen.level) == pytest.approx(4.0, rel=0.1)


def test_errors_that_last_count_once() -> None:
    """C is 1 + 2 sum rho = 2 x 20 s at one a second; over 20 runs it is right on average, although a mean is lost."""
    found = []
    for seed in range(20):
        error = lasting(1000, 20.0, 1.0, np.random.default_rng(seed))
        error -= error.mean(axis=0)
        seen = errors_seen(np.arange(1000.0), error, np.full((1000, 3), 40.0 / 1000.0))
        found.append(float(np.median(seen.correlation)))
    assert np.median(found) == pytest.approx(40.0, rel=0.35)


def test_errors_that_last_are_seen_among_outliers() -> None:
    """Sigmas are those of 2 x 20 s that count once, sqrt(40), although one position in 25 is off by ten sigmas more."""
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        error = lasting(1000, 20.0, 1.0, rng)
        error -= error.mean(axis=0)
        error[rng.choice(1000, 40, replace=False)] += 10.0 * rng.standard_normal((40, 3))
        seen = errors_seen(np.arange(1000.0), error, np.full((1000, 3), 40.0 / 1000.0))
        found.append(float(np.median(seen.factor)))
    assert np.median(found) == pytest.approx(np.sqrt(40.0), rel=0.2)


def test_errors_that_last_longer_than_a_span_have_one_level() -> None:
    """Errors of 30 s are large for half a minute and small for the next: chance, not a receiver that has become worse.

    Over 20 runs the mean of 300 positions has the sigma that their factors say.
    """
    constant, in_sigmas = 0, []
    for seed in range(20):
        error = lasting(300, 30.0, 1.0, np.random.default_rng(seed))
        mean, variance = error.mean(axis=0), 60.0 / 300.0
        seen = errors_seen(np.arange(300.0), error - mean, np.full((300, 3), variance))
        constant += bool(np.log(seen.level).std(axis=0).max() < 0.1)
        in_sigmas.append(mean / np.sqrt(np.mean(seen.factor**2, axis=0) / 300.0))
    assert constant >= 16
    assert 0.7 < np.sqrt(np.mean(np.square(in_sigmas))) < 1.3


def test_residuals_of_nothing_are_of_the_declared_level() -> None:
    seen = errors_seen(np.arange(60.0), np.zeros((60, 3)), np.zeros((60, 3)))
    assert np.isfinite(seen.factor).all()


def test_residuals_that_grow_as_positions_lose_weight_are_not_the_receivers() -> None:
    """Errors of the receiver stay of the level that was seen; what positions had held in place goes on."""
    rng = np.random.default_rng(4)
    level = np.full((600, 3), 3.0)
    assert not have_grown(3.0 * rng.standard_normal((600, 3)), level)
    assert have_grown(9.0 * rng.standard_normal((600, 3)), level)


def test_a_canyon_is_a_span_of_time() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(600.0)
    canyon = (t > 200.0) & (t < 260.0)
    error = rng.standard_normal((600, 3)) + canyon[:, None] * lasting(600, 20.0, 7.0, rng)
    seen = errors_seen(t, error, np.zeros((600, 3)))
    assert np.median(seen.level[canyon]) > 4.0
    away = (t < 180.0) | (t > 280.0)
    assert np.median(seen.factor[away]) == pytest.approx(1.0, abs=0.2)
    assert np.median(seen.correlation[canyon]) > 5.0


def off(result: Result, other: Result, name: str) -> float:
    """Return the rms difference of two results, in the sigmas of the second."""
    difference = result.trajectory[name] - other.trajectory[name]
    return float(np.sqrt(np.mean((difference / other.trajectory[f"{name}_sd"]) ** 2)))


def test_street_canyons_hardly_move_a_run() -> None:
    plan = scenario("mainline-gnss")
    assert plan.gnss is not None
    gnss = replace(plan.gnss, multipath_sd_m=(0.0, 0.0, 0.0), outlier_probability=0.0, outages_s=())
    recording = simulate(replace(plan, gnss=gnss), seed=3, duration_s=300.0).recording
    assert recording.gnss is not None
    t, rng = recording.gnss["t_s"].to_numpy(), np.random.default_rng(4)
    canyon = ((t > 80.0) & (t < 130.0)) | ((t > 190.0) & (t < 230.0))
    axes = ["east_m", "north_m", "up_m"]
    wrong = recording.gnss.copy()
    wrong[axes] += lasting(len(t), 20.0, 7.0, rng) * canyon[:, None]

    oracle = smooth(replace(recording, gnss=recording.gnss[~canyon].reset_index(drop=True)))
    result = smooth(replace(recording, gnss=wrong))
    assert result.summary.solver.converged
    for name in ("east_m", "north_m", "chainage_m", "speed_mps", "pitch_rad"):
        assert off(result, oracle, name) < 1.5
    assert any(finding.code == "gnss-level" for finding in result.summary.findings)


@pytest.mark.parametrize("declared", [0.5, 1.0])
def test_a_receiver_that_is_wrong_for_minutes_does_not_show_a_place_better_than_its_mean(declared: float) -> None:
    """Errors that last for a minute determine a constant place to sqrt(2 x 60 / 360) sigmas; solved in turns."""
    t, found = np.arange(360.0), []
    for seed in range(12):
        error = lasting(360, 60.0, 1.0, np.random.default_rng(seed))
        used = np.ones((360, 3))
        for turn in range(4):
            variance = declared**2 / (1.0 / used**2).sum(axis=0)
            place = variance * (error / (declared * used) ** 2).sum(axis=0)
            followed = np.broadcast_to(variance / declared**2, error.shape)
            used = errors_seen(t, (error - place) / declared, followed, weighted=turn > 0, used=used).factor
        found.append(declared**2 / (1.0 / used**2).sum(axis=0))
    assert np.sqrt(np.mean(found)) > 0.7 * np.sqrt(120.0 / 360.0)


def shared(sd_m: float, declared_m: float) -> Result:
    """A run whose positions all err by the same 0.8 m, and by white noise of ``sd_m`` each."""
    plan = scenario("mainline-gnss")
    assert plan.gnss is not None
    sd = (sd_m, sd_m, sd_m)
    gnss = replace(plan.gnss, sd_m=sd, multipath_sd_m=(0.0, 0.0, 0.0), outlier_probability=0.0, outages_s=())
    recording = simulate(replace(plan, gnss=gnss), seed=3, duration_s=200.0).recording
    assert recording.gnss is not None
    off = recording.gnss.assign(east_m=recording.gnss["east_m"] + 0.8)
    off[["east_sd_m", "north_sd_m", "up_sd_m"]] = declared_m
    return smooth(replace(recording, gnss=off))


@pytest.mark.parametrize(("sd_m", "declared_m"), [(0.3, 1.0), (0.8, 0.8)])
def test_errors_that_positions_share_are_in_the_sigmas(sd_m: float, declared_m: float) -> None:
    """Positions that scatter by less than declared share the rest, as far as anything shows."""
    result = shared(sd_m, declared_m)
    (verdict,) = (verdict for verdict in result.summary.verdicts if verdict.quantity == "position")
    assert any("share the rest" in reason for reason in verdict.reasons) == (sd_m < declared_m)
    if sd_m < declared_m:
        assert result.trajectory["east_m_sd"].mean() == pytest.approx(0.9, rel=0.2)


def test_errors_that_a_run_is_not_solved_again_for_are_a_doubt(smoothed: Callable[..., SmoothedStates]) -> None:
    """Of errors that last for half a minute the first solution knows nothing."""
    run = smoothed("mainline-gnss", seed=0, duration_s=150.0)
    (family,) = (family for family in run.problem.families if family.type is FactorType.GNSS_POSITION)
    wander = np.sin(0.2 * run.problem.t[family.slots[0].index])[:, None] * 4.0 * family.sigma
    moved = replace(family, data={**family.data, "position": family.data["position"] + wander})
    families = tuple(moved if other is family else other for other in run.problem.families)
    level = {FactorType.GNSS_POSITION: np.full(family.sigma.shape, 4.0)}
    said = gnss_errors(replace(run, problem=replace(run.problem, families=families, gnss_level=level)))
    assert said.changed
    (doubt,) = (doubt for doubt in said.doubts if "last so long" in doubt.reason)
    assert "position" in doubt.quantities
    assert 2.0 < doubt.factor < 20.0
