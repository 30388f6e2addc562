"""The whole smoother on sound, damaged and odd runs: each solved with honest sigmas or refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.inertial import LOW_COST
from trackfg.datasets.effects.mounting import RoughTrack
from trackfg.datasets.faults import drop_imu, drop_tach
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.errors import BadInputError, UnsolvableError
from trackfg.factors.bias import OF_GYRO_RATE
from trackfg.factors.family import Family
from trackfg.factors.motion import non_holonomic
from trackfg.factors.states import Kind
from trackfg.graph import motion
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.recording.description import Fixes, ImuNoise
from trackfg.recording.model import Recording
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.result import Result
from trackfg.sensors.dead_reckoning import initial_path
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.tach import read_wheel
from trackfg.smoothing.smoother import SmoothedStates, smooth, smooth_states

ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")
PLACE = ("east_m", "north_m", "up_m")
ALL = ("chainage_m", *PLACE, "speed_mps", *ATTITUDE)
TOTAL_S = 150.0


def solved(recording: Recording) -> SmoothedStates:
    smoothed = smooth_states(recording, SmoothConfig())
    assert smoothed.solution.converged, smoothed.solution.reason
    return smoothed


def errors(run: Simulation, trajectory: pd.DataFrame) -> pd.DataFrame:
    """Error of each quantity on the trajectory's clock. Chainage from the start where no fix says where that is."""
    t = trajectory["t_s"].to_numpy()
    chainage = run.ride.chainage(run.ride.motion.distance(t))
    if run.recording.fixes is None:
        chainage = chainage - run.ride.chainage(run.ride.motion.distance(0.0))
    truth = np.column_stack([chainage, run.ride.position(t), run.ride.motion.speed(t), run.ride.rpy(t)])
    out = trajectory[list(ALL)] - truth
    out["yaw_rad"] = (out["yaw_rad"] + np.pi) % (2 * np.pi) - np.pi
    out.insert(0, "t_s", t)
    return out


def assert_honest(run: Simulation, smoothed: SmoothedStates, columns: tuple[str, ...] = ALL) -> None:
    """Errors within 4 sigma, save that one epoch in a hundred may reach 5.

    Where the vehicle is at rest for the attitude and the speed only: a place between keyframes at rest has a test of
    its own.
    """
    error, trajectory = errors(run, smoothed.trajectory), smoothed.trajectory
    moving = ~at_rest(smoothed)
    for column in columns:
        ratio = np.abs(error[column] / trajectory[f"{column}_sd"])
        ratio = ratio[moving] if column in ("chainage_m", *PLACE) and moving.any() else ratio
        if moving.any() or column not in ("chainage_m", *PLACE):
            assert np.quantile(ratio, 0.99) < 4.0, column
            assert ratio.max() < 5.0, column


def at_rest(smoothed: SmoothedStates) -> np.ndarray:
    """Which rows of the trajectory lie in a standstill, or in the keyframe interval next to one."""
    t, keyframes = smoothed.trajectory["t_s"].to_numpy(), smoothed.problem.t
    resting = np.zeros(t.size, dtype=bool)
    for start, end in smoothed.problem.rests:
        first, last = np.searchsorted(keyframes, [start - 1e-6, end + 1e-6])
        resting |= (t >= keyframes[max(first - 1, 0)]) & (t <= keyframes[min(last, keyframes.size - 1)])
    return resting


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("mainline", 0),
        ("mainline", 3),
        ("mainline-gnss", 0),
        ("trolley", 3),
        ("shunting", 0),
        ("shunting-unsigned", 3),
        ("parked", 3),
        ("no-stop", 0),
    ],
)
def test_every_kind_of_run_is_solved_honestly(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates], name: str, seed: int
) -> None:
    """Among them: no stop at all, nothing but a stop, reversing with a signed and with an unsigned tach."""
    result = smoothed(name, seed=seed, duration_s=TOTAL_S)
    assert result.solution.converged
    assert_honest(simulated(name, seed=seed, duration_s=TOTAL_S), result)


