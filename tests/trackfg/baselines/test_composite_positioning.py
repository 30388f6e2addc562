"""Positioning by tachometer and inertial sensor: slips taken out, curves found again, and what it may be wrong by."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines import composite_positioning
from trackfg.baselines.composite_positioning import survey
from trackfg.baselines.curve_points import CurvePoints, curve_table, find_curve
from trackfg.baselines.gravity_compensated import VehicleState, coast, start_state
from trackfg.baselines.result import BaselineResult
from trackfg.baselines.slip_detection import Cycles, JerkRule, read_cycles, start_point
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, STANDARD_GRAVITY
from trackfg.recording.description import Fixes, Imu, RecordingDescription, Tach, Track
from trackfg.recording.model import IMU_COLUMNS, Recording


def made_up(
    accelerations: Array,
    extra_speed: Array,
    *,
    uphill: float = 0.0,
    yaw_rate: Array | float = 0.0,
    start_mps: float = 10.0,
    direction: int = 1,
) -> tuple[Recording, Array]:
    """A train on a steady gradient, without noise, its wheel turning ``extra_speed`` too fast: 100 samples a second.

    Also the true distance at the samples' ends (n + 1,).
    """
    dt, n = 0.01, len(accelerations)
    speed = start_mps + np.concatenate([[0.0], np.cumsum(accelerations * dt)])
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * dt)])
    extra = np.concatenate([[0.0], np.cumsum(0.5 * (extra_speed[1:] + extra_speed[:-1]) * dt)])
    yaw = np.broadcast_to(yaw_rate, n)
    zero, middle = np.zeros(n), 0.5 * (speed[1:] + speed[:-1])
    along = accelerations + STANDARD_GRAVITY * np.sin(uphill)
    up = np.full(n, STANDARD_GRAVITY * np.cos(uphill))
    imu = np.column_stack([(np.arange(n) + 0.5) * dt, zero, zero, yaw, along, middle * yaw, up])
    return (
        Recording(
            description=RecordingDescription(
                id="made up",
                track=Track(direction=direction),
                imu=Imu(file="-", gyro=("a", "b", "c"), accel=("d", "e", "f")),
                tach=Tach(file="-", column="d", kind="distance", unit="m", signed=True),
            ),
            imu=pd.DataFrame(imu, columns=list(IMU_COLUMNS)),
            tach=pd.DataFrame({"t_s": np.arange(n + 1) * dt, "distance_m": distance + extra}),
        ),
        distance,
    )


def slip_speed(n: int, peak_mps: float, start_s: float = 40.0, end_s: float = 46.0) -> Array:
    """The wheel's excess: up within a second, held, and down within one. Shape (n + 1,)."""
    t = np.arange(n + 1) * 0.01
    return np.asarray(peak_mps * np.clip(np.minimum(t - start_s, end_s - t), 0.0, 1.0))


def slips_of(result: BaselineResult) -> pd.DataFrame:
    """The corrections among the events."""
    return result.events[result.events["kind"].isin(["slip", "slide"])]


@pytest.mark.parametrize(("peak_mps", "kind"), [(3.0, "slip"), (-3.0, "slide")])
@pytest.mark.parametrize("uphill", [0.0, 0.02, -0.02])
def test_a_slip_on_a_gradient_is_found_and_taken_out(peak_mps: float, kind: str, uphill: float) -> None:
    recording, true = made_up(np.full(8000, 0.1), slip_speed(8000, peak_mps), uphill=uphill)
    result = composite_positioning.run(recording)
    slips = slips_of(result)
    assert slips["kind"].tolist() == [kind]
    assert slips["start_s"].iloc[0] < 40.0
    assert slips["end_s"].iloc[0] > 46.0
    np.testing.assert_allclose(slips["distance_removed_m"], 5.0 * peak_mps, atol=0.05)
    at = np.interp(result.trajectory["t_s"], np.arange(8001) * 0.01, true)
    start = result.trajectory["chainage_m"].iloc[0] - at[0]
    np.testing.assert_allclose(result.trajectory["chainage_m"] - at - start, 0.0, atol=0.05)


def test_without_slip_the_distance_is_the_tachometers() -> None:
    recording, true = made_up(0.4 * np.sin(np.arange(6000) * 0.002), np.zeros(6001), uphill=0.03)
    result = composite_positioning.run(recording)
    assert slips_of(result).empty
    np.testing.assert_allclose(result.trajectory["chainage_m"], true[10::10], atol=1e-9)


