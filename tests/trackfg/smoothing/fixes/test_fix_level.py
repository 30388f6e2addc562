"""The level of the fixes' errors over their declared sigmas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.factors.factor_type import FactorType
from trackfg.sensors.tach import Wheel
from trackfg.smoothing.fixes.fix_level import fix_level, most_by_wheel
from trackfg.smoothing.fixes.wrong_fixes import wrong_fixes
from trackfg.smoothing.smoother import smooth, smooth_states


@pytest.mark.parametrize("actual", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("predicted", [0.01, 1.0])
def test_the_level_is_found_in_spite_of_wrong_fixes(actual: float, predicted: float) -> None:
    """Predictions are good to 0.1 and to 1 sigma of the declared; one fix in twenty is wrong by 300 m."""
    levels = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        error = np.hypot(actual * 0.1, np.sqrt(predicted) * 0.1) * rng.standard_normal(40)
        error[:2] = 300.0
        levels.append(fix_level(error, np.full(40, 0.1), np.full(40, predicted * 0.01)))
    assert np.median(levels) == pytest.approx(actual, rel=0.2)


def test_a_few_fixes_as_declared_stay_as_they_are() -> None:
    for seed in range(10):
        error = 0.3 * np.random.default_rng(seed).standard_normal(5)
        assert 0.5 <= fix_level(error, np.full(5, 0.3), np.full(5, 1.0)) < 2.5


@pytest.mark.parametrize("sensors", [0.0, 0.3])
def test_fixes_as_declared_keep_their_level_where_sensors_predict_them_better_than_declared(sensors: float) -> None:
    """Of the many fixes of a long run the level is certain. Sensors that declare 1 m are off by far less."""
    for seed in range(10):
        error = np.hypot(0.3, sensors) * np.random.default_rng(seed).standard_normal(300)
        assert fix_level(error, np.full(300, 0.3), np.full(300, 1.0)) == pytest.approx(1.0, abs=0.15)


def test_fixes_better_than_declared_are_known_by_their_errors() -> None:
    for seed in range(10):
        error = 0.15 * np.random.default_rng(seed).standard_normal(300)
        assert fix_level(error, np.full(300, 0.3), np.full(300, 1e-4)) == pytest.approx(0.5, rel=0.15)


def test_fixes_that_scatter_more_than_declared_get_the_sigmas_they_deserve() -> None:
    run = simulate(replace(scenario("mainline"), balises=BaliseModel(400.0, 0.1)), seed=2, duration_s=250.0)
    fixes = run.recording.fixes
    assert fixes is not None
    error = 2.0 * np.random.default_rng(2).standard_normal(len(fixes))
    scattered = fixes.assign(chainage_m=fixes["chainage_m"] + error)
    result = smooth(replace(run.recording, fixes=scattered))
    declared = smooth(replace(run.recording, fixes=scattered.assign(chainage_sd_m=2.0)))
    assert any(finding.code == "fix-level" for finding in result.summary.findings)
    assert not any(finding.code == "fixes-withheld" for finding in result.summary.findings)
    off = result.trajectory["chainage_m"] - declared.trajectory["chainage_m"]
    assert (off.abs() < 0.5 * declared.trajectory["chainage_m_sd"]).all()
    ratio = result.trajectory["chainage_m_sd"] / declared.trajectory["chainage_m_sd"]
    assert 0.5 < ratio.median() < 2.0


def test_fixes_that_lie_on_a_line_over_the_wheels_way_do_not_err_by_more() -> None:
    """Whatever the wheel's scale. Fixes that err by 5 times what they declare show it; two always lie on a line."""
    rng = np.random.default_rng(1)
    rolled, sigma = np.linspace(0.0, 6000.0, 12), np.full(12, 0.2)
    error = 0.2 * rng.standard_normal(12)
    assert most_by_wheel(1.007 * rolled + 100.0 + error, sigma, rolled) < 2.0
    assert 4.0 < most_by_wheel(1.007 * rolled + 100.0 + 5.0 * error, sigma, rolled) < 10.0
    assert most_by_wheel(1.007 * rolled[:2], sigma[:2], rolled[:2]) > 900.0


def test_fixes_that_agree_with_the_wheel_do_not_err_because_their_predictions_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of an inertial sensor whose scales are far worse than declared."""
    run = simulate(replace(scenario("mainline"), balises=BaliseModel(400.0, 0.3)), seed=1, duration_s=200.0)
    solved = smooth_states(run.recording, SmoothConfig())
    monkeypatch.setattr("trackfg.smoothing.fixes.wrong_fixes.fix_level", lambda *_: 30.0)

    def level(wheel: Wheel | None) -> float:
        after = wrong_fixes(replace(solved, problem=replace(solved.problem, wheel=wheel))).problem
        before, now = (one.family(FactorType.ABSOLUTE_FIX) for one in (solved.declared, after))
        assert before is not None
        assert now is not None
        return float(np.median(now.sigma) / np.median(before.sigma))

    assert level(solved.problem.wheel) < 2.0
    assert level(None) == pytest.approx(30.0)
