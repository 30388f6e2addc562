"""The smoother on three real recordings, scored against what it did not see.

KITTI comes with gtsam; Kingston and comma2k19 are read from a data folder and skipped where it is absent. Every run
uses the default settings with noise levels taken from the residuals (``[noise] adapt = true``); what differs is said in
its row.

    python tools/real_data.py [--data ../shared/data] [--only kitti kingston kingston-outages comma2k19]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.config import NoiseConfig, PositionConfig, SmoothConfig
from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.datasets.real.real_run import RealRun
from trackfg.evaluation.outages import horizontal_errors, score_outages, withhold
from trackfg.evaluation.scores import rms
from trackfg.numerics.spans import Span
from trackfg.numerics.units import DEG_PER_H
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

ADAPT = SmoothConfig(noise=NoiseConfig(adapt=True))
OUTAGES: tuple[Span, ...] = tuple((start, start + 30.0) for start in (60.0, 150.0, 240.0, 330.0, 400.0))
"""Where the KITTI drive loses its positions, s after its start."""
WANTED = ("kitti", "kingston", "kingston-outages", "comma2k19")
START_S, END_S = 660.0, 60.0
"""The Kingston drive has positions that long at its start, two minutes of motion included, and at its end, s."""
OUTAGES_S = (300.0, 600.0)
"""Lengths of its outages in between, s."""
MULTIPATH = PositionConfig(gnss_correlation_s=30.0)


def score_kitti() -> None:
    """Positions withheld for 30 s, five times; they are scored on the receiver's clock as the others show it."""
    drive = kitti.load().recording
    assert drive.gnss is not None
    kept, _ = withhold(drive.gnss, OUTAGES)
    for label, config in (("noise levels from the residuals", ADAPT), ("noise levels as declared", SmoothConfig())):
        result = smooth(replace(drive, gnss=kept), config)
        print(f"\nKITTI, {label} [horizontal rms 1.4 m; straight lines 51 m]")
        clock = result.summary.gnss_clock_offset_s
        assert clock is not None
        measured = drive.gnss.assign(t_s=drive.gnss["t_s"] + clock.value)
        scores = score_outages(result.trajectory, measured, OUTAGES)
        print(scores.to_string(index=False, float_format="{:.2f}".format))
        print(f"solver: {result.summary.reason}")


def score_kingston(folder: Path) -> None:
    """Positions at the ends only, one every 300 s besides, GPS only with outliers."""
    for centred in (True, False):
        run = kingston.load(folder, centre_speed=centred)
        speed = "speed centred on its 1 km/h step" if centred else "speed as recorded (cut off to whole km/h)"
        kept = ends(run.recording)
        _report_kingston(f"positions in the first 660 s and the last 60 s; {speed} [6.9, max 14.7]", run, kept, ADAPT)
    run = kingston.load(folder, centre_speed=True)
    no_latitude = run.recording.description.track.model_copy(update={"latitude_deg": None})
    still = replace(run.recording, gnss_origin=None)
    still = replace(still, description=still.description.model_copy(update={"track": no_latitude}))
    _report_kingston("the same without Earth rotation", replace(run, recording=still), ends(still), ADAPT)
    _report_kingston("one position every 300 s besides [2.3]", run, every(run.recording, 300.0), ADAPT)

    _receiver_speeds(folder)
    gps = kingston.load(folder, gnss="BESTGPSPOS", centre_speed=True)
    everything = np.ones(len(gps.recording.gnss), dtype=bool)
    correlated = ADAPT.model_copy(update={"position": MULTIPATH})
    blunt = ADAPT.model_copy(update={"position": PositionConfig(robust=False)})
    errors = horizontal_errors(_as_trajectory(gps.recording.gnss), gps.reference)["error_m"]
    print(f"\nKingston, GPS alone against the reference: rms {rms(errors):.2f} m, max {errors.max():.1f} m")
    _report_kingston("GPS only, robust", gps, everything, ADAPT)
    _report_kingston("GPS only, robust, its errors taken to last 30 s", gps, everything, correlated)
    _report_kingston("GPS only, not robust", gps, everything, blunt)