@pytest.mark.parametrize(("name", "mm_per_km"), [("mainline", 15.0), ("shunting", 5.0), ("mainline-gnss", 1.0)])
def test_noise_free_run_is_recovered(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates], name: str, mm_per_km: float
) -> None:
    """Without GNSS only the accelerometer and a fix or two determine the wheel's scale, which has to be found: as well
    as the accelerometer's own scale is known, which is not exactly."""
    options = {"seed": 1, "duration_s": TOTAL_S, "noise": False}
    run, result = simulated(name, **options), smoothed(name, **options)
    error = errors(run, result.trajectory)
    assert np.abs(error[list(ATTITUDE)].to_numpy()).max() < 1e-5
    length_km = run.ride.motion.path(TOTAL_S) / 1000.0
    assert np.ptp(error["chainage_m"]) < 1e-3 * mm_per_km * max(length_km, 1.0)


@pytest.mark.parametrize("name", ["mainline", "trolley", "parked"])
def test_places_at_rest_are_honest(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates], name: str
) -> None:
    options = {"seed": 3, "duration_s": TOTAL_S}
    result = smoothed(name, **options)
    ratio = errors(simulated(name, **options), result.trajectory) / result.trajectory[
        [f"{c}_sd" for c in ALL]
    ].set_axis(list(ALL), axis=1)
    assert ratio.loc[at_rest(result), ["chainage_m", *PLACE]].abs().max().max() < 5.0


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("mainline", {"seed": 3, "duration_s": 150.0}),
        ("trolley", {"seed": 0, "duration_s": 120.0}),
        ("shunting", {"seed": 0, "duration_s": 240.0}),
        ("axle-box", {"seed": 1, "duration_s": 100.0}),
        ("measuring-car", {"seed": 0, "duration_s": 100.0}),
    ],
)
def test_full_world_is_solved_honestly(
    simulated_in_full: Callable[..., Simulation],
    smoothed_in_full: Callable[..., SmoothedStates],
    name: str,
    options: dict[str, Any],
) -> None:
    """Rough track, an IMU whose axes are not quite square, a car body on springs."""
    result = smoothed_in_full(name, **options)
    assert result.solution.converged
    assert_honest(simulated_in_full(name, **options), result)


def test_scale_factors_and_misalignments_are_found(simulated: Callable[..., Simulation]) -> None:
    """A gyro that turns 0.3 % too far and senses its yaw in roll by 1 mrad: both show in curves."""
    run = simulated("mainline-gnss", seed=2, duration_s=300.0)
    imu, gyro = run.recording.imu.copy(), ["wx_radps", "wy_radps", "wz_radps"]
    W = np.zeros((3, 3))
    W[2, 2], W[0, 2] = 3e-3, 1e-3
    imu[gyro] = imu[gyro].to_numpy() @ (np.eye(3) + W).T
    noise = ImuNoise(
        **run.recording.description.imu.noise.model_dump()
        | {"gyro_scale_sd": 2e-3, "accel_scale_sd": 2e-3, "misalignment_sd_rad": 6e-4, "g_sensitivity_sd": 2e-5}
    )
    described = run.recording.description
    described = described.model_copy(update={"imu": described.imu.model_copy(update={"noise": noise})})
    result = solved(replace(run.recording, imu=imu, description=described))
    found = result.solution.states.imu[0, OF_GYRO_RATE].reshape(3, 3)
    sd = np.sqrt(np.diagonal(result.covariance.of(Kind.IMU)[0]))[OF_GYRO_RATE].reshape(3, 3)
    assert sd[0, 2] < 0.7 * noise.misalignment_sd_rad
    assert sd[2, 2] < 0.9 * noise.gyro_scale_sd
    for row, column in ((2, 2), (0, 2)):
        assert abs(found[row, column] - W[row, column]) < 3.5 * sd[row, column]
    assert_honest(run, result)


