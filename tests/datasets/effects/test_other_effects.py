"""Positions, mounting, clocks, sensors and driving are as rough as their effects say; and every effect has a name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.catalogue import EFFECTS, effect
from trackfg.datasets.effects.clocks import ClockJump, DelayedStamps, FilledHoles, LateAccelerometer
from trackfg.datasets.effects.driving import Creeping, LongRest, TurningEarth
from trackfg.datasets.effects.inertial import LowCost, Noise, Slow, Warming
from trackfg.datasets.effects.mounting import LeverArm, RoughTrack, SpringRoll, Tilt
from trackfg.datasets.effects.positions import Canyon, LateGnss, ScatteredFixes, WrongFixes
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.numerics import units
from trackfg.recording.description import ImuNoise

from ..conftest import at_50_hz


def fix_errors(simulation):
    fixes, truth = simulation.recording.fixes, simulation.truth
    return fixes["chainage_m"].to_numpy() - np.interp(fixes["t_s"], truth["t_s"], truth["chainage_m"])


def test_every_effect_is_documented_with_its_magnitudes_and_their_source():
    page = (Path(__file__).parents[3] / "docs" / "datasets.md").read_text()
    for name, kind in EFFECTS.items():
        assert effect(name) == kind.make(kind.magnitudes[-1])
        magnitudes = f"{', '.join(f'{magnitude:g}' for magnitude in kind.magnitudes)} {kind.unit}".strip()
        assert f"| `{name}` | {kind.summary} | {magnitudes} | {kind.source} |" in page


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(BadInputError, match=r"wobble.*imu-noise.*wrong-fixes"):
        effect("wobble")


@pytest.mark.parametrize("name", [name for name in EFFECTS if name not in ("long-rest", "creeping")])
def test_an_effect_changes_the_recording_and_not_what_the_oracle_rides(name, run):
    effects = (effect(name),), (replace(effect(name), for_oracle=True),), ()
    # The first curve, and enough fixes for one to be wrong, come after 45 s.
    duration_s = 60.0 if name in ("curve-rolling", "wrong-fixes") else 45.0
    simulation, oracle, clean = (run(*some, duration_s=duration_s) for some in effects)
    recording = simulation.recording
    same = [recording.tables[table].equals(clean.recording.tables[table]) for table in ("imu", "tach", "fixes", "gnss")]
    assert not all(same)
    assert simulation.truth["chainage_m"].equals(oracle.truth["chainage_m"])
    assert np.isfinite(recording.imu.to_numpy()).all()


def test_an_effect_repeats_to_the_bit(run):
    effects = effect("idling"), effect("wrong-fixes"), effect("canyon")
    first, again = (run.__wrapped__(*effects).recording for _ in range(2))
    assert all(again.tables[name].equals(table) for name, table in first.tables.items())


def test_without_noise_no_effect_touches_the_recording():
    plan = replace(scenario("mainline"), effects=(Noise(10.0), effect("weak-creep")))
    perfect = simulate(plan, duration_s=90.0, noise=False).recording
    assert perfect.imu.equals(simulate("mainline", duration_s=90.0, noise=False).recording.imu)


def test_noise_is_so_many_times_the_declared_one(run):
    noisy, clean = run(Noise(3.0)).recording, run().recording
    noise = clean.description.imu.noise
    assert noisy.description.imu.noise == noise
    for column, white in (("gyro", noise.gyro_white), ("accel", noise.accel_white)):
        added = getattr(noisy, column) - getattr(clean, column)
        assert added.std() == pytest.approx(np.sqrt(8.0 * 200.0) * white, rel=0.01)
    oracle = run(Noise(3.0, for_oracle=True)).recording.description.imu.noise
    assert (oracle.gyro_white, oracle.accel_white) == pytest.approx((3.0 * noise.gyro_white, 3.0 * noise.accel_white))


def test_a_sensor_warms_up_and_its_biases_follow(run):
    added = run(Warming(40.0)).recording.gyro - run().recording.gyro
    assert np.abs(added[0]).max() < 1e-7
    assert 1e-5 < np.abs(added[-1]).max() < 40.0 * 3.0 * 0.1 / 125.0 * np.pi / 180.0


def test_a_low_cost_sensor_has_its_bias_and_declares_nothing(run):
    plan = replace(scenario("mainline"), effects=(LowCost(1.0),))
    biases = [simulate(plan, seed=seed, duration_s=5.0).recording.gyro.mean(axis=0) for seed in range(20)]
    assert np.degrees(np.std(biases)) == pytest.approx(1.0, rel=0.2)
    assert run(LowCost(1.0)).recording.description.imu.noise == ImuNoise()
    assert run(LowCost(1.0, for_oracle=True)).recording.description.imu.noise.gyro_bias_sd == pytest.approx(
        np.radians(1.0)
    )


def test_wrong_fixes_are_those_of_other_balises(run):
    errors = fix_errors(run(WrongFixes(0.2)))
    wrong = np.abs(errors) > 1.0
    assert np.count_nonzero(wrong) == round(0.2 * len(errors))
    assert errors[wrong] == pytest.approx(50.0 * np.rint(errors[wrong] / 50.0), abs=1.0)
    oracle = run(WrongFixes(0.2, for_oracle=True))
    assert np.abs(fix_errors(oracle)).max() < 1.0
    assert len(oracle.recording.fixes) == len(errors) - wrong.sum()


def test_scattered_fixes_scatter(run):
    errors = fix_errors(run(ScatteredFixes(2.0)))
    assert errors.std() == pytest.approx(2.0, rel=4.0 / np.sqrt(2 * len(errors)))
    assert run(ScatteredFixes(2.0)).recording.fixes["chainage_sd_m"].max() == pytest.approx(0.1)
    assert run(ScatteredFixes(2.0, for_oracle=True)).recording.fixes["chainage_sd_m"].min() > 2.0


def test_canyons_are_correlated_and_between_them_nothing_is_added(run):
    t = np.arange(20_000.0)
    table = pd.DataFrame({"t_s": t} | dict.fromkeys(run().recording.gnss.columns[1:], 0.0 * t))
    open_sky = replace(run().recording, gnss=table)
    made = Canyon(5.0).recorded(open_sky, run().ride, np.random.default_rng(0)).gnss
    added = made[["east_m", "north_m", "up_m"]].to_numpy()
    inside = added.any(axis=1)
    assert inside.mean() == pytest.approx(0.5, abs=0.1)
    assert np.sqrt(np.mean(np.sum(added[inside, :2] ** 2, axis=1))) == pytest.approx(5.0, rel=0.1)
    assert added[inside, 2].std() == pytest.approx(2.0 * 5.0 / np.sqrt(2.0), rel=0.1)
    both = inside[1:] & inside[:-1]
    correlation = np.mean(added[1:][both] * added[:-1][both]) / np.mean(added[inside] ** 2)
    assert correlation == pytest.approx(np.exp(-1.0 / 20.0), abs=0.02)


def test_late_positions_are_stamped_late(run):
    late, clean = run(LateGnss(1.0)).recording.gnss, run().recording.gnss
    assert late["t_s"].to_numpy() == pytest.approx(clean["t_s"].to_numpy() + 1.0)
    assert late["east_m"].equals(clean["east_m"])


def test_a_lever_arm_is_measured_and_not_declared(run):
    far, oracle = run(LeverArm(10.0)).recording, run(LeverArm(10.0, for_oracle=True)).recording
    assert far.description.imu.lever_arm_m == (0.0, 0.0, 0.0)
    assert np.linalg.norm(oracle.description.imu.lever_arm_m) == pytest.approx(10.0)
    assert far.imu.equals(oracle.imu)
    near = run(LeverArm(0.1)).recording
    # Centripetal acceleration along x in curves is -omega^2 times the arm.
    curve = np.abs(far.gyro[:, 2]) > 0.02
    assert curve.any()
    sensed = (far.accel - near.accel)[curve, 0].mean()
    assert sensed == pytest.approx(-9.9 / np.hypot(1.0, 0.2) * np.mean(far.gyro[curve, 2] ** 2), rel=0.5)


def test_a_tilted_sensor_measures_gravity_aside(run):
    tilted, clean = run(Tilt(3.0)).recording, run().recording
    still = slice(0, 2000)
    turned = tilted.accel[still].mean(axis=0) - clean.accel[still].mean(axis=0)
    expected = units.STANDARD_GRAVITY * np.sin(np.radians(3.0))
    assert np.abs(turned[:2]) == pytest.approx([expected, expected], rel=0.05)
    assert np.linalg.norm(tilted.gyro, axis=1) == pytest.approx(np.linalg.norm(clean.gyro, axis=1))


def test_a_body_leans_by_its_share_of_the_deficiency(run):
    soft, stiff = run(SpringRoll(0.4)), run(SpringRoll(0.0))
    t = soft.truth["t_s"].to_numpy()
    s = soft.ride.motion.distance(t)
    line = soft.track.line
    deficiency = line.curvature(s) * soft.ride.motion.speed(t) ** 2 / units.STANDARD_GRAVITY + line.rpy(s)[:, 0]
    leaning = (soft.truth["roll_rad"] - stiff.truth["roll_rad"]).to_numpy()
    assert np.polyfit(deficiency, leaning, 1)[0] == pytest.approx(0.4, rel=0.1)
    assert not soft.recording.description.imu.rigid
    assert run(SpringRoll(0.4, declared_rigid=True)).recording.description.imu.rigid


def test_a_body_moves_in_proportion_to_the_roughness_of_the_track(run):
    """Against the path of its reference point it pitches by some mrad on its springs."""
    against_path = []
    for level_mm in (3.0, 6.0):
        simulation = run(RoughTrack(level_mm))
        truth, moving = simulation.truth, simulation.truth["speed_mps"].to_numpy() > 10.0
        climb = np.gradient(truth["up_m"], truth["t_s"])[moving] / truth["speed_mps"].to_numpy()[moving]
        against_path.append(np.std(truth["pitch_rad"].to_numpy()[moving] + climb))
        assert not simulation.recording.description.imu.rigid
    assert against_path[0] == pytest.approx(2e-3, rel=0.5)
    assert against_path[1] == pytest.approx(2.0 * against_path[0], rel=0.05)


def test_stamps_on_arrival_are_late_and_in_order(run):
    delay = (run(DelayedStamps(5.0)).recording.imu["t_s"] - run().recording.imu["t_s"]).to_numpy()
    assert np.all(np.diff(run(DelayedStamps(5.0)).recording.imu["t_s"]) > 0.0)
    assert delay.min() > 0.0
    assert 5e-3 < delay.mean() < 12e-3


def test_a_clock_jumps_once(run):
    jumped = np.round(run(ClockJump(5.0)).recording.imu["t_s"] - run().recording.imu["t_s"], 9)
    assert np.unique(jumped).tolist() == [0.0, 5.0]
    assert np.count_nonzero(np.diff(jumped)) == 1


def test_holes_are_filled_by_straight_lines(run):
    sound, filled = run().recording.imu, run(FilledHoles(1.0)).recording.imu
    left = run(replace(FilledHoles(1.0), for_oracle=True)).recording.imu
    assert 1.0 - len(left) / len(sound) == pytest.approx(0.1, abs=0.03)
    assert filled["t_s"].equals(sound["t_s"])
    kept = filled["t_s"].isin(left["t_s"])
    pd.testing.assert_frame_equal(filled[kept].reset_index(drop=True), left)
    bends = np.diff(filled.to_numpy()[:, 1:], 2, axis=0)
    in_hole = ~kept.to_numpy()[1:-1]
    assert np.abs(bends[in_hole]).max() < 1e-9 < np.abs(bends[~in_hole]).min(axis=0).max()


def test_forces_are_later_than_rates(run):
    sound, late = run().recording, run(LateAccelerometer(20.0)).recording
    assert np.array_equal(late.gyro, sound.gyro)
    np.testing.assert_allclose(late.accel[4:], sound.accel[:-4], atol=1e-9)  # 20 ms at 200 Hz


def test_a_slow_sensor_passes_half_of_the_power_at_its_frequency(run):
    sound, slow = run().recording, run(Slow(20.0)).recording
    f = np.fft.rfftfreq(len(sound.imu), 0.005)
    for before, after in ((sound.gyro, slow.gyro), (sound.accel, slow.accel)):
        power = [np.abs(np.fft.rfft(samples - samples.mean(axis=0), axis=0)) ** 2 for samples in (before, after)]
        for low, high, share in ((19.0, 21.0, 0.5), (2.0, 3.0, 0.98), (60.0, 90.0, 0.02)):
            some = (f > low) & (f < high)
            passed = power[1][some].sum(axis=0) / power[0][some].sum(axis=0)
            assert passed == pytest.approx(share, abs=0.1)


def test_creeping_is_slow():
    truth = simulate(at_50_hz(replace(scenario("mainline"), effects=(Creeping(0.5),))), duration_s=300.0).truth
    speed = truth["speed_mps"].to_numpy()
    assert speed.max() <= 0.5 + 1e-9
    assert speed[truth["t_s"] > 40.0].min() >= 0.1 - 1e-9


def test_a_long_rest_is_long_and_the_end_is_at_rest():
    plan = at_50_hz(replace(scenario("mainline"), effects=(LongRest(0.1),)))
    truth = simulate(plan, duration_s=1200.0).truth
    still = truth["speed_mps"].to_numpy() == 0.0
    t = truth["t_s"].to_numpy()
    assert t[~still].min() == pytest.approx(360.0, abs=0.2)
    assert still[t > 800.0].all()


def test_a_line_with_loops_turns_about_and_shows_no_heading():
    plan = at_50_hz(replace(scenario("mainline"), effects=(TurningEarth(35.0),)))
    simulation = simulate(plan, duration_s=600.0)
    assert np.ptp(simulation.truth["yaw_rad"]) > np.pi
    track = simulation.recording.description.track
    assert (track.latitude_deg, track.heading_deg) == (35.0, None)
    oracle = simulate(
        replace(plan, effects=(TurningEarth(35.0, for_oracle=True),)), duration_s=60.0
    ).recording.description.track
    assert oracle.heading_deg is not None
