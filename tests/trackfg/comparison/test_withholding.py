"""Which measurements are withheld, and how predictions of them are scored: worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines.result import GNSS_CLOCK, BaselineResult
from trackfg.comparison.withholding import Withheld, divisible, division, predicted
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.results.columns import EVENT_COLUMNS, GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS

SPEED = 10.0


@pytest.fixture
def recording(simulated: Callable[..., Simulation]) -> Recording:
    """200 s at 10 m/s, with a fix every 20 s at 1000 m more than the tachometer counts, and GNSS at 1 Hz."""
    run = simulated("mainline-gnss", seed=0, duration_s=60.0).recording
    t = np.arange(0.0, 200.5)
    at = np.arange(5.0, 200.0, 20.0)
    assert run.gnss is not None
    gnss = pd.DataFrame({name: np.zeros(t.size) for name in run.gnss}).assign(
        t_s=t, east_m=SPEED * t, east_sd_m=2.0, north_sd_m=2.0, up_sd_m=2.0
    )
    assert run.description.gnss is not None
    arm = run.description.gnss.model_copy(update={"lever_arm_m": (3.0, 0.0, 2.0)})
    return replace(
        run,
        description=run.description.model_copy(update={"gnss": arm}),
        tach=pd.DataFrame({"t_s": t, "distance_m": SPEED * t}),
        fixes=pd.DataFrame({"t_s": at, "chainage_m": 1000.0 + SPEED * at, "chainage_sd_m": 0.3}),
        gnss=gnss,
    )


def estimate(chainage_of: Callable[[np.ndarray], np.ndarray], **columns: float) -> BaselineResult:
    t = np.arange(0.0, 200.1, 0.1)
    trajectory = pd.DataFrame({name: np.full(t.size, columns.get(name, np.nan)) for name in TRAJECTORY_COLUMNS})
    trajectory = trajectory.assign(t_s=t, chainage_m=chainage_of(t), east_m=SPEED * t)
    empty = (pd.DataFrame(columns=list(names), dtype=np.float64) for names in (GEOMETRY_COLUMNS, EVENT_COLUMNS))
    return BaselineResult("made up", trajectory, *empty)


def test_every_row_of_the_middle_is_withheld_once(recording: Recording) -> None:
    assert divisible(recording) == ["fixes", "positions", "tach"]
    tables: dict[Withheld, pd.DataFrame | None] = {
        "fixes": recording.fixes,
        "positions": recording.gnss,
        "tach": recording.tach,
    }
    for what, table in tables.items():
        assert table is not None
        parts = [division(recording, what, part) for part in range(3)]
        times = np.sum([part.rows for part in parts], axis=0)
        assert times.max() == 1
        length_s = {"fixes": 0.0, "positions": 30.0, "tach": 20.0}[what]
        inside = table["t_s"].between(length_s, 200.0 - 2.0 * length_s)
        assert (times[inside] == 1).all()
    kept = division(recording, "fixes", 1).kept
    assert kept.fixes is not None
    assert kept.fixes["t_s"].tolist() == [5.0, 45.0, 65.0, 105.0, 125.0, 165.0, 185.0]
    assert kept.tach is recording.tach


def test_too_little_is_not_divided(recording: Recording) -> None:
    assert recording.fixes is not None
    few = replace(recording, fixes=recording.fixes.iloc[:5], gnss=None, tach=None)
    assert divisible(few) == []


@pytest.mark.parametrize(("anchored", "error"), [(True, 7.0), (False, 0.0)])
def test_fixes(recording: Recording, anchored: bool, error: float) -> None:
    """An estimator that counts from anywhere is shifted to the fixes that it had."""
    given = estimate(lambda t: 1007.0 + SPEED * t, chainage_m_sd=0.4)
    errors = predicted(division(recording, "fixes", 0), recording, given, anchored=anchored)
    assert errors["withheld_fix_m"].to_numpy() == pytest.approx(error)
    assert errors["withheld_fix_m_sd"].to_numpy() == pytest.approx(0.5)
    assert len(errors) == 4


def test_positions_are_those_of_the_antenna(recording: Recording) -> None:
    """Heading east the arm of 3 m is to the east, and the roll of 0.1 rad moves the antenna 2 m up to the right."""
    given = estimate(lambda t: t, roll_rad=0.1, pitch_rad=0.0, yaw_rad=0.0, north_m=1.0)
    errors = predicted(division(recording, "positions", 0), recording, given, anchored=True)
    east, north = np.split(errors["withheld_position_m"].to_numpy(), 2)
    assert east == pytest.approx(3.0)
    assert north == pytest.approx(1.0 - 2.0 * np.sin(0.1))


def test_positions_are_those_of_the_clock_that_the_estimate_found(recording: Recording) -> None:
    """At 10 m/s positions are a metre further on where their stamps are 0.1 s early."""
    given = estimate(lambda t: t, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0, north_m=0.0)
    on_time = replace(given, parameters={GNSS_CLOCK: 0.1})
    divided = division(recording, "positions", 0)
    first, second = (predicted(divided, recording, one, anchored=True) for one in (given, on_time))
    assert (second - first)["withheld_position_m"][: len(first) // 2].to_numpy() == pytest.approx(0.1 * SPEED)


def test_ways_within_a_span_do_not_see_the_wheel_scale(recording: Recording) -> None:
    steady = estimate(lambda t: -3.0 * SPEED * t)
    divided = division(recording, "tach", 0)
    assert predicted(divided, recording, steady, anchored=False)["withheld_way_m"].abs().max() < 1e-9

    def late(t: np.ndarray) -> np.ndarray:
        """Stand for the first half of every 20 s, and go at twice the speed in the other."""
        return SPEED * (20.0 * (t // 20.0) + np.maximum(2.0 * (t % 20.0) - 20.0, 0.0))

    error = predicted(divided, recording, estimate(late), anchored=False)["withheld_way_m"]
    assert error.min() == pytest.approx(-100.0, abs=12.0)
