"""Any slip: short and long, weak and violent, at the start, in curves, on gradients, while braking, many in a row.

Slips are put into the count of one simulated run (R 300-500, gradients up to 1.6 %, four starts and stops, a balise
each km), so that their starts, ends and creeps are known. Distances over a slip, its reported start and end, and the
chainage's sigma are held against the truth.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets import slip_wheel
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.vehicle.adhesion import WheelSlip
from trackfg.evaluation.slip_scores import score_slips
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

PLACES = {"start": 33.0, "full speed": 64.0, "curve": 81.0, "braking": 106.0, "curve on a gradient": 200.0}
"""Seconds; the train stands until 30 s, from 131 to 159 s and from 260 to 281 s."""


@pytest.fixture(scope="module")
def rolling_run() -> Callable[..., Simulation]:
    """The wheel creeps at random, but never slips."""
    plan = replace(scenario("slippery-line"), adhesion=None)

    def run(balises: bool = True, duration_s: float = 420.0) -> Simulation:
        return simulate(replace(plan, balises=plan.balises if balises else None), seed=0, duration_s=duration_s)

    return functools.cache(run)


@pytest.fixture(scope="module")
def without_slip(rolling_run: Callable[..., Simulation]) -> Result:
    """The run without a balise, as it is found where the wheel never slips."""
    return smoothed(rolling_run(balises=False))


def smoothed(run: Simulation) -> Result:
    result = smooth(run.recording, SmoothConfig())
    assert result.summary.solver.converged, result.summary.solver.reason
    return result


def distance_errors(result: Result, run: Simulation) -> np.ndarray:
    """Over each slip, m."""
    assert run.slips is not None
    ends = run.slips[["start_s", "end_s"]].to_numpy(dtype=float)
    found, true = (
        np.diff(np.interp(ends, table["t_s"], table["chainage_m"]), axis=1)[:, 0]
        for table in (result.trajectory, run.truth)
    )
    return np.asarray(found - true)


def worst_z(result: Result, run: Simulation) -> float:
    """Of the chainage, once the train goes."""
    table = result.trajectory[result.trajectory["t_s"] > 40.0]
    error = table["chainage_m"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    return float((error / table["chainage_m_sd"]).abs().max())


def assert_survived(run: Simulation, *, metres: float, seconds: float) -> None:
    result = smoothed(run)
    assert run.slips is not None
    assert np.abs(distance_errors(result, run)).max() < metres
    assert worst_z(result, run) < 4.0
    score = score_slips(result.events, run.slips, run.truth)
    assert score.recall == 1.0
    assert score.precision == 1.0
    assert score.found[["start_error_s", "end_error_s"]].abs().to_numpy().max() < seconds
    distances = score.distances
    assert (np.abs(distances["removed_m"] - distances["true_m"]) < 4.0 * distances["removed_m_sd"] + 0.05).all()


@pytest.mark.parametrize(
    ("place", "duration", "creep"),
    [("start", 10.0, 0.6), ("full speed", 5.0, -1.0), ("full speed", 30.0, -0.6), ("curve", 1.0, 0.05)],
)
def test_one_slip(rolling_run: Callable[..., Simulation], place: str, duration: float, creep: float) -> None:
    event = WheelSlip(PLACES[place], duration, creep, ramp_s=0.3)
    # Over 30 s the accelerometer alone measures the way.
    assert_survived(
        slip_wheel(rolling_run(duration_s=250.0), [event]), metres=0.6 if duration == 30.0 else 0.5, seconds=0.5
    )


APART = (("start", "curve", "curve on a gradient"), ("full speed", "braking"))
"""Places at which slips of one run do not overlap, however long."""
SHORT = {1.0: (0.05, 0.6, -1.0), 3.0: (0.15, -0.05, -0.6), 10.0: (0.05, -0.15, -1.0)}
"""Creeps by the seconds that they last: each, but those of 30 s, is within one run at every place."""
LONG = (
    *((APART[0], creep) for creep in (0.6, -0.15, -1.0)),
    *((APART[1], creep) for creep in (0.15, -0.6)),
    (("start",), 0.05),
    (("braking",), -0.05),
    (("curve on a gradient",), -0.05),
)
"""Places and creep over 30 s. Weak ones stand alone: half of the run would creep, which is a scale."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "duration", "creep"),
    [
        *((tuple(PLACES), duration, creep) for duration, creeps in SHORT.items() for creep in creeps),
        *((places, 30.0, creep) for places, creep in LONG),
    ],
)
def test_every_slip(
    rolling_run: Callable[..., Simulation], places: tuple[str, ...], duration: float, creep: float
) -> None:
    # A second of 5 % at a walk would be within one pulse.
    starts = PLACES | ({"start": PLACES["start"] + 8.0} if duration == 1.0 else {})
    # From rest to full speed the accelerometer alone measures the way.
    metres = 1.2 if duration == 30.0 else 0.4
    events = [WheelSlip(starts[p], min(duration, 24.0) if p == "braking" else duration, creep) for p in places]
    # A weak slide ends where the train stops: in its last seconds it is hardly a way.
    seconds = 2.0 if "braking" in places and duration == 30.0 else 1.2
    duration_s = 290.0 if duration == 30.0 else 250.0
    assert_survived(slip_wheel(rolling_run(duration_s=duration_s), events), metres=metres, seconds=seconds)


