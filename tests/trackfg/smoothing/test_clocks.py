"""Runs whose clocks are off by more than the graph's variables cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.effects.positions import LateGnss
from trackfg.datasets.effects.wheel import LateTach
from trackfg.datasets.scenario import Effect
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.recording.description import Gnss
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(scenario("mainline-gnss"), seed=2, duration_s=150.0)


@pytest.fixture(scope="module")
def prompt(run: Simulation) -> Result:
    """Of the run with its own clocks."""
    return smooth(run.recording)


def test_positions_that_are_late_are_moved(run: Simulation, prompt: Result) -> None:
    gnss = run.recording.gnss
    assert gnss is not None
    late = smooth(replace(run.recording, gnss=gnss.assign(t_s=gnss["t_s"] + 1.5)))
    assert not any(finding.code == "gnss-clock" for finding in prompt.summary.findings)
    (finding,) = (finding for finding in late.summary.findings if finding.code == "gnss-clock")
    assert "late" in finding.message
    clocks = (prompt.summary.gnss_clock_offset_s, late.summary.gnss_clock_offset_s)
    on_time, moved = (clock.value for clock in clocks if clock is not None)
    assert moved - on_time == pytest.approx(-1.5, abs=0.02)
    for name in ("east_m", "north_m", "speed_mps", "pitch_rad"):
        off = (late.trajectory[name] - prompt.trajectory[name]) / prompt.trajectory[f"{name}_sd"]
        assert np.sqrt(np.mean(off**2)) < 1.0


def test_speeds_of_a_receiver_that_is_late_are_moved_with_its_positions() -> None:
    plan = replace(scenario("mainline-gnss"), further_sensors=(ReceiverSpeeds(delay_s=0.1),))
    run = simulate(plan, seed=2, duration_s=150.0)
    gnss, speeds = run.recording.gnss, run.recording.others["gnss_speed"]
    assert gnss is not None
    others = {"gnss_speed": speeds.assign(t_s=speeds["t_s"] + 1.5)}
    late = smooth(replace(run.recording, gnss=gnss.assign(t_s=gnss["t_s"] + 1.5), others=others))
    codes = [finding.code for finding in late.summary.findings]
    assert {"gnss-clock", "gnss-speed-clock"} <= set(codes)
    prompt = smooth(run.recording)
    off = (late.trajectory["speed_mps"] - prompt.trajectory["speed_mps"]) / prompt.trajectory["speed_mps_sd"]
    assert np.sqrt(np.mean(off**2)) < 1.0


def test_speeds_alone_that_are_late_are_moved() -> None:
    plan = replace(scenario("mainline-gnss"), further_sensors=(ReceiverSpeeds(delay_s=1.2),))
    run = simulate(plan, seed=2, duration_s=150.0)
    (finding,) = (one for one in smooth(run.recording).summary.findings if one.code == "gnss-speed-clock")
    assert finding.hint is not None
    assert float(finding.hint.split()[1]) == pytest.approx(-1.2, abs=0.1)


def test_a_further_tach_that_is_late_is_moved() -> None:
    run = simulate("slippery-line-two-axles", seed=2, duration_s=120.0)
    table = run.recording.others["tach/2"]  # 0.03 s early by its scenario
    late = smooth(replace(run.recording, others={"tach/2": table.assign(t_s=table["t_s"] + 0.5)}))
    (finding,) = (finding for finding in late.summary.findings if finding.code == "tach-2-clock")
    assert finding.hint is not None
    assert float(finding.hint.split()[1]) == pytest.approx(-0.47, abs=0.03)
    prompt = smooth(run.recording)
    assert not any(finding.code.endswith("-clock") for finding in prompt.summary.findings)
    off = (late.trajectory["chainage_m"] - prompt.trajectory["chainage_m"]) / prompt.trajectory["chainage_m_sd"]
    assert np.sqrt(np.mean(off**2)) < 1.0


@pytest.mark.slow
def test_a_late_tach_is_moved_until_the_graph_agrees() -> None:
    """Among all the other errors the accelerometer alone does not show it, and one solution finds a part of it."""
    plan = scenario("rough-ride")
    effects: tuple[Effect, ...] = tuple(
        type(effect)(1.0) if isinstance(effect, LateTach | LateGnss) else effect for effect in plan.effects
    )
    run = simulate(replace(plan, effects=effects), seed=4, duration_s=200.0)
    summary = smooth(run.recording).summary
    offset = summary.clock_offset_s
    assert offset is not None
    assert offset.sd is not None
    assert abs(offset.value + 1.0) < 3.0 * offset.sd < 0.15
    assert {"tach-clock", "gnss-clock"} <= {finding.code for finding in summary.findings}


def test_a_jump_of_the_imus_clock_is_taken_out(run: Simulation, prompt: Result) -> None:
    imu = run.recording.imu
    t = imu["t_s"].to_numpy()
    jumped = imu.assign(t_s=t + 5.0 * (t > 110.0))
    result = smooth(replace(run.recording, imu=jumped))
    (finding,) = (finding for finding in result.summary.findings if finding.code == "imu-clock-jump")
    assert finding.time_s == pytest.approx(110.0, abs=0.02)
    assert set(result.events["kind"]) == set(prompt.events["kind"])
    np.testing.assert_allclose(result.trajectory["t_s"], prompt.trajectory["t_s"])
    np.testing.assert_allclose(result.trajectory["speed_mps"], prompt.trajectory["speed_mps"], atol=2e-3)


@pytest.mark.parametrize("declared", [False, True])
def test_positions_that_look_late_may_be_of_an_antenna_elsewhere(run: Simulation, declared: bool) -> None:
    gnss, description = run.recording.gnss, run.recording.description
    assert gnss is not None
    assert description.gnss is not None
    keys = description.gnss.model_dump(exclude={"lever_arm_m"})
    part = Gnss(**keys, lever_arm_m=(0.0, 0.0, 0.0)) if declared else Gnss(**keys)
    late = replace(
        run.recording,
        gnss=gnss.assign(t_s=gnss["t_s"] + 1.5),
        description=description.model_copy(update={"gnss": part}),
    )
    (finding,) = (finding for finding in smooth(late).summary.findings if finding.code == "gnss-clock")
    assert ("declare gnss.lever_arm_m" in (finding.hint or "")) == (not declared)