def test_a_slip_as_gentle_as_the_steepest_line_is_not_seen() -> None:
    """1.23 km/h/s is 0.34 m/s^2: the wheel gets away by 0.3 m/s^2 and comes back as gently."""
    excess = np.interp(np.arange(8001) * 0.01, [40.0, 48.0, 56.0], [0.0, 2.4, 0.0])
    recording, _ = made_up(np.full(8000, 0.1), excess)
    assert slips_of(composite_positioning.run(recording)).empty
    assert not slips_of(composite_positioning.run(recording, threshold_kmhps=0.9)).empty


def steady_cycles(n: int = 600) -> Cycles:
    recording, _ = made_up(np.full(n * 10, 0.1), slip_speed(n * 10, 3.0))
    return read_cycles(recording, cycle_s=0.1, average_s=3.0)


def test_start_point_is_the_latest_steady_cycle_before_the_setback() -> None:
    steady = np.zeros(600, dtype=bool)
    steady[[300, 350, 380, 390]] = True
    cycles = steady_cycles()
    assert start_point(cycles, steady, 400, 2.1, 1) == 350
    assert start_point(cycles, steady, 400, 0.0, 1) == 390
    assert start_point(cycles, steady, 400, 2.1, 360) is None
    assert start_point(cycles, steady, 310, 2.1, 300) is None


def test_jerk_rule_needs_three_cycles_on_end_and_fails_while_the_wheel_breaks_away() -> None:
    steady = JerkRule().steady(steady_cycles())
    assert not steady[:3].any()
    assert steady[100:399].all()
    assert not steady[401:408].any()


def test_start_state_on_a_canted_left_curve_is_the_tracks_roll() -> None:
    """v = 20 m/s, R = 400 m, cant -60 mrad: exact with g, 0.4 mrad off with the force along z as printed."""
    roll, speed, rate = -0.060, 20.0, 20.0 / 400.0
    recording, _ = made_up(np.zeros(1000), np.zeros(1001), start_mps=speed)
    turned = recording.imu.assign(
        wz_radps=rate * np.cos(roll),
        wy_radps=rate * np.sin(roll),
        fy_mps2=speed * rate * np.cos(roll) + STANDARD_GRAVITY * np.sin(roll),
        fz_mps2=-speed * rate * np.sin(roll) + STANDARD_GRAVITY * np.cos(roll),
    )
    cycles = read_cycles(replace(recording, imu=turned), cycle_s=0.1, average_s=3.0)
    assert start_state(cycles, 50, as_printed=False).roll == pytest.approx(roll, abs=1e-9)
    assert start_state(cycles, 50, as_printed=True).roll == pytest.approx(-0.0596, abs=1e-4)


def into_a_canted_curve(uphill: float) -> tuple[Cycles, Array]:
    """A left-hand curve of R 300 at 15 m/s on a gradient: the cant runs up in 6 s, stays, runs off; and the roll."""
    recording, _ = made_up(np.zeros(3000), np.zeros(3001), start_mps=15.0)
    t = recording.imu["t_s"].to_numpy()
    share = np.interp(t, [4.0, 10.0, 16.0, 22.0], [0.0, 1.0, 1.0, 0.0])
    roll, yaw_rate = -0.098 * share, 15.0 / 300.0 * share
    roll_rate, pitch = np.gradient(roll, 0.01), -uphill
    turning = recording.imu.assign(
        wx_radps=roll_rate - yaw_rate * np.sin(pitch),
        wy_radps=yaw_rate * np.cos(pitch) * np.sin(roll),
        wz_radps=yaw_rate * np.cos(pitch) * np.cos(roll),
    )
    return read_cycles(replace(recording, imu=turning), cycle_s=0.1, average_s=3.0), roll


def test_pitch_holds_through_a_canted_curve_only_with_its_corrections() -> None:
    cycles, roll = into_a_canted_curve(0.010)
    start = VehicleState(cycle=9, speed=15.0, pitch=0.010, roll=0.0)
    corrected = coast(cycles, start, 28.0)
    np.testing.assert_allclose(corrected.pitch, 0.010, atol=1e-4)
    np.testing.assert_allclose(corrected.roll, at_ends(roll), atol=1e-3)
    as_measured = coast(cycles, start, 28.0, pitch_correction=False)
    assert np.abs(as_measured.pitch - 0.010).max() > 0.02
    printed = coast(cycles, start, 28.0, as_printed=True)
    assert 1e-4 < np.abs(printed.pitch - 0.010).max() < 2e-3


def at_ends(roll: Array) -> Array:
    """The roll at the ends of cycles 9 to 289, from that of the samples."""
    return np.interp(0.1 * np.arange(10, 291), (np.arange(len(roll)) + 0.5) * 0.01, roll)


