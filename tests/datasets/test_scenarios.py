"""Scenarios: each runs, repeats, and is what its name says."""

import numpy as np
import pytest

from trackfg import datasets
from trackfg.errors import BadInputError
from trackfg.frames import so3_exp, so3_log
from trackfg.recording_io import read_recording, read_truth

NAMES = list(datasets.scenarios())
TRUTH_COLUMNS = [
    *("t_s", "chainage_m", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad", "wheel_scale"),
    *(f"gyro_bias_{axis}_radps" for axis in "xyz"),
    *(f"accel_bias_{axis}_mps2" for axis in "xyz"),
]


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_runs_and_is_read_back(name, tmp_path):
    simulation = datasets.simulate(name, seed=1, duration_s=80.0)
    assert list(simulation.truth.columns) == TRUTH_COLUMNS
    assert np.isfinite(simulation.truth.to_numpy()).all()
    assert len(simulation.recording.imu) == 80 * 200
    assert len(simulation.truth) == 80 * 20 + 1
    simulation.write(tmp_path / "run")
    again = read_recording(tmp_path / "run")
    assert again.imu.equals(simulation.recording.imu)
    assert again.tach.equals(simulation.recording.tach)
    assert read_truth(tmp_path / "run").equals(simulation.truth)


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_repeats_to_the_bit_and_two_differ(name):
    first, again, other = (datasets.simulate(name, seed=seed, duration_s=40.0) for seed in (3, 3, 4))
    assert first.recording.imu.equals(again.recording.imu)
    assert first.recording.tach.equals(again.recording.tach)
    assert first.truth.equals(again.truth)
    assert not first.recording.imu.equals(other.recording.imu)


def test_a_longer_run_begins_like_a_shorter_one():
    short = datasets.simulate("mainline-gnss", duration_s=60.0)
    long = datasets.simulate("mainline-gnss", duration_s=90.0)
    np.testing.assert_allclose(long.recording.imu[:12_000], short.recording.imu, rtol=0, atol=1e-12)
    np.testing.assert_allclose(long.truth[:1200], short.truth[:1200], rtol=0, atol=1e-9)


def test_mainline_is_a_local_train():
    truth = datasets.simulate("mainline").truth
    assert 60 / 3.6 < np.ptp(truth["chainage_m"]) / truth["t_s"].iloc[-1] < 70 / 3.6
    assert truth["speed_mps"].max() <= 95 / 3.6 + 1e-6
    stops = np.flatnonzero(np.diff((truth["speed_mps"] == 0).astype(int)) == 1)
    assert len(stops) >= 8


def test_parked_never_moves_and_no_stop_never_rests():
    parked = datasets.simulate("parked").truth
    assert (parked["speed_mps"] == 0).all()
    assert datasets.simulate("no-stop").truth["speed_mps"].min() > 10.0


def test_trolley_stands_a_minute_then_walks():
    truth = datasets.simulate("trolley").truth
    assert (truth["speed_mps"][truth["t_s"] < 60] == 0).all()
    walking = truth["speed_mps"][truth["t_s"] > 70]
    assert walking.mean() == pytest.approx(0.92, abs=0.03)
    assert walking.min() > 0.8


@pytest.mark.parametrize("name", ["shunting", "shunting-unsigned"])
def test_shunting_turns_round(name):
    simulation = datasets.simulate(name)
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
    np.testing.assert_allclose(so3_log(last.T @ R), [0.0, travelled / 6.371e6, 0.0], atol=1e-9)


def test_heading_and_origin_are_declared_where_there_is_a_latitude():
    georeferenced = datasets.simulate("mainline-gnss", duration_s=30.0)
    track = georeferenced.recording.description.track
    yaw = georeferenced.truth["yaw_rad"][0]
    assert np.cos(np.radians(90 - track.heading_deg) - yaw) == pytest.approx(1.0)
    assert georeferenced.recording.gnss_origin[0] == track.latitude_deg
    local = datasets.simulate("mainline", duration_s=30.0)
    assert local.recording.gnss_origin is None
    assert local.truth["yaw_rad"][0] == 0


def test_bad_requests_are_refused():
    with pytest.raises(BadInputError, match="mainline-gnss"):
        datasets.simulate("main-line")
    with pytest.raises(BadInputError, match="duration_s"):
        datasets.simulate("mainline", duration_s=-5.0)


def test_every_scenario_says_what_it_is():
    for name, scenario in datasets.scenarios().items():
        assert scenario.name == name
        assert len(scenario.summary) > 15