def mounted(recording: Recording, rpy_deg: tuple[float, float, float]) -> Recording:
    """Return what the sensor would record if it were turned in the vehicle, undeclared."""
    R_vs = matrix_from_rpy(*(np.radians(angle) for angle in rpy_deg))
    imu = recording.imu.copy()
    for triad in (imu.columns[1:4], imu.columns[4:7]):
        imu[triad] = imu[triad].to_numpy() @ R_vs
    return replace(recording, imu=imu)


@pytest.mark.parametrize(("pitch", "yaw"), [(-2.8, 0.0), (0.0, 6.8), (0.0, -10.0)])
def test_direction_of_travel_is_found_wherever_the_sensor_points(
    simulated: Callable[..., Simulation], pitch: float, yaw: float
) -> None:
    """Attitude, speed and distance are those of the vehicle. The sensor sees it turned back."""
    run = simulated("mainline", seed=0, duration_s=TOTAL_S)
    result = solved(mounted(run.recording, (0.0, pitch, yaw)))
    assert_honest(run, result)
    sd = np.degrees(np.sqrt(np.diagonal(result.covariance.of(Kind.MOUNT)[0])))[:2]
    seen = np.degrees(result.solution.states.mount[0, :2])
    assert (np.abs(seen + np.array([pitch, yaw])) < 4.0 * sd).all()
    assert (sd < 0.1).all()


@pytest.mark.parametrize("place", [(10.0, 0.0, 0.0), (-2.0, 0.5, 2.0)])
def test_place_of_the_sensor_is_found_in_curves(place: tuple[float, float, float]) -> None:
    """A car body on springs, whose recording says nothing of where the sensor is."""
    plan = scenario("slippery-line")
    run = simulate(replace(plan, imu=replace(plan.imu, lever_arm_m=place)), seed=0, duration_s=TOTAL_S)
    imu = run.recording.description.imu.model_copy(update={"lever_arm_m": (0.0, 0.0, 0.0)})
    recording = replace(run.recording, description=run.recording.description.model_copy(update={"imu": imu}))
    result = solved(recording)
    assert_honest(run, result, ("chainage_m", *ATTITUDE))
    seen, sd = result.solution.states.mount[0, 2:], np.sqrt(np.diagonal(result.covariance.of(Kind.MOUNT)[0]))[2:]
    assert (np.abs(seen + place)[:2] < 4.0 * sd[:2]).all()
    assert sd[0] < 0.5


@pytest.mark.parametrize("from_sensor", [False, True])
def test_an_antenna_is_declared_from_the_sensor_or_from_where_the_sensor_is_not(from_sensor: bool) -> None:
    """The sensor is 0.6 m aside, and its recording does not say so: positions show from where the antenna was seen."""
    aside, plan = np.array([0.0, 0.6, 0.0]), scenario("mainline-gnss")
    run = simulate(replace(plan, imu=replace(plan.imu, lever_arm_m=(0.0, 0.6, 0.0))), seed=2, duration_s=240.0)
    declared = run.recording.description
    assert declared.gnss is not None
    assert declared.unplaced_antenna is None
    imu = type(declared.imu)(**declared.imu.model_dump(exclude={"lever_arm_m"}))
    place = np.array(declared.gnss.lever_arm_m) - from_sensor * aside
    gnss = declared.gnss.model_copy(update={"lever_arm_m": tuple(place.tolist())})
    description = declared.model_copy(update={"imu": imu, "gnss": gnss})
    smoothed = solved(replace(run.recording, description=description))
    assert_honest(run, smoothed, ("chainage_m", "speed_mps"))
    elsewhere, sd = smoothed.solution.states.sensor[0], np.sqrt(np.diagonal(smoothed.covariance.of(Kind.SENSOR)[0]))
    assert (np.abs(elsewhere + (not from_sensor) * aside[:2]) < 3.0 * sd).all()
    assert (sd < 0.3).all()


