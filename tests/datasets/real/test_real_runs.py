"""The loaders of real recordings: axes, signs, clocks and units, checked against the data's own physics."""

import numpy as np
import pytest

from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.errors import BadInputError
from trackfg.io.reader import read_recording, write_recording
from trackfg.numerics import rotations
from trackfg.recording.model import GNSS_COLUMNS, IMU_COLUMNS, TACH_COLUMNS


def _check_tables(recording):
    assert tuple(recording.imu.columns) == IMU_COLUMNS
    assert tuple(recording.gnss.columns) == GNSS_COLUMNS
    for table in (recording.imu, recording.gnss):
        assert np.isfinite(table.to_numpy()).all()
        assert (np.diff(table["t_s"]) > 0).all()
        assert abs(table["t_s"].iloc[0]) < 2.0
    if recording.tach is not None:
        assert tuple(recording.tach.columns) == TACH_COLUMNS
        assert (np.diff(recording.tach["distance_m"]) >= 0).all()


def _check_attitude(run, *, gravity_tolerance):
    """Gyro against the reference's attitude, and gravity with the centripetal term against its tilt."""
    imu, reference = run.recording.imu, run.reference
    t = reference["t_s"].to_numpy()
    R = rotations.matrix_from_rpy(*(reference[f"{axis}_rad"].to_numpy() for axis in ("roll", "pitch", "yaw")))
    turned = rotations.so3_log(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    inside = (t[:-1] > imu["t_s"].iloc[0]) & (t[1:] < imu["t_s"].iloc[-1])
    for i, axis in enumerate("xyz"):
        angle = np.cumsum(np.gradient(imu["t_s"]) * imu[f"w{axis}_radps"])
        measured = np.diff(np.interp(t, imu["t_s"], angle))[inside]
        slope, _ = np.polyfit(turned[inside, i], measured, 1)
        assert slope == pytest.approx(1.0, abs=0.12)
    speed, roll, pitch = (np.interp(imu["t_s"], t, reference[name]) for name in ("speed_mps", "roll_rad", "pitch_rad"))
    tilt = imu["fy_mps2"] - speed * imu["wz_radps"] - 9.8 * np.sin(roll) * np.cos(pitch)
    assert abs(tilt.mean()) < gravity_tolerance
    forward = imu["fx_mps2"] + 9.8 * np.sin(pitch) - np.gradient(speed, imu["t_s"])
    assert abs(forward.mean()) < gravity_tolerance


def test_kitti_is_a_recording_wherever_gtsam_is(tmp_path):
    run = kitti.load()
    recording = run.recording
    _check_tables(recording)
    assert recording.tach is None
    assert len(recording.imu) == 46_968
    assert len(recording.gnss) == len(run.reference) == 470
    assert np.diff(recording.imu["t_s"])[0] == pytest.approx(1.92, abs=0.01)
    assert recording.imu["fz_mps2"].mean() == pytest.approx(9.8, abs=0.05)
    path = np.linalg.norm(np.diff(run.reference[["east_m", "north_m", "up_m"]], axis=0), axis=1).sum()
    assert path == pytest.approx(3700, rel=0.05)
    assert recording.description.imu.noise.gyro_white == 1.75e-4
    write_recording(recording, tmp_path / "kitti")
    assert read_recording(tmp_path / "kitti").imu.equals(recording.imu)


def test_kitti_yaw_rate_turns_the_course():
    run = kitti.load()
    imu, reference = run.recording.imu, run.reference
    east, north, t = (reference[name].to_numpy()[1:] for name in ("east_m", "north_m", "t_s"))
    moving = np.hypot(np.diff(east), np.diff(north)) > 3.0
    course = np.unwrap(np.arctan2(np.diff(north), np.diff(east)))
    yaw = np.interp(0.5 * (t[1:] + t[:-1]), imu["t_s"], np.cumsum(np.gradient(imu["t_s"]) * imu["wz_radps"]))
    pairs = moving[1:] & moving[:-1]
    assert np.corrcoef(np.diff(course)[pairs], np.diff(yaw)[pairs])[0, 1] > 0.97


@pytest.mark.parametrize("gnss", ["BESTPOS", "BESTGPSPOS"])
def test_kingston(data_folder, gnss):
    run = kingston.load(data_folder("kingston"), gnss=gnss)
    recording, reference = run.recording, run.reference
    _check_tables(recording)
    _check_attitude(run, gravity_tolerance=0.02)
    assert recording.description.track.latitude_deg == pytest.approx(44.2325, abs=1e-3)
    fixes = recording.gnss
    east, north, up = (
        fixes[name] - np.interp(fixes["t_s"], reference["t_s"], reference[name])
        for name in ("east_m", "north_m", "up_m")
    )
    horizontal = np.median(np.hypot(east, north)[10:-10])
    if gnss == "BESTPOS":
        assert horizontal < 0.05
        assert up[10:-10].abs().max() < 0.1  # one height, whatever the geoid
    else:
        assert 0.5 < horizontal < 1.5
    assert recording.tach["distance_m"].iloc[-1] == pytest.approx(21_949, abs=1)


def test_kingston_stamps_mark_the_end_of_the_sample(data_folder):
    run = kingston.load(data_folder("kingston"))
    imu, reference = run.recording.imu, run.reference
    edges = np.append(imu["t_s"] - 0.05, imu["t_s"].iloc[-1] + 0.05)
    angle = np.concatenate([[0.0], np.cumsum(0.1 * imu["wz_radps"])])
    rows = reference["t_s"].between(5.0, 3520.0)
    t = reference["t_s"][rows].to_numpy()
    turned = np.diff(reference["yaw_rad"][rows])

    def spread(shift):
        return np.std(np.diff(np.interp(t + shift, edges, angle)) - turned)

    assert spread(0.0) < 0.5 * min(spread(-0.05), spread(0.05))


def test_kingston_speed_is_cut_off_to_whole_km_per_hour(data_folder):
    def scales(centre_speed):
        run = kingston.load(data_folder("kingston"), centre_speed=centre_speed)
        reference, tach = run.reference, run.recording.tach
        t = np.arange(540.0, 3500.0, 5.0)
        true_path = np.concatenate(
            [[0.0], np.cumsum(0.5 * (reference["speed_mps"][1:].to_numpy() + reference["speed_mps"][:-1].to_numpy()))]
        )
        true = np.diff(np.interp(t, reference["t_s"], true_path))
        rolled = np.diff(np.interp(t, tach["t_s"], tach["distance_m"]))
        slow, fast = (true > 20) & (true < 40), true > 60
        return true[slow].sum() / rolled[slow].sum(), true[fast].sum() / rolled[fast].sum()

    slow, fast = scales(centre_speed=False)
    assert slow - fast > 0.005
    slow, fast = scales(centre_speed=True)
    assert abs(slow - fast) < 0.005
    assert fast == pytest.approx(1.0, abs=0.003)


def test_comma2k19(data_folder):
    run = comma2k19.load(data_folder("comma2k19"))
    recording, reference = run.recording, run.reference
    _check_tables(recording)
    _check_attitude(run, gravity_tolerance=0.15)
    enu = reference[["east_m", "north_m", "up_m"]].to_numpy()
    velocity = np.gradient(enu, reference["t_s"], axis=0)
    R = rotations.matrix_from_rpy(*(reference[f"{axis}_rad"].to_numpy() for axis in ("roll", "pitch", "yaw")))
    body = np.einsum("nji,nj->ni", R, velocity).mean(axis=0)
    np.testing.assert_allclose(body / body[0], [1.0, 0.0, 0.0], atol=0.005)  # the mounting is taken out
    span = np.ptp(recording.tach["distance_m"]) / np.sum(np.linalg.norm(np.diff(enu, axis=0), axis=1))
    assert span == pytest.approx(0.99, abs=0.005)


@pytest.mark.parametrize("load", [kingston.load, comma2k19.load])
def test_a_missing_folder_is_named(load, tmp_path):
    with pytest.raises(BadInputError, match=r"expected .* missing: "):
        load(tmp_path / "nowhere")


def test_an_unknown_gnss_table_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="BESTPOS"):
        kingston.load(tmp_path, gnss="GPS")