def test_equation_12_adds_a_pitch_that_is_there_in_the_curve_only() -> None:
    cycles, _ = into_a_canted_curve(0.0)
    start = VehicleState(cycle=9, speed=15.0, pitch=0.0, roll=0.0)
    with_it, without = (coast(cycles, start, 28.0, eq12=eq12, as_printed=True).pitch for eq12 in (True, False))
    added = with_it - without
    np.testing.assert_allclose(np.abs(added[130]), 1.0 - np.cos(0.098), rtol=0.05)
    np.testing.assert_allclose(added[-1], 0.0, atol=1e-4)


CURVE = CurvePoints(827.0, 847.0, 881.0, 953.0, 987.0, 1007.0, 1.0 / 300.0)
"""The paper's table 1."""


def curve_run(**change: float) -> tuple[Array, Array]:
    """Places every 2 m and the curvature of the paper's curve there, 1/m; ``change`` moves or scales it."""
    place = np.arange(700.0, 1150.0, 2.0)
    corners = [847.0, 889.5, 944.5, 987.0]
    corners = [x + change.get("late", 0.0) for x in corners]
    corners[2:] = [x + change.get("longer", 0.0) for x in corners[2:]]
    size = change.get("size", 1.0) / 300.0
    curvature = np.interp(place, corners, [0.0, size, size, 0.0])
    curvature[place < corners[0] - 10.0] = change.get("before", 0.0)
    curvature[place > corners[3] + 10.0] = change.get("after", 0.0)
    return place, curvature


def look(
    place: Array, curvature: Array, *, speed: float = 20.0, slipping: bool = False, direction: int = 1
) -> tuple[float, str]:
    """Correction and reason of refusal."""
    way = slice(None, None, direction)
    slips = np.full(len(place), slipping)
    found = find_curve(CURVE, place[way], curvature[way], np.full(len(place), speed), slips, direction)
    assert found is not None
    return found.correction_m, found.refused


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("late", [0.0, 15.0, -40.0])
def test_a_curve_of_the_table_corrects_the_odometer(late: float, direction: int) -> None:
    correction, refused = look(*curve_run(late=late), direction=direction)
    assert refused == ""
    assert correction == pytest.approx(-late, abs=0.2)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"before": 1.0 / 900.0}, "entry straight"),
        ({"after": 1.0 / 900.0}, "exit straight"),
        ({"size": -1.0}, "other side"),
        ({"size": 1.25}, "above the limit"),
        ({"longer": 30.0}, "length of 102 m"),
    ],
)
def test_a_curve_that_fails_a_diagnostic_is_refused(change: dict[str, float], why: str) -> None:
    assert why in look(*curve_run(**change))[1]


def test_no_correction_while_slipping_or_below_10_kmh() -> None:
    place, curvature = curve_run()
    assert look(place, curvature, slipping=True)[1] == "slip or slide on the way"
    assert look(place, curvature, speed=9.9 * KMH)[1] == "too slow"
    assert look(place, curvature, speed=10.1 * KMH)[1] == ""


def test_no_curve_no_sighting() -> None:
    place = np.arange(700.0, 1150.0, 2.0)
    none = find_curve(CURVE, place, np.zeros(225), np.full(225, 20.0), np.zeros(225, dtype=bool), 1)
    assert none is None


def test_the_table_of_a_line_is_the_papers() -> None:
    x = np.arange(0.0, 2000.0, 0.5)
    curvature = np.interp(x, [851.3, 889.5, 944.5, 982.7], [0.0, 1 / 300, 1 / 300, 0.0])
    (curve,) = curve_table(x, curvature)
    assert curve.curvature_1pm == pytest.approx(1 / 300)
    assert curve.length_m == pytest.approx(70.3, abs=0.1)
    assert curve.entry_m - curve.start_m == 20.0
    assert curve_table(x, curvature * 0.4) == []


