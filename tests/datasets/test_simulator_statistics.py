"""A simulated run is what its scenario asks for, within statistical error: measured on tables, as a user gets them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import CubicSpline, make_interp_spline

from trackfg import datasets
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.line.irregularities import IrregularityModel, spectra
from trackfg.datasets.line.line import GivenLine, Line, piecewise_linear
from trackfg.datasets.sensors.imu_errors import ImuResponse
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.vehicle.vehicle import Rigid

from .conftest import at_50_hz

STEP_M = 0.25


ROUGH = IrregularityModel(
    "high", level_d1_sd_m=1.5e-3, alignment_d1_sd_m=1.1e-3, cross_level_d1_sd_m=1.3e-3, gauge_d1_sd_m=0.7e-3
)


@pytest.fixture(scope="module")
def straight_geometry():
    """Truth of 20 km of straight level track in bad order, in mm: whatever there is, is irregularity."""
    flat = piecewise_linear(np.array([0.0, 25_000.0]), np.zeros(2))
    line = Line(flat, flat, flat, 25_000.0, 1.5, np.zeros(1), np.array([30.0]), np.zeros(0))
    plan = replace(scenario("no-stop"), irregularities=ROUGH).on(GivenLine("straight", line, 1.435))
    fast = replace(plan.driver, speed_mps=(30.0, 32.0))
    slow_imu = replace(plan.imu, rate_hz=50.0)
    run = datasets.simulate(replace(plan, driver=fast, imu=slow_imu), seed=3, duration_s=650.0)
    return run.truth_geometry.dropna()


def test_d1_standard_deviations(straight_geometry, d1_standard_deviations):
    level, alignment, cross_level, gauge = 1e3 * d1_standard_deviations(ROUGH)
    expected = {
        "level_mm": level,
        "alignment_mm": alignment,
        "level_left_mm": np.hypot(level, 0.5 * cross_level),
        "level_right_mm": np.hypot(level, 0.5 * cross_level),
        "alignment_left_mm": np.hypot(alignment, 0.5 * gauge),
        "alignment_right_mm": np.hypot(alignment, 0.5 * gauge),
    }
    # Some 2000 independent values: 1.6 % is one sigma.
    for name, sd in expected.items():
        assert straight_geometry[name].std() == pytest.approx(sd, rel=0.055), name


def test_spectra(straight_geometry):
    """Versines of the 10 m chord have the gain 1 - cos(5 W), twist has 2 sin(2.5 W)."""
    w = 2 * np.pi * np.fft.rfftfreq(2048, STEP_M)
    level, alignment, cross_level, gauge = 1e6 * spectra(ROUGH, w).T
    chord, twist = (1 - np.cos(5 * w)) ** 2, (2 * np.sin(2.5 * w)) ** 2
    expected = {
        "versine_level_mm": chord * level,
        "versine_alignment_mm": chord * alignment,
        "cross_level_mm": cross_level,
        "twist_mm": twist * cross_level,
        "gauge_mm": gauge,
    }
    within = (w > 2 * np.pi / 100) & (w < 2 * np.pi / 2.2)
    for name, density in expected.items():
        _, measured = signal.welch(straight_geometry[name].to_numpy(), 1 / STEP_M, "hann", 2048)
        seen = within & (density > 0.02 * density[within].max())
        ratio = measured[seen] / (2 * np.pi) / density[seen]
        # 77 windows that overlap by half: 0.14 is one sigma of each frequency.
        assert np.abs(ratio - 1).max() < 0.75, name
        assert ratio.mean() == pytest.approx(1.0, abs=0.05), name


@pytest.fixture(scope="module")
def noisy_and_perfect():
    """A car body with a lever arm and eight lasers, with an IMU whose output follows its input."""
    plan = scenario("measuring-car")
    true_to_input = replace(plan.imu, response=ImuResponse(), lever_arm_m=(1.0, 0.3, 0.6))
    plan = replace(plan, imu=true_to_input, balises=replace(plan.balises, spacing_m=20.0))
    return tuple(datasets.simulate(plan, seed=2, duration_s=240.0, noise=noise) for noise in (True, False))


def test_allan_deviations(noisy_and_perfect, allan_deviation):
    noisy, perfect = noisy_and_perfect
    assert noisy.truth["chainage_m"].equals(perfect.truth["chainage_m"])
    asked = scenario("measuring-car").imu.noise
    truth, t = noisy.truth, noisy.recording.imu["t_s"]
    for sensor, unit, density in (("gyro", "radps", asked.gyro_white), ("accel", "mps2", asked.accel_white)):
        added = getattr(noisy.recording, sensor) - getattr(perfect.recording, sensor)
        bias = np.column_stack([np.interp(t, truth["t_s"], truth[f"{sensor}_bias_{axis}_{unit}"]) for axis in "xyz"])
        for samples in (1, 10, 100, 1000):
            clusters = 3 * len(added) / samples
            deviation = np.sqrt(np.mean(allan_deviation(added - bias, samples) ** 2))
            expected = density / np.sqrt(samples / 200.0)
            assert deviation == pytest.approx(expected, rel=4.0 / np.sqrt(clusters)), (sensor, samples)


def test_biases_walk(noisy_and_perfect):
    truth, asked = noisy_and_perfect[0].truth[:-1], scenario("measuring-car").imu.noise
    for sensor, unit, walk in (("gyro", "radps", asked.gyro_bias_walk), ("accel", "mps2", asked.accel_bias_walk)):
        steps = truth[[f"{sensor}_bias_{axis}_{unit}" for axis in "xyz"]][::20].diff().dropna()
        assert np.sqrt((steps**2).to_numpy().mean()) == pytest.approx(walk, rel=4.0 / np.sqrt(2 * steps.size))


def test_what_is_drawn_once_a_run():
    plan = scenario("shuttle")
    runs = [datasets.simulate(plan, run=run, duration_s=1.0) for run in range(0, 60, 2)]
    drawn = {
        plan.tach.scale_sd: [run.wheel_scale - 1.0 for run in runs],
        plan.imu.noise.gyro_bias_sd: [run.truth["gyro_bias_x_radps"][0] for run in runs],
        plan.imu.noise.accel_bias_sd: [run.truth["accel_bias_z_mps2"][0] for run in runs],
        plan.imu.mount_roll_sd_rad: [run.mount_rpy_rad[0] for run in runs],
        plan.imu.mount_sd_rad: [run.mount_rpy_rad[2] for run in runs],
    }
    for sd, values in drawn.items():
        assert np.sqrt(np.mean(np.square(values))) == pytest.approx(sd, rel=0.45)
        assert abs(np.mean(values)) < 3.5 * sd / np.sqrt(len(values))


@pytest.mark.parametrize("name", ["mainline", "shunting", "shunting-unsigned", "trolley"])
def test_pulse_counts(name):
    plan = at_50_hz(scenario(name))
    run = datasets.simulate(plan, seed=1, duration_s=400.0)
    tach, quantum = run.recording.tach, plan.tach.quantum_m
    count = tach["distance_m"] / quantum
    np.testing.assert_allclose(count, np.round(count), atol=1e-6)
    motion = run.ride.motion
    path = motion.path(tach["t_s"]) if not plan.tach.signed else motion.distance(tach["t_s"]) - motion.distance(0.0)
    creep_m = plan.tach.creep_density * np.sqrt(motion.path(tach["t_s"]))
    off = (count - count[0]) - path / run.wheel_scale / quantum
    assert np.all(np.abs(off) <= 1.0 + 4.5 * creep_m / quantum)
    assert count.abs().max() > 2000


def test_slips_are_in_the_count():
    plan = at_50_hz(scenario("slippery-line-leaves"))
    run = datasets.simulate(plan, seed=1)
    tach, motion = run.recording.tach, run.ride.motion
    assert len(run.slips) > 10
    for slip in run.slips.itertuples():
        counted = np.diff(np.interp([slip.start_s, slip.end_s], tach["t_s"], tach["distance_m"]))[0] * run.wheel_scale
        ran = motion.distance(slip.end_s) - motion.distance(slip.start_s)
        creep_m = plan.tach.creep_density * np.sqrt(max(ran, 1.0))
        resolution = 2 * plan.tach.quantum_m + 0.02 * motion.speed([slip.start_s, slip.end_s]).sum()
        assert counted - ran == pytest.approx(slip.distance_error_m, abs=resolution + 4 * creep_m)
        assert np.sign(slip.distance_error_m) == (1 if slip.kind == "slip" else -1)
    # In all, what the wheel turned too much is what the events added, and the creep below the limit: at most 1 %.
    counted = run.wheel_scale * tach["distance_m"].iloc[-1] - motion.path(tach["t_s"].iloc[-1])
    assert abs(counted - run.slips["distance_error_m"].sum()) < 0.01 * motion.path(tach["t_s"].iloc[-1])


def test_lasers(noisy_and_perfect):
    noisy, perfect = (run.recording.lasers for run in noisy_and_perfect)
    assert len(noisy) == 8
    for model in scenario("measuring-car").lasers:
        added = noisy[model.name]["displacement_m"] - perfect[model.name]["displacement_m"]
        assert added.std() == pytest.approx(model.noise_sd_m, rel=4.0 / np.sqrt(2 * len(added)))
        assert abs(added.mean()) < 4.5 * model.noise_sd_m / np.sqrt(len(added))


def test_lasers_see_the_gauge_and_the_cross_level_of_the_truth(noisy_and_perfect):
    run = noisy_and_perfect[1]
    half, base = 0.5335, 1.067
    d = {name: table["displacement_m"].to_numpy() for name, table in run.recording.lasers.items()}
    t = run.recording.lasers["A-left-lateral"]["t_s"].to_numpy()
    place = np.interp(t, run.truth["t_s"], run.truth["chainage_m"]) + 2.5
    true = run.truth_geometry[["chainage_m", "gauge_mm", "cross_level_mm"]].dropna()
    seen = place < true["chainage_m"].iloc[-1]
    gauge, cross_level = make_interp_spline(true["chainage_m"], true.iloc[:, 1:], k=5)(place[seen]).T
    # In the body's own plane, which is tilted against the track by the springs; in a curve of R 300 it is turned by
    # 8 mrad too.
    tilt = np.arcsin((d["A-left-vertical"] - d["A-right-vertical"])[seen] / (2 * half))
    across = 1e3 * (d["A-left-lateral"] - d["A-right-lateral"] + 2 * half)[seen]
    np.testing.assert_allclose(across / np.cos(tilt), gauge, atol=0.06)
    roll = CubicSpline(run.truth["t_s"], run.truth["roll_rad"])(t[seen])
    np.testing.assert_allclose(1e3 * base * np.sin(roll + tilt), cross_level, atol=0.3)


def test_balises(noisy_and_perfect):
    run = noisy_and_perfect[0]
    fixes, sd = run.recording.fixes, scenario("measuring-car").balises.sd_m
    assert len(fixes) > 50
    error = fixes["chainage_m"] - run.ride.chainage(run.ride.motion.distance(fixes["t_s"]))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(sd, rel=4.0 / np.sqrt(2 * len(fixes)))
    assert (fixes["chainage_sd_m"] == sd).all()


def test_gnss():
    plan = scenario("mainline-gnss")
    run = datasets.simulate(plan, seed=1, duration_s=600.0)
    gnss = run.recording.gnss
    antenna = run.ride.position(gnss["t_s"].to_numpy())
    antenna = antenna + run.ride.rotation(gnss["t_s"].to_numpy()) @ np.array(plan.gnss.antenna_m)
    error = gnss[["east_m", "north_m", "up_m"]].to_numpy() - antenna
    np.testing.assert_allclose(np.std(error, axis=0), plan.gnss.sd_m, rtol=4.0 / np.sqrt(2 * len(gnss)))
    assert np.all(np.abs(error.mean(axis=0)) < 4.0 * np.array(plan.gnss.sd_m) / np.sqrt(len(gnss)))


def test_gnss_in_the_field():
    plan = scenario("mainline-field")
    runs = [
        datasets.simulate(replace(plan, imu=replace(plan.imu, rate_hz=20.0), irregularities=None), seed=seed)
        for seed in range(3)
    ]
    errors, received = [], 0
    for run in runs:
        gnss = run.recording.gnss
        t = gnss["t_s"].to_numpy() + plan.recorders["gnss"].clock.offset_s
        antenna = run.ride.position(t) + run.ride.rotation(t) @ np.array(plan.gnss.antenna_m)
        errors.append((gnss[["east_m", "north_m", "up_m"]].to_numpy() - antenna) / gnss.iloc[:, 4:].to_numpy())
        received += len(gnss)
    error = np.concatenate(errors)
    # Multipath of 30 s: as many independent values as half minutes. Outliers have a share, not a sigma.
    assert np.sqrt(np.median(error**2, axis=0) / 0.4549) == pytest.approx(1.0, abs=0.25)
    assert 0.001 < np.mean(np.abs(error[:, :2]).max(axis=1) > 5.0) < 0.015
    asked = 1.0 - plan.gnss.outages_per_hour * np.mean(plan.gnss.outage_s) / 3600.0
    assert received / (len(runs) * plan.duration_s) == pytest.approx(asked, abs=0.07)


@pytest.fixture(scope="module")
def on_a_wheelset():
    """A wheelset with nothing between it and the track."""
    plan = replace(scenario("no-stop"), vehicle=Rigid())
    return datasets.simulate(plan, seed=4, duration_s=100.0, truth_rate_hz=200.0)


def test_trajectory_and_geometry_are_of_one_track(on_a_wheelset):
    """Cross-level from roll; gradient, curvature, versine from heights and headings of the trajectory."""
    run, geometry = on_a_wheelset, on_a_wheelset.truth_geometry.dropna()
    x = geometry["chainage_m"].to_numpy()

    def at(places):
        times, order = run.ride.motion.times_at(places)
        assert np.array_equal(order, np.arange(len(places)))
        return times

    def roll(places):
        return run.ride.rpy(at(places))[:, 0]

    def yaw(places):
        return run.ride.rpy(at(places))[:, 2]

    def up(places):
        return run.ride.position(at(places))[:, 2]

    base = run.recording.description.track.cross_level_base_m
    found = {
        "cross_level_mm": (1e3 * base * np.sin(roll(x)), 1e-3),
        "twist_mm": (1e3 * base * (np.sin(roll(x)) - np.sin(roll(x - 5.0))), 1e-3),
        "gradient_permille": (1e3 * (up(x + 12.5) - up(x - 12.5)) / 25.0, 1e-4),
        "curvature_1pm": ((yaw(x + 5.0) - yaw(x - 5.0)) / 10.0, 1e-7),
        "versine_level_mm": (1e3 * (up(x) - 0.5 * (up(x - 5.0) + up(x + 5.0))), 1e-3),
    }
    for name, (values, tolerance) in found.items():
        np.testing.assert_allclose(values, geometry[name], rtol=0, atol=tolerance, err_msg=name)


def test_attitude_is_that_of_the_path(on_a_wheelset):
    truth = on_a_wheelset.truth[5:-5]
    path = make_interp_spline(on_a_wheelset.truth["t_s"], on_a_wheelset.truth[["east_m", "north_m", "up_m"]], k=5)
    velocity = path(truth["t_s"], 1)
    speed = np.linalg.norm(velocity, axis=1)
    np.testing.assert_allclose(-np.arcsin(velocity[:, 2] / speed), truth["pitch_rad"], atol=2e-6)
    np.testing.assert_allclose(np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])), truth["yaw_rad"], atol=2e-6)
    np.testing.assert_allclose(speed, truth["speed_mps"], atol=1e-5)


def test_there_and_back_the_track_is_the_same():
    """A run back faces decreasing chainage; its geometry faces increasing chainage like that of the run there."""
    balises = BaliseModel(spacing_m=1000.0, sd_m=0.1, places_m=(100.0, 3900.0))
    plan = replace(scenario("shuttle"), length_m=4000.0, duration_s=600.0, balises=balises)
    there, back = (datasets.simulate(plan, seed=1, run=run) for run in (0, 1))
    assert (there.ride.direction, back.ride.direction) == (1, -1)
    assert there.truth["speed_mps"].max() > 0.0
    assert back.truth["speed_mps"].max() > 0.0
    assert np.diff(back.truth["chainage_m"]).max() <= 0.0
    both = there.truth_geometry.merge(back.truth_geometry, on="chainage_m", suffixes=("", "_back")).dropna()
    assert len(both) > 0.9 * len(there.truth_geometry)
    for name in there.truth_geometry.columns[1:]:
        scale = there.truth_geometry[name].std()
        np.testing.assert_allclose(both[f"{name}_back"], both[name], rtol=0, atol=1e-3 * scale, err_msg=name)
    # One place, seen from both sides: heights agree but for the origin, which is where each run starts.
    heights = [np.interp([1000.0, 3000.0], *ordered(run)) for run in (there, back)]
    assert np.diff(heights[0])[0] == pytest.approx(np.diff(heights[1])[0], abs=2e-3)
    # The two balises stand still.
    fixes = [np.sort(run.recording.fixes["chainage_m"]) for run in (there, back)]
    np.testing.assert_allclose(fixes[0], fixes[1], atol=1.0)


def ordered(run):
    table = run.truth[["chainage_m", "up_m"]].drop_duplicates("chainage_m").sort_values("chainage_m")
    return table["chainage_m"], table["up_m"]


def test_cross_level_d1_of_a_run_through_curves():
    """Cant ramps are too long to be seen in D1; so are transitions and vertical curves."""
    geometry = datasets.simulate("no-stop", seed=1, duration_s=600.0).truth_geometry.dropna()
    asked = scenario("no-stop").irregularities
    assert geometry["level_mm"].std() == pytest.approx(1e3 * asked.level_d1_sd_m, rel=0.08)
    assert geometry["alignment_mm"].std() == pytest.approx(1e3 * asked.alignment_d1_sd_m, rel=0.08)