def test_rough_track_does_not_shorten_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """A body on springs turns against its path, by 6 mrad on track of 10 mm. Were the sigma of what it moves sideways
    one of a known speed, slower motion would be likelier, and the wheel found smaller, with which only a poor sensor is
    compared.
    """
    plan = scenario("mainline")
    plan = replace(plan, imu=replace(plan.imu, rate_hz=50.0, noise=LOW_COST), balises=None)

    def error(level_mm: float) -> float:
        """Return the mean error of the distance of three runs, in its sigmas."""
        errors = []
        for seed in (1, 2, 3):
            run = simulate(replace(plan, effects=(RoughTrack(level_mm),)), seed=seed, duration_s=200.0)
            found = solved(run.recording).trajectory
            errors.append(np.ptp(found["chainage_m"]) - np.ptp(run.truth["chainage_m"]))
            errors[-1] /= found["chainage_m_sd"].iloc[-1]
        return float(np.mean(errors))

    def of_known_speed(*arguments: Any) -> Family:
        family = non_holonomic(*arguments)
        return family.with_data(growth=np.zeros_like(family.data["growth"]))

    smooth_track, rough_track = error(1.0), error(10.0)
    assert rough_track == pytest.approx(smooth_track, abs=0.3)
    monkeypatch.setattr(motion, "non_holonomic", of_known_speed)
    assert error(10.0) < smooth_track - 0.5


def test_hole_of_5_s_in_the_imu(simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates]) -> None:
    run, whole = (f("mainline", seed=0, duration_s=TOTAL_S) for f in (simulated, smoothed))
    holed = solved(drop_imu(run.recording, 100.0, 105.0))
    assert_honest(run, holed)
    inside = holed.trajectory["t_s"].between(101.0, 104.0)
    for column in ("roll_rad", "pitch_rad", "yaw_rad"):
        sd = [s.trajectory.loc[inside, f"{column}_sd"].mean() for s in (whole, holed)]
        assert sd[1] > 2.0 * sd[0]


def test_minute_without_the_tach(simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates]) -> None:
    run, whole = (f("mainline", seed=1, duration_s=TOTAL_S) for f in (simulated, smoothed))
    silent = solved(drop_tach(run.recording, 80.0, 140.0))
    assert_honest(run, silent)
    inside = silent.trajectory["t_s"].between(90.0, 130.0)
    sd = [s.trajectory.loc[inside, "speed_mps_sd"].mean() for s in (whole, silent)]
    assert sd[1] > sd[0]
    after = silent.trajectory["t_s"] > 141.0
    ratio = (errors(run, silent.trajectory)["chainage_m"] / silent.trajectory["chainage_m_sd"])[after]
    assert np.abs(ratio).max() < 4.0


def test_no_tach_but_gnss(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline-gnss", seed=0, duration_s=TOTAL_S)
    result = smooth(replace(run.recording, tach=None))
    assert result.summary.solver.converged
    assert result.summary.wheel_scale is None
    assert result.summary.clock_offset_s is None
    assert_honest(run, solved(replace(run.recording, tach=None)))


def test_neither_tach_nor_gnss_leaves_the_attitude(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=0, duration_s=TOTAL_S)
    alone = solved(replace(run.recording, tach=None, fixes=None))
    assert_honest(run, alone, ("roll_rad", "pitch_rad"))
    assert alone.trajectory["roll_rad_sd"].max() < 0.05
    # What is not known is said to be unknown.
    assert alone.trajectory["speed_mps_sd"].iloc[1000:].min() > 10.0


def test_parked_without_a_tach(simulated: Callable[..., Simulation]) -> None:
    run = simulated("parked", seed=0, duration_s=60.0)
    assert_honest(run, solved(replace(run.recording, tach=None)), ("roll_rad", "pitch_rad"))


def test_falling_chainage_is_the_same_run(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=0, duration_s=100.0)
    track = run.recording.description.track.model_copy(update={"direction": -1})
    description = run.recording.description.model_copy(update={"track": track})
    up, down = (solved(r).trajectory for r in (run.recording, replace(run.recording, description=description)))
    np.testing.assert_allclose(down["chainage_m"], -up["chainage_m"], atol=1e-9)
    pd.testing.assert_frame_equal(up.drop(columns="chainage_m"), down.drop(columns="chainage_m"))


def test_a_path_for_a_recording_is_refused() -> None:
    with pytest.raises(TypeError, match=r"takes a recording, as trackfg\.read_recording\(folder\) gives, not str"):
        smooth("run1")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"takes settings as trackfg\.SmoothConfig\..* gives, not dict"):
        smooth(simulate("mainline", duration_s=5.0).recording, {"output": {}})  # type: ignore[arg-type]