def score_kingston_outages(folder: Path) -> None:
    """Positions withheld once per run, outage after outage: one drive with one outage is too few errors for a ratio."""
    run = kingston.load(folder, centre_speed=True)
    gnss = run.recording.gnss
    assert gnss is not None
    for length_s in OUTAGES_S:
        scores = []
        for start in np.arange(START_S, gnss["t_s"].max() - END_S - length_s, length_s):
            outage = (start, start + length_s)
            kept, _ = withhold(gnss, (outage,))
            result = smooth(replace(run.recording, gnss=kept), ADAPT)
            reference = run.reference[run.reference["t_s"].between(*outage)]
            errors = horizontal_errors(result.trajectory, reference, kingston.LEVER_ARM_M)
            error_rms = rms(errors["error_m"])
            scores.append((error_rms, error_rms / rms(errors["sd_m"])))
            _print_outage(f"no positions from {start:.0f} to {start + length_s:.0f} s", scores[-1:])
        _print_outage(f"{len(scores)} outages of {length_s:g} s", scores)
        print()


def _print_outage(which: str, scores: list[tuple[float, float]]) -> None:
    size, ratio = map(rms, np.array(scores).T)
    print(f"Kingston, {which}: rms {size:.2f} m, rms / sigma {ratio:.2f}")


def _receiver_speeds(folder: Path) -> None:
    """Print what a receiver's speeds add, with a wheel and without one."""
    for tach in (True, False):
        wheel = "wheel" if tach else "no wheel"
        for speeds in (False, True):
            label = f"{wheel}, {'receiver' if speeds else 'no receiver'}'s speeds"
            gps = kingston.load(folder, gnss="BESTGPSPOS", centre_speed=True, speeds=speeds)
            survey = kingston.load(folder, centre_speed=True, speeds=speeds)
            if not tach:
                gps, survey = without_tach(gps), without_tach(survey)
            assert gps.recording.gnss is not None
            everything = np.ones(len(gps.recording.gnss), dtype=bool)
            _report_kingston(f"GPS only; {label}", gps, everything, ADAPT)
            _report_kingston(f"positions at both ends; {label}", survey, ends(survey.recording), ADAPT)


def without_tach(run: RealRun) -> RealRun:
    """Return the run without its tach."""
    description = run.recording.description.model_copy(update={"tach": None})
    return replace(run, recording=replace(run.recording, tach=None, description=description))


def _report_kingston(label: str, run: RealRun, kept: np.ndarray, config: SmoothConfig) -> None:
    gnss = run.recording.gnss
    assert gnss is not None
    result = smooth(replace(run.recording, gnss=gnss[kept].reset_index(drop=True)), config)
    reference = run.reference
    if not kept.all():
        reference = reference[(reference["t_s"] > START_S) & (reference["t_s"] < gnss["t_s"].max() - END_S)]
    errors = horizontal_errors(result.trajectory, reference, kingston.LEVER_ARM_M)
    summary = result.summary
    if not summary.converged:
        print(f"\nKingston, {label}\n  did not converge: {summary.reason}")
        return
    roll, pitch, yaw = (_angle_error(result, reference, name) for name in ("roll_rad", "pitch_rad", "yaw_rad"))
    bias, sd = summary.gyro_bias_radps.value[2], summary.gyro_bias_radps.sd[2]
    ratio = float(np.sqrt(np.mean(errors["error_m"] ** 2) / np.mean(errors["sd_m"] ** 2)))
    print(f"\nKingston, {label}")
    error_rms, largest = rms(errors["error_m"]), errors["error_m"].max()
    print(f"  horizontal: rms {error_rms:.2f} m, max {largest:.1f} m, rms / sigma {ratio:.2f}")
    print(
        f"  roll sd {np.degrees(roll.std()):.3f} deg, pitch sd {np.degrees(pitch.std()):.3f} deg [0.05], "
        f"yaw rms {np.degrees(rms(yaw)):.2f} deg [0.4]"
    )
    wheel = ""
    if summary.wheel_scale is not None and summary.clock_offset_s is not None:
        wheel = (
            f"wheel scale {summary.wheel_scale.value:.4f} +- {summary.wheel_scale.sd:.4f}, "
            f"tach clock {summary.clock_offset_s.value:+.3f} s, "
        )
    print(
        f"  {wheel}vertical gyro bias {bias / DEG_PER_H:.1f} +- {sd / DEG_PER_H:.1f} deg/h; "
        f"{summary.solver.iterations} iterations, "
        f"{summary.reason}"
    )