SEQUENCES = {
    "slide protection": [WheelSlip(104.0, 20.0, -0.3, "sawtooth")],
    "weak slide protection": [WheelSlip(104.0, 20.0, -0.06, "sawtooth")],
    "both ways in a row": [
        WheelSlip(60.0 + 6.0 * i, 4.0, c) for i, c in enumerate((0.1, 0.2, 0.05, -0.1, -0.3, 0.3, -1.0))
    ],
    "one way in a row": [WheelSlip(60.0 + 6.0 * i, 4.0, -0.08) for i in range(7)],
    "in every start and stop": [
        WheelSlip(start, 8.0, creep)
        for start, creep in ((36.0, 0.1), (110.0, -0.15), (164.0, 0.05), (234.0, -0.1), (290.0, 0.3), (360.0, -0.05))
    ],
    "locked to the stop": [WheelSlip(106.0, 26.0, -1.0, ramp_s=0.2)],
    "in the first seconds of motion": [WheelSlip(30.5, 6.0, 0.4)],
}


@pytest.mark.parametrize(
    "name",
    [name if name == "both ways in a row" else pytest.param(name, marks=pytest.mark.slow) for name in SEQUENCES],
)
def test_slips_in_a_row(rolling_run: Callable[..., Simulation], name: str) -> None:
    slips = SEQUENCES[name]
    run = slip_wheel(rolling_run(duration_s=420.0 if slips[-1].start_s > 250.0 else 250.0), slips)
    result = smoothed(run)
    assert np.abs(distance_errors(result, run)).max() < 0.3
    assert worst_z(result, run) < 4.0
    assert run.slips is not None
    score = score_slips(result.events, run.slips, run.truth)
    assert (score.recall, score.precision) == (1.0, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["slide protection", "one way in a row", "in every start and stop", "in the first seconds of motion"]
)
def test_without_a_balise(rolling_run: Callable[..., Simulation], without_slip: Result, name: str) -> None:
    """The wheel's scale is then the accelerometer's, to some tenths of a per cent, and that is all that is lost."""
    run = slip_wheel(rolling_run(balises=False), SEQUENCES[name])
    result = smoothed(run)
    scale = [r.summary.wheel_scale.value for r in (without_slip, result) if r.summary.wheel_scale is not None]
    assert scale[1] / scale[0] == pytest.approx(1.0, abs=1e-3)
    ends = [np.interp([40.0, 400.0], r.trajectory["t_s"], r.trajectory["chainage_m"]) for r in (without_slip, result)]
    assert np.ptp(ends[1]) / np.ptp(ends[0]) == pytest.approx(1.0, abs=1e-3)


def test_a_wheel_that_spins_at_rest(rolling_run: Callable[..., Simulation]) -> None:
    run = rolling_run(duration_s=250.0)
    assert run.recording.tach is not None
    tach = run.recording.tach.copy()
    quantum = np.diff(tach["distance_m"]).max()
    spun = 4.0 * np.clip((tach["t_s"] - 15.0) / 4.0, 0.0, 1.0)
    tach["distance_m"] += np.floor(spun / quantum) * quantum
    recording: Recording = replace(run.recording, tach=tach)
    result = smooth(recording, SmoothConfig())
    first = result.events[result.events["kind"] == "slip"].iloc[0]
    assert first["start_s"] == pytest.approx(15.0, abs=0.5)
    assert first["end_s"] == pytest.approx(19.0, abs=0.5)
    assert first["distance_removed_m"] == pytest.approx(4.0, abs=0.1)
    assert worst_z(result, run) < 4.0
