"""Scenarios: each runs, repeats, and is what its name says."""

import gc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from trackfg import datasets
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.line.irregularities import IrregularityModel
from trackfg.datasets.line.line import GivenLine
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.scenario import Recorder
from trackfg.datasets.sensors.clocks import ClockModel, DropModel
from trackfg.datasets.vehicle.adhesion import draw_slip
from trackfg.datasets.vehicle.ride import Ride
from trackfg.errors import BadInputError
from trackfg.io.reader import read_recording
from trackfg.io.truth import read_truth
from trackfg.numerics.rotations import so3_exp, so3_log

from .conftest import at_50_hz

NAMES = list(datasets.scenarios())
TRUTH_COLUMNS = [
    *("t_s", "chainage_m", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad", "wheel_scale"),
    *(f"gyro_bias_{axis}_radps" for axis in "xyz"),
    *(f"accel_bias_{axis}_mps2" for axis in "xyz"),
]


@cache
def simulated(name):
    """A run of 50 s. Nobody may change its tables."""
    return datasets.simulate(name, seed=1, duration_s=50.0)


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_runs_and_is_read_back(name, tmp_path):
    simulation = simulated(name)
    assert list(simulation.truth.columns) == TRUTH_COLUMNS
    assert np.isfinite(simulation.truth.to_numpy()).all()
    asked = scenario(name)
    lost = "imu" in asked.recorders
    assert len(simulation.recording.imu) == pytest.approx(50 * asked.imu.rate_hz, abs=50 if lost else 0)
    assert len(simulation.truth) == 50 * 20 + 1
    simulation.write(tmp_path / "run")
    again = read_recording(tmp_path / "run")
    assert again.imu.equals(simulation.recording.imu)
    assert again.tach.equals(simulation.recording.tach)
    assert read_truth(tmp_path / "run").equals(simulation.truth)


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_repeats_to_the_bit_and_two_differ(name):
    first, again = simulated(name), datasets.simulate(name, seed=1, duration_s=50.0)
    assert first.recording.imu.equals(again.recording.imu)
    assert first.recording.tach.equals(again.recording.tach)
    assert first.truth.equals(again.truth)
    other = datasets.simulate(name, seed=2, duration_s=5.0).recording.imu
    assert not first.recording.imu.head(len(other)).equals(other)


@pytest.mark.parametrize(
    ("name", "short_s", "long_s"),
    [
        ("mainline-field", 120.0, 150.0),
        ("measuring-car", 70.0, 90.0),
        ("slippery-line-leaves", 100.0, 120.0),
        ("shuttle", 100.0, 120.0),
        ("axle-box", 50.0, 60.0),
        ("shunting", 100.0, 200.0),
        ("trolley", 70.0, 100.0),
        ("parked", 10.0, 20.0),
        ("no-stop", 100.0, 150.0),
    ],
)
def test_a_longer_run_begins_like_a_shorter_one(name, short_s, long_s):
    short, long = (datasets.simulate(name, seed=5, run=1, duration_s=duration) for duration in (short_s, long_s))
    for table in ("imu", "tach", "fixes", "gnss", *short.recording.lasers):
        # What passes at the very end is not in the shorter one, and the last stamp has one neighbour less.
        ours, theirs = (tables_of(run.recording).get(table) for run in (short, long))
        if ours is not None:
            np.testing.assert_allclose(theirs[: len(ours) - 1], ours[:-1], rtol=0, atol=1e-7, err_msg=table)
    # Nor does the bias go on to the last row, half a sample after the last centre.
    n = len(short.truth) - 1
    np.testing.assert_allclose(long.truth[:n], short.truth[:n], rtol=0, atol=1e-8)


def tables_of(recording):
    one_each = {name: getattr(recording, name) for name in ("imu", "tach", "fixes", "gnss")}
    return one_each | recording.lasers


def test_a_motion_that_ends_with_the_recording_leaves_no_mark():
    """Beyond its last phase the motion goes on as before, and so does what the body makes of the track."""
    end = float(datasets.simulate("no-stop", duration_s=60.0).ride.motion.duration_s)
    at_end, later = (datasets.simulate("no-stop", duration_s=duration, noise=False) for duration in (end, end + 30.0))
    n = len(at_end.recording.imu)
    assert at_end.ride.motion.duration_s == end
    assert later.ride.motion.duration_s > end + 1.0
    np.testing.assert_allclose(at_end.recording.accel, later.recording.accel[:n], atol=1e-6)
    np.testing.assert_allclose(at_end.recording.gyro, later.recording.gyro[:n], atol=1e-8)


def test_runs_of_one_seed_are_over_one_track():
    first, second, other = (
        datasets.simulate("mainline", seed=seed, run=run, duration_s=100.0) for seed, run in ((1, 0), (1, 1), (2, 0))
    )
    s = np.linspace(0.0, 1500.0, 500)
    for function in ("curvature", "cant", "grade"):
        ours, again, others = (getattr(run.track.line, function)(s) for run in (first, second, other))
        assert np.array_equal(ours, again)
        assert not np.array_equal(ours, others)
    assert np.array_equal(first.track.irregularities.at(s), second.track.irregularities.at(s))
    assert not np.array_equal(first.track.irregularities.at(s), other.track.irregularities.at(s))
    assert not first.truth["chainage_m"].equals(second.truth["chainage_m"])
    assert first.wheel_scale != second.wheel_scale
    assert not first.recording.imu.equals(second.recording.imu)


def test_irregularities_are_drawn_once_while_a_run_has_them_and_then_again_alike():
    first, second = (datasets.simulate("mainline", seed=9, run=run, duration_s=10.0) for run in (0, 1))
    drawn = first.track.irregularities.functions
    assert second.track.irregularities.functions is drawn
    rougher = replace(scenario("mainline"), irregularities=IrregularityModel("high"))
    assert datasets.simulate(rougher, seed=9, duration_s=10.0).track.irregularities.functions is not drawn
    del first, second
    gc.collect()
    again = datasets.simulate("mainline", seed=9, duration_s=10.0).track.irregularities.functions
    assert again is not drawn
    assert np.array_equal(again.c, drawn.c)


def test_mainline_is_a_local_train():
    truth = datasets.simulate(at_50_hz(scenario("mainline")), duration_s=1800.0).truth
    assert 45 / 3.6 < np.ptp(truth["chainage_m"]) / truth["t_s"].iloc[-1] < 75 / 3.6
    # Where the rails dip, the body's x axis does too, and it is a little faster than the place on the designed line.
    assert 80 / 3.6 < truth["speed_mps"].max() <= 120 / 3.6 * (1.0 + 1e-4)
    stops = np.flatnonzero(np.diff((truth["speed_mps"] == 0).astype(int)) == 1)
    assert len(stops) >= 4


def test_parked_never_moves_and_no_stop_never_rests():
    parked = datasets.simulate(at_50_hz(scenario("parked")), duration_s=300.0).truth
    assert (parked["speed_mps"] == 0).all()
    assert datasets.simulate(at_50_hz(scenario("no-stop")), duration_s=600.0).truth["speed_mps"].min() > 10.0


def test_trolley_stands_a_minute_then_walks():
    truth = datasets.simulate(at_50_hz(scenario("trolley"))).truth
    assert (truth["speed_mps"][truth["t_s"] < 60] == 0).all()
    walking = truth["speed_mps"][truth["t_s"] > 70]
    assert walking.mean() == pytest.approx(0.92, abs=0.03)
    assert walking.min() > 0.8


@pytest.mark.parametrize("name", ["shunting", "shunting-unsigned"])
def test_shunting_turns_round(name):
    simulation = datasets.simulate(at_50_hz(scenario(name)))
    direction = np.sign(simulation.truth["speed_mps"])
    turns = np.count_nonzero(np.diff(direction[direction != 0]))
    assert turns >= 4
    steps = np.diff(simulation.recording.tach["distance_m"])
    assert (steps.min() < 0) == (name == "shunting")


def test_noise_free_sensors_are_perfect():
    simulation = datasets.simulate("mainline-gnss", duration_s=120.0, noise=False)
    truth, recording = simulation.truth, simulation.recording
    assert (truth["wheel_scale"] == 1).all()
    assert recording.description.tach.kind == "distance"
    distance = np.interp(truth["t_s"], recording.tach["t_s"], recording.tach["distance_m"])
    np.testing.assert_allclose(distance, truth["chainage_m"] - truth["chainage_m"][0], atol=1e-3)
    noisy = datasets.simulate("mainline-gnss", duration_s=120.0)
    assert noisy.truth["east_m"].equals(truth["east_m"])


def test_truth_attitude_follows_from_the_noise_free_gyro():
    simulation = datasets.simulate("trolley", duration_s=120.0, noise=False)
    turns = so3_exp(simulation.recording.gyro / 200.0)
    R = simulation.ride.rotation(np.zeros(1))[0]
    for turn in turns:
        R = R @ turn
    last = simulation.ride.rotation(np.array([120.0]))[0]
    # The gyro turns with the plumb line of the round Earth, by the distance run over its radius.
    travelled = np.abs(simulation.truth["chainage_m"].diff()).sum()
    np.testing.assert_allclose(so3_log(last.T @ R), [0.0, travelled / 6.371e6, 0.0], atol=2e-8)


def test_heading_and_origin_are_declared_where_there_is_a_latitude():
    georeferenced = datasets.simulate("mainline-gnss", duration_s=30.0)
    track = georeferenced.recording.description.track
    yaw = georeferenced.truth["yaw_rad"][0]
    assert np.cos(np.radians(90 - track.heading_deg) - yaw) == pytest.approx(1.0)
    assert georeferenced.recording.gnss_origin[0] == track.latitude_deg
    local = datasets.simulate("mainline", duration_s=30.0)
    assert local.recording.gnss_origin is None
    assert local.truth["yaw_rad"][0] == pytest.approx(0.0, abs=1e-12)
    back = datasets.simulate("shuttle", run=1, duration_s=30.0)
    assert back.truth["yaw_rad"][0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", ["mainline", "measuring-car", "shunting"])
def test_at_rest_the_true_speed_is_exactly_zero(name):
    simulation = datasets.simulate(at_50_hz(scenario(name)), duration_s=400.0)
    t = simulation.truth["t_s"].to_numpy()
    rests = simulation.ride.motion.speed(t) == 0.0
    assert rests[1:].any()
    assert np.array_equal(simulation.truth["speed_mps"] == 0.0, rests)
    # A car body rocks on its springs for a while after a stop, but it goes nowhere.
    assert np.abs(simulation.ride.speed_along_body(t[rests])).max() < 1e-3


def test_slips_and_slides_are_as_frequent_and_as_long_as_reported():
    """44 in 18 runs over 14.5 km; nine of ten slides last no longer than 10 s; the axle creeps by 1-60 %."""
    events = [slips_of("slippery-line", seed) for seed in range(60)]
    drawn = [event for each in events for event in each]
    assert 2.0 < np.mean([len(each) for each in events]) < 6.0
    assert np.percentile([len(each) for each in events], 95) <= 14
    assert all(1.0 <= event.duration_s <= 30.0 for event in drawn)
    assert np.mean([event.duration_s <= 10.0 for event in drawn if event.kind == "slide"]) >= 0.9
    creeps = np.abs([event.creep for event in drawn])
    assert 0.005 < creeps.min() < 0.02 < 0.4 < creeps.max() <= 0.6
    assert np.mean([len(slips_of("slippery-line-leaves", seed)) for seed in range(10)]) > 20


def slips_of(name, seed):
    plan, rng = scenario(name), np.random.default_rng(seed)
    line = random_line(plan.line, plan.length_m, rng)
    ride = Ride(line, plan.driver.drive(line, plan.duration_s, rng))
    return draw_slip(ride, plan.adhesion, plan.duration_s, rng).events


@pytest.mark.parametrize("name", ["mainline", "measuring-car"])
def test_recorders_stamp_and_lose_rows_as_asked(name):
    plan = scenario(name)
    offset = Recorder(ClockModel(offset_s=0.2, drift=1e-4), DropModel(probability=0.2))
    recorders = dict.fromkeys(("imu", "tach", "lasers"), offset)
    clean, changed = (
        datasets.simulate(replace(plan, recorders=chosen), duration_s=100.0) for chosen in ({}, recorders)
    )
    for table, whole in tables_of(clean.recording).items():
        if whole is None or table == "fixes":
            continue
        kept = tables_of(changed.recording)[table]
        assert len(kept) == pytest.approx(0.8 * len(whole), rel=0.05), table
        true_t = (kept["t_s"] + 0.2) / (1.0 - 1e-4)
        row = np.searchsorted(whole["t_s"], true_t - 1e-6)
        np.testing.assert_allclose(whole["t_s"].to_numpy()[row], true_t, atol=1e-9)
        assert np.array_equal(whole.to_numpy()[row, 1:], kept.to_numpy()[:, 1:])
    assert changed.tach_time_offset_s == 0.2
    assert changed.truth.equals(clean.truth)
    times = [table["t_s"] for table in changed.recording.lasers.values()]
    assert all(t.equals(times[0]) for t in times)


def test_runs_there_and_back_share_a_vehicle():
    runs = [datasets.simulate("shuttle", seed=3, run=run, duration_s=10.0) for run in range(4)]
    (first, second, third, fourth) = (run.mount_rpy_rad for run in runs)
    assert first == second != third == fourth
    assert all(first)
    assert runs[0].wheel_scale == runs[1].wheel_scale != runs[2].wheel_scale == runs[3].wheel_scale
    assert [run.recording.description.imu.id for run in runs] == [f"seed3-vehicle{k}" for k in (0, 0, 1, 1)]
    biases = [run.truth["accel_bias_y_mps2"][0] for run in runs]
    assert len(set(biases)) == 4


def test_without_a_shared_vehicle_every_run_has_its_own():
    plan = replace(scenario("shuttle"), runs_per_vehicle=1)
    there, back = (datasets.simulate(plan, seed=3, run=run, duration_s=10.0) for run in (0, 1))
    assert there.mount_rpy_rad != back.mount_rpy_rad
    assert there.wheel_scale != back.wheel_scale
    assert back.recording.description.imu.id == "seed3-vehicle1"
    # Where nothing of the mounting is drawn there is nothing to share.
    perfect = datasets.simulate(plan, seed=3, duration_s=10.0, noise=False)
    assert perfect.recording.description.imu.id is None
    assert datasets.simulate("mainline", duration_s=10.0).recording.description.imu.id is None


def test_flanges_knock_in_the_sharp_curves_of_the_axle_box_scenario():
    plan = scenario("axle-box")
    with_knocks, without = (
        datasets.simulate(replace(plan, flange_knocks=on), seed=1, duration_s=200.0, noise=False)
        for on in (True, False)
    )
    off = np.abs(with_knocks.truth["roll_rad"] - without.truth["roll_rad"])
    s = with_knocks.ride.motion.distance(with_knocks.truth["t_s"])
    sharp = np.abs(with_knocks.track.line.curvature(s)) > 1 / 400
    assert off[sharp].max() > 1e-4
    assert off[~sharp].max() < 1e-4
    assert with_knocks.truth_geometry.equals(without.truth_geometry)


def test_a_scenario_on_a_given_line(make_line):
    line = make_line([0, 500, 560, 800, 860, 3000], [0, 0, 0.002, 0.002, 0, 0], stations=[1500.0])
    given = GivenLine("branch", replace(line, start_yaw_rad=0.5), gauge_m=1.435, chainage_origin_m=12_000.0)
    shuttle = scenario("shuttle").on(given)
    there, back = (datasets.simulate(shuttle, run=run, duration_s=300.0) for run in (0, 1))
    assert there.recording.description.id == "shuttle-on-branch-seed0-run0"
    assert there.recording.description.track.gauge_m == 1.435
    assert there.truth["chainage_m"][0] == 12_050.0
    assert there.truth["yaw_rad"][0] == pytest.approx(0.0, abs=1e-12)  # without GNSS a heading means nothing
    with_gnss = datasets.simulate(scenario("mainline-gnss").on(given), duration_s=60.0)
    assert with_gnss.truth["yaw_rad"][0] == pytest.approx(0.5, abs=3e-3)
    assert back.truth["chainage_m"][0] == 14_950.0
    # Balises stay where they are, whichever way they are passed: every kilometre.
    for run in (there, back):
        assert len(run.recording.fixes) >= 1
        np.testing.assert_allclose(run.recording.fixes["chainage_m"] % 1000.0 % 999.0, 0.0, atol=1.0)


@pytest.mark.parametrize("name", ["mainline", "no-stop", "shunting", "trolley", "parked"])
def test_a_line_too_short_is_refused(name, make_line):
    short = GivenLine("siding", make_line([0, 40], [0, 0]), gauge_m=1.067)
    with pytest.raises(BadInputError, match="the line is 40 m long: expected"):
        datasets.simulate(scenario(name).on(short), duration_s=300.0)


def test_bad_requests_are_refused():
    with pytest.raises(BadInputError, match="mainline-gnss"):
        datasets.simulate("main-line")
    with pytest.raises(BadInputError, match="duration_s"):
        datasets.simulate("mainline", duration_s=-5.0)
    for name, value in [("seed", "a"), ("seed", None), ("seed", -1), ("seed", 1.5), ("run", -1), ("run", "a")]:
        with pytest.raises(BadInputError, match=f"{name} {value!r}: expected a whole number of 0 or more"):
            datasets.simulate("mainline", **{name: value})
    for name, value in [("duration_s", "a"), ("truth_rate_hz", 0), ("truth_rate_hz", "a")]:
        with pytest.raises(BadInputError, match=f"{name} {value!r}: expected a number"):
            datasets.simulate("mainline", **{name: value})
    with pytest.raises(BadInputError, match="scenario 3: expected"):
        datasets.simulate(3)


def test_every_scenario_says_what_it_is():
    for name, each in datasets.scenarios().items():
        assert each.name == name
        assert len(each.summary) > 15