def score_comma2k19(folder: Path) -> None:
    """GNSS for the first 5 s only."""
    for speeds in (False, True):
        _score_comma2k19(comma2k19.load(folder, speeds=speeds), ", with the receiver's speeds" if speeds else "")


def _score_comma2k19(run: RealRun, with_speeds: str) -> None:
    gnss = run.recording.gnss
    assert gnss is not None
    print()
    for seconds in (5.0, 10.0, np.inf):
        kept = gnss[gnss["t_s"] < seconds].reset_index(drop=True)
        result = smooth(replace(run.recording, gnss=kept), ADAPT)
        errors = horizontal_errors(result.trajectory, run.reference)
        last, sd = errors["error_m"].iloc[-1], errors["sd_m"].iloc[-1]
        summary = result.summary
        assert summary.wheel_scale is not None
        assert summary.clock_offset_s is not None
        print(
            f"comma2k19, GNSS for the first {seconds:g} s{with_speeds}: final error {last:.2f} m = "
            f"{100 * last / summary.distance_m:.2f} % of {summary.distance_m:.0f} m [aim 0.5 %], sigma {sd:.1f} m; "
            f"wheel scale {summary.wheel_scale.value:.4f} +- {summary.wheel_scale.sd:.4f}, tach clock "
            f"{1e3 * summary.clock_offset_s.value:+.1f} +- {1e3 * summary.clock_offset_s.sd:.1f} ms"
        )


def ends(recording: Recording) -> np.ndarray:
    """Which positions of the Kingston drive lie in its first :data:`START_S` or its last :data:`END_S`."""
    assert recording.gnss is not None
    t = recording.gnss["t_s"].to_numpy()
    return (t < START_S) | (t > t[-1] - END_S)


def every(recording: Recording, interval_s: float) -> np.ndarray:
    """The same and one every ``interval_s`` in between."""
    assert recording.gnss is not None
    t = recording.gnss["t_s"].to_numpy()
    kept = ends(recording)
    for time in np.arange(START_S + interval_s, t[-1] - END_S, interval_s):
        kept[np.argmin(np.abs(t - time))] = True
    return kept


def _as_trajectory(gnss: pd.DataFrame) -> pd.DataFrame:
    """Positions as a trajectory, so that the same code scores them."""
    zero = dict.fromkeys(("roll_rad", "pitch_rad", "yaw_rad"), 0.0)
    return gnss.rename(columns={"east_sd_m": "east_m_sd", "north_sd_m": "north_m_sd"}).assign(**zero)


def _angle_error(result: Result, reference: pd.DataFrame, name: str) -> np.ndarray:
    trajectory = result.trajectory
    estimate = np.interp(reference["t_s"], trajectory["t_s"], np.unwrap(trajectory[name]))
    return (estimate - reference[name].to_numpy() + np.pi) % (2.0 * np.pi) - np.pi


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=default, help="folder with kingston/ and comma2k19/")
    parser.add_argument("--only", nargs="+", choices=WANTED)
    arguments = parser.parse_args()
    wanted = arguments.only or WANTED
    if "kitti" in wanted:
        score_kitti()
    for name, folder, score in (
        ("kingston", "kingston", score_kingston),
        ("kingston-outages", "kingston", score_kingston_outages),
        ("comma2k19", "comma2k19", score_comma2k19),
    ):
        if name not in wanted:
            continue
        if (arguments.data / folder).is_dir():
            score(arguments.data / folder)
        else:
            print(f"\n{name}: {arguments.data / folder} is not there, skipped")