def test_position_is_set_by_balises_and_curves_and_the_margin_starts_again() -> None:
    n = 10_000
    yaw = np.interp(np.arange(n) * 0.01, [30.0, 36.0, 46.0, 52.0], [0.0, 0.05, 0.05, 0.0])
    recording, true = made_up(np.zeros(n), np.zeros(n + 1), yaw_rate=yaw, start_mps=15.0)
    fixes = pd.DataFrame({"t_s": [10.0, 80.0], "chainage_m": [1150.0, 2200.0 + 3.0], "chainage_sd_m": [0.1, 0.1]})
    described = recording.description.model_copy(update={"fixes": Fixes(file="-")})
    recording = replace(recording, fixes=fixes, description=described)
    table = curve_table(*survey(replace(recording, fixes=fixes[:1])).to_numpy().T)
    moved = [
        CurvePoints(
            *(p + 8.0 for p in (c.start_m, c.entry_m, c.enter_m, c.leave_m, c.exit_m, c.end_m)), c.curvature_1pm
        )
        for c in table
    ]
    result = composite_positioning.run(recording, curve_points=moved)
    error = (
        result.trajectory["chainage_m"] - 1000.0 - np.interp(result.trajectory["t_s"], np.arange(n + 1) * 0.01, true)
    )
    assert result.events["kind"].tolist() == ["fix used", "curve used", "fix used"]
    for t, expected in ((20.0, 0.0), (70.0, 8.0), (90.0, 3.0)):
        assert float(np.interp(t, result.trajectory["t_s"], error)) == pytest.approx(expected, abs=0.3)
    margin = result.trajectory["margin_m"]
    assert float(margin.iloc[950]) == pytest.approx(20.0 + 0.02 * 15.0 * 15.1, abs=0.1)
    assert margin.max() < 20.0 + 0.02 * 15.0 * 60.0


@pytest.fixture(scope="module")
def wet() -> list[Simulation]:
    return [simulate("slippery-line", seed=seed) for seed in (2, 3, 4, 8)]


def legs(simulation: Simulation, result: BaselineResult) -> Array:
    """Errors, %, of the distances between neighbouring balises with slip between them, the wheel's true scale known."""
    assert simulation.slips is not None
    assert simulation.recording.fixes is not None
    t = result.trajectory["t_s"]
    at = simulation.recording.fixes["t_s"].to_numpy()
    at = at[at < t.iloc[-1]]
    found = np.diff(np.interp(at, t, result.trajectory["chainage_m"])) * simulation.wheel_scale
    true = np.diff(np.interp(at, simulation.truth["t_s"], simulation.truth["chainage_m"]))
    start, end = simulation.slips["start_s"].to_numpy(), simulation.slips["end_s"].to_numpy()
    slipped = [bool(((start < b) & (end > a)).any()) for a, b in pairwise(at)]
    return np.asarray(100.0 * (found / true - 1.0)[slipped])


def wrong_starts(simulation: Simulation, result: BaselineResult) -> int:
    """Corrections that start while the wheel already slips."""
    assert simulation.slips is not None
    begins = slips_of(result)["start_s"].to_numpy()[:, None]
    inside = (begins > simulation.slips["start_s"].to_numpy()) & (begins < simulation.slips["end_s"].to_numpy())
    return int(inside.any(axis=1).sum())


def test_most_distances_between_balises_are_within_two_percent(wet: list[Simulation]) -> None:
    errors = np.concatenate([legs(one, composite_positioning.run(one.recording, reset_at_fixes=False)) for one in wet])
    assert len(errors) > 5
    assert np.median(np.abs(errors)) < 0.5
    assert np.mean(np.abs(errors) < 2.0) > 0.8


def test_the_setback_avoids_wrong_start_points(wet: list[Simulation]) -> None:
    with_setback = sum(wrong_starts(one, composite_positioning.run(one.recording)) for one in wet)
    without = sum(wrong_starts(one, composite_positioning.run(one.recording, setback_s=0.0)) for one in wet)
    assert without > with_setback


def test_curves_surveyed_on_another_run_set_the_position_to_some_ten_metres(wet: list[Simulation]) -> None:
    first, second = simulate("slippery-line", seed=4, run=1), wet[2]
    table = curve_table(*survey(first.recording).to_numpy().T)
    without = composite_positioning.run(second.recording, reset_at_fixes=False)
    result = composite_positioning.run(second.recording, curve_points=table, reset_at_fixes=False)
    used = result.events["kind"] == "curve used"
    assert used.sum() >= 5
    assert used.sum() >= (result.events["kind"] == "curve refused").sum()
    steps = np.diff(result.trajectory["chainage_m"] - without.trajectory["chainage_m"])
    after = np.flatnonzero(np.abs(steps) > 0.01) + 1
    true = np.interp(result.trajectory["t_s"], second.truth["t_s"], second.truth["chainage_m"])
    errors = (result.trajectory["chainage_m"] - true).to_numpy()[after]
    assert np.abs(errors).max() < 20.0
    assert errors.std() < 10.0


def test_needs_a_tachometer_and_some_seconds() -> None:
    recording, _ = made_up(np.zeros(1000), np.zeros(1001))
    with pytest.raises(BadInputError, match="no tachometer"):
        composite_positioning.run(replace(recording, tach=None))
    short, _ = made_up(np.zeros(250), np.zeros(251))
    with pytest.raises(BadInputError, match="expected more than 3 s"):
        composite_positioning.run(short)
