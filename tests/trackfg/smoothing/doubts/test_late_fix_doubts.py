"""Fixes that come late move the chainage, and no two of them contradict each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import trackfg
from trackfg.checks.diagnosis_positions import FixPassages, delay_of
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.smoothing.doubts.late_fix_doubts import stamp_step_s
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource


def passages(delay_s: float) -> FixPassages:
    """A place each 500 m, passed at 10 to 30 m/s; one is read twice, and one is another's."""
    rng = np.random.default_rng(3)
    distance, speed = 500.0 * np.arange(20.0), rng.uniform(10.0, 30.0, 20)
    t = 40.0 * np.arange(20.0) + delay_s
    chainage = 1000.0 + distance + rng.normal(0.0, 0.1, 20)
    chainage[12] += 1500.0
    distance = distance + delay_s * speed
    repeated = np.insert(np.arange(20), 5, 5)
    t, distance, speed, chainage = (values[repeated] for values in (t, distance, speed, chainage))
    t[6], distance[6] = t[5] + 0.3, distance[5] + 0.3 * speed[5]
    return FixPassages(t, distance, speed, chainage, np.full(21, 0.1))


def test_delay_is_what_changes_with_the_speed() -> None:
    late, prompt = delay_of(passages(0.3), creep_sd=0.0), delay_of(passages(0.0), creep_sd=0.0)
    assert late is not None
    assert prompt is not None
    assert late.is_sure
    assert late.delay_s == pytest.approx(0.3, abs=3.0 * late.sd_s)
    assert late.sd_s < 0.03
    assert not prompt.is_sure


def test_creep_may_look_like_a_delay() -> None:
    """A wheel that creeps by 5 % of the force is off by as much as fixes 0.1 s late at 20 m/s."""
    late = delay_of(passages(0.1), creep_sd=0.05)
    assert late is not None
    assert late.sd_s == pytest.approx(0.1, rel=0.3)
    assert not late.is_sure


@pytest.fixture
def run(simulated_in_full: Callable[..., Simulation]) -> Simulation:
    return simulated_in_full("slippery-line", seed=1, duration_s=700.0)


def later(recording: Recording, by_s: float) -> Recording:
    assert recording.fixes is not None
    return replace(recording, fixes=recording.fixes.assign(t_s=recording.fixes["t_s"] + by_s))


@pytest.mark.parametrize("by_s", [0.0, 0.4])
def test_chainage_is_widened_by_what_late_fixes_move_it(run: Simulation, by_s: float) -> None:
    result = trackfg.smooth(later(run.recording, by_s))
    t, chainage, sd = result.trajectory[["t_s", "chainage_m", "chainage_m_sd"]].to_numpy().T
    errors = (chainage - np.interp(t, run.truth["t_s"], run.truth["chainage_m"])) / sd
    assert np.sqrt(np.mean(errors**2)) < 1.5
    (verdict,) = [verdict for verdict in result.summary.verdicts if verdict.quantity == "chainage"]
    assert any("fixes come" in reason for reason in verdict.reasons) == (by_s > 0.0)


@pytest.mark.parametrize("by_s", [0.0, 0.6])
def test_a_stream_says_so(run: Simulation, by_s: float) -> None:
    recording = later(run.recording, by_s)
    source = RecordingSource(recording, batch_s=5.0)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, lag_s=10.0)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    details = [event.detail for piece in pieces for event in piece.events if event.kind == DOUBT]
    assert any(detail.startswith("chainage: fixes come") for detail in details) == (by_s > 0.0)


@pytest.mark.parametrize("step_s", [0.0, 1.0])
def test_stamps_in_whole_seconds_may_all_be_late(run: Simulation, step_s: float) -> None:
    fixes = run.recording.fixes
    assert fixes is not None
    rounded = np.ceil(fixes["t_s"] / step_s) * step_s if step_s else fixes["t_s"]
    result = trackfg.smooth(replace(run.recording, fixes=fixes.assign(t_s=rounded)))
    (verdict,) = [verdict for verdict in result.summary.verdicts if verdict.quantity == "chainage"]
    assert any("stamped to" in reason or "fixes come" in reason for reason in verdict.reasons) == (step_s > 0.0)
    t, chainage, sd = result.trajectory[["t_s", "chainage_m", "chainage_m_sd"]].to_numpy().T
    errors = (chainage - np.interp(t, run.truth["t_s"], run.truth["chainage_m"])) / sd
    assert np.sqrt(np.mean(errors**2)) < 1.5


def test_a_step_of_stamps_is_what_all_of_them_are_multiples_of() -> None:
    t = np.array([0.0, 3.0, 11.0, 12.0, 40.0, 41.0]) + 0.123
    assert stamp_step_s(t) == 1.0
    assert stamp_step_s(np.append(t, 55.323)) == 0.2
    assert stamp_step_s(np.append(t, 55.3301)) is None
    assert stamp_step_s(t[:4]) is None