def _without_a_rate(sound: Recording) -> Recording:
    imu = sound.imu.copy()
    imu.loc[1, "wx_radps"] = np.nan
    return replace(sound, imu=imu)


UNREADABLE: dict[str, tuple[Callable[[Recording], Recording], str]] = {
    "NaN": (_without_a_rate, r"^table 'imu', column 'wx_radps', data row 2 .*: empty or NaN; expected a finite"),
    "a column of another name": (
        lambda sound: replace(sound, imu=sound.imu.rename(columns={"wz_radps": "wz"})),
        r"^table 'imu', column 'wz_radps': there is no such column; expected t_s, wx_radps,"),
    "time that falls": (
        lambda sound: replace(sound, imu=sound.imu[::-1].reset_index(drop=True)),
        r"^table 'imu', column 't_s', data row 2 .*: earlier than the row before"),
    "dates": (
        lambda sound: replace(sound, imu=sound.imu.assign(t_s=pd.to_datetime(sound.imu["t_s"], unit="s"))),
        r"^table 'imu', column 't_s': holds datetime64.*; expected numbers, s"),
    "numbers that pandas has of its own": (
        lambda sound: replace(sound, imu=sound.imu.astype("Float64")),
        r"^table 'imu', column 't_s': holds Float64; expected numbers, s, as NumPy .* Hint: convert .* astype"),
    "a description that was not validated": (
        lambda sound: replace(sound, description=sound.description.model_dump()),
        r"^description: is of type dict; expected a RecordingDescription. Hint: RecordingDescription.model_validate"),
    "an array": (
        lambda sound: replace(sound, tach=sound.imu.to_numpy()),
        r"^table 'tach': is of type ndarray; expected a pandas.DataFrame"),
    "a sigma of zero": (
        lambda sound: replace(sound, fixes=sound.fixes.assign(chainage_sd_m=0.0)),
        r"^table 'fixes', column 'chainage_sd_m', data row 1 .*: 0: a sigma that is zero"),
    "times in ms": (
        lambda sound: replace(sound, imu=sound.imu.assign(t_s=1000.0 * sound.imu["t_s"])),
        r"^table 'imu', column 't_s': rows are 5 s apart .*Hint: the times look like ms: multiply the times by 0.001"),
    "times in ns": (
        lambda sound: replace(sound, imu=sound.imu.assign(t_s=1e9 * sound.imu["t_s"])),
        r"^table 'imu', column 't_s': rows are 5e\+06 s apart .*Hint: the times look like ns: multiply"),
    "a first row of another clock": (
        lambda sound: replace(sound, imu=sound.imu.assign(t_s=sound.imu["t_s"] - 1e9 * (sound.imu.index == 0))),
        r"^table 'imu', column 't_s', data row 2 .*: no rows for 1e\+09 s before this one; expected at most"),
    "a tach without rows": (
        lambda sound: replace(sound, tach=sound.tach.iloc[:0]),
        r"^table 'tach': the table is empty; expected at least 2 data rows. Hint: leave the sensor out"),
    "a tach of one row": (
        lambda sound: replace(sound, tach=sound.tach.iloc[:1]), r"^table 'tach': the table has 1 row; expected"),
    "a tach that is not described": (
        lambda sound: replace(sound, description=sound.description.model_copy(update={"tach": None})),
        r"^table 'tach': the recording has this table, but its description has no \[tach\]"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREADABLE)
def test_tables_in_memory_are_refused_by_the_rules_of_files(name: str) -> None:
    spoil, message = UNREADABLE[name]
    recording = simulate("mainline", seed=1, duration_s=20.0).recording
    fixes = pd.DataFrame({"t_s": [5.0], "chainage_m": [10.0], "chainage_sd_m": [0.2]})
    described = recording.description.model_copy(update={"fixes": Fixes(file="fixes.csv")})
    with pytest.raises(BadInputError, match=message):
        smooth(spoil(replace(recording, description=described, fixes=fixes)))


def test_a_part_of_a_run_may_have_no_fixes() -> None:
    recording = simulate("mainline", seed=1, duration_s=20.0).recording
    fixes = pd.DataFrame({"t_s": [5.0], "chainage_m": [10.0], "chainage_sd_m": [0.2]})
    described = recording.description.model_copy(update={"fixes": Fixes(file="fixes.csv")})
    assert smooth(replace(recording, description=described, fixes=fixes.iloc[:0])).summary.converged


@pytest.mark.parametrize("duration_s", [0.005, 0.3])
def test_recording_too_short_is_refused(simulated: Callable[..., Simulation], duration_s: float) -> None:
    recording = simulated("mainline", seed=0, duration_s=TOTAL_S).recording
    imu = recording.imu[recording.imu["t_s"] < duration_s]
    with pytest.raises(
        UnsolvableError, match=r"IMU record has \d+ samples .*at least 10 samples and 0\.5 s are needed"
    ):
        smooth(replace(recording, imu=imu))


def test_one_second_is_enough(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline", seed=0, duration_s=TOTAL_S).recording
    result = smooth(replace(recording, imu=recording.imu[recording.imu["t_s"] < 1.0]))
    assert np.isfinite(result.trajectory.to_numpy()).all()


def test_beats_dead_reckoning(simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates]) -> None:
    """Against the cheap pass that it starts from: attitude in rms on each run, height over five."""
    heights = []
    for seed in range(5):
        run, result = (f("mainline", seed=seed, duration_s=TOTAL_S) for f in (simulated, smoothed))
        recording = run.recording
        path = initial_path(
            recording, intervals(recording), read_wheel(recording, 5.0), result.problem.rests, np.zeros(3), 0.0
        )
        t = result.trajectory["t_s"].to_numpy()
        rough = np.stack([np.interp(t, path.t, path.rpy[:, c]) for c in range(2)], axis=1) - run.ride.rpy(t)[:, :2]
        fine = errors(run, result.trajectory)[["roll_rad", "pitch_rad"]].to_numpy()
        assert np.sqrt(np.mean(fine**2)) < 0.8 * np.sqrt(np.mean(rough**2))
        place = np.interp(t, path.t, path.p[:, 2]) - run.ride.position(t)[:, 2]
        heights.append([np.mean(errors(run, result.trajectory)[PLACE[2]] ** 2), np.mean(place**2)])
    smoother, reckoned = np.sqrt(np.mean(heights, axis=0))
    assert smoother < 0.5 * reckoned


def test_result_survives_the_folder(simulated: Callable[..., Simulation], tmp_path: Path) -> None:
    result = smooth(simulated("shunting", seed=0, duration_s=60.0).recording)
    assert len(result.events)
    back = Result.read(result.write(tmp_path / "out"))
    pd.testing.assert_frame_equal(back.trajectory, result.trajectory)
    pd.testing.assert_frame_equal(back.events, result.events, check_dtype=False)
    assert back.summary == result.summary
    assert tuple(result.trajectory.columns) == TRAJECTORY_COLUMNS


def test_output_clock_is_uniform_and_as_fast_as_asked(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline", seed=0, duration_s=60.0).recording
    config = SmoothConfig()
    fast = config.model_copy(update={"output": config.output.model_copy(update={"rate_hz": 50.0})})
    slow_table, fast_table = (smooth(recording, c).trajectory for c in (config, fast))
    np.testing.assert_allclose(slow_table["t_s"], np.arange(len(slow_table)) / 10.0, atol=1e-12)
    np.testing.assert_allclose(fast_table["t_s"], np.arange(len(fast_table)) / 50.0, atol=1e-12)
    np.testing.assert_allclose(
        fast_table[list(ALL)].to_numpy()[::5][: len(slow_table)], slow_table[list(ALL)], atol=1e-3
    )


@pytest.mark.parametrize(("name", "table"), [("slippery-line-two-axles", "tach/2"), ("slippery-line-radar", "speed/1")])
def test_summary_has_the_scale_of_each_further_sensor(name: str, table: str) -> None:
    recording = simulate(name, seed=1, duration_s=120.0).recording
    (sensor,) = recording.others
    rows = recording.others[sensor]
    less = rows.assign(**{rows.columns[1]: rows.iloc[:, 1] / 1.004})
    summary, scaled = (smooth(replace(recording, others={sensor: one})).summary for one in (rows, less))
    assert list(summary.further_scales) == [table] == [sensor]
    assert scaled.wheel_scale is not None
    assert summary.wheel_scale is not None
    ratio, other = (one.further_scales[table].value / one.wheel_scale.value for one in (summary, scaled))
    assert other == pytest.approx(1.004 * ratio, abs=2e-4)


def test_summary_has_no_scale_of_a_further_sensor_without_rows() -> None:
    recording = simulate("slippery-line-two-axles", seed=1, duration_s=50.0).recording
    assert not smooth(replace(recording, others={})).summary.further_scales


def test_summary_says_what_was_estimated(simulated: Callable[..., Simulation]) -> None:
    run = simulated("trolley", seed=0, duration_s=TOTAL_S)
    summary = smooth(run.recording).summary
    assert summary.recording_id == "trolley-seed0-run0"
    assert summary.wheel_scale is not None
    assert abs(summary.wheel_scale.value - run.wheel_scale) < 4.0 * summary.wheel_scale.sd
    for name, estimate in (
        ("gyro_bias_{}_radps", summary.gyro_bias_radps),
        ("accel_bias_{}_mps2", summary.accel_bias_mps2),
    ):
        true = run.truth[[name.format(axis) for axis in "xyz"]].iloc[-1].to_numpy()
        assert (np.abs(np.array(estimate.value) - true) < 4.0 * np.array(estimate.sd)).all()
    assert summary.distance_m == pytest.approx(run.ride.motion.path(TOTAL_S), rel=0.02)
    assert summary.duration_s == pytest.approx(TOTAL_S)


def test_progress_names_every_stage(simulated: Callable[..., Simulation]) -> None:
    seen: list[tuple[str, float]] = []
    smooth(simulated("parked", seed=0, duration_s=60.0).recording, progress=lambda *step: seen.append(step))
    assert list(dict.fromkeys(name for name, _ in seen)) == [
        "graph",
        "solve",
        "covariance",
        "check",
        "output",
        "geometry",
    ]
    assert all(0.0 <= done <= 1.0 for _, done in seen)


def test_same_recording_gives_the_same_result(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("trolley", seed=0, duration_s=90.0).recording
    one, other = (smooth(recording) for _ in range(2))
    pd.testing.assert_frame_equal(one.trajectory, other.trajectory, check_exact=True)


@pytest.mark.slow
def test_coverage_over_seeds(simulated_in_full: Callable[..., Simulation]) -> None:
    """The truth lies within 1.96 sd as often as it should, over 20 trolleys of 75 s in the full world.

    In the world as designed roll would be covered too often: its sigma holds misalignments that are not there.
    """
    inside: dict[str, list[float]] = {column: [] for column in ("roll_rad", "speed_mps", "chainage_m")}
    for seed in range(20):
        run = simulated_in_full("trolley", seed=seed, duration_s=75.0)
        trajectory = solved(run.recording).trajectory
        error = errors(run, trajectory)
        for column, shares in inside.items():
            shares.append(float(np.mean(np.abs(error[column]) < 1.96 * trajectory[f"{column}_sd"])))
    for column, shares in inside.items():
        assert 0.88 < np.mean(shares) < 0.995, (column, np.mean(shares))
