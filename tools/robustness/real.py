"""The default settings on real recordings, against what was withheld or an independent reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from accuracy.real_data import OUTAGES, ends, every

from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.datasets.real.real_run import RealRun
from trackfg.evaluation.outages import horizontal_errors, score_outages, withhold
from trackfg.evaluation.scores import rms
from trackfg.smoothing.smoother import smooth

KITTI_M = 0.8
RATIO = (0.7, 1.5)
COMMA_PERCENT, COMMA_SIGMAS = 0.6, 2.0
_COMMA_GNSS_S = 5.0


@dataclass(frozen=True)
class RealScore:
    """Horizontal error and sigma of a recording, m, their ratio, and whether the acceptance is met."""

    name: str
    error_m: float
    sigma_m: float
    ratio: float
    met: bool


def real_scores(folder: Path) -> Iterator[RealScore]:
    """Yield the scores of KITTI, Kingston and comma2k19; the last two only where ``folder`` has them."""
    drive = kitti.load().recording
    assert drive.gnss is not None
    result = smooth(replace(drive, gnss=withhold(drive.gnss, OUTAGES)[0]))
    total = score_outages(result.trajectory, drive.gnss, OUTAGES).iloc[-1]
    error, sigma = float(total["rms_m"]), float(total["mean_sd_m"])
    yield RealScore("KITTI, five outages of 30 s", error, sigma, error / sigma, error <= KITTI_M)
    if (folder / "kingston").is_dir():
        yield from _kingston(folder / "kingston")
    if (folder / "comma2k19").is_dir():
        yield _comma(folder / "comma2k19")


def as_table(scores: list[RealScore]) -> str:
    """Return the scores as a table in Markdown."""
    lines = [
        "| recording | horizontal error, m | sigma, m | rms of error over that of sigma | met |",
        "|---|---|---|---|---|",
    ]
    for score in scores:
        met = "yes" if score.met else "NO"
        lines.append(f"| {score.name} | {score.error_m:.2f} | {score.sigma_m:.2f} | {score.ratio:.2f} | {met} |")
    return "\n".join(lines)


def _kingston(folder: Path) -> Iterator[RealScore]:
    for centred in (True, False):
        run = kingston.load(folder, centre_speed=centred)
        speed = "speed centred on its step" if centred else "speed as recorded"
        yield _of_kingston(f"Kingston, positions at the ends, {speed}", run, ends(run.recording))
    run = kingston.load(folder, centre_speed=True)
    track = run.recording.description.track.model_copy(update={"latitude_deg": None})
    description = run.recording.description.model_copy(update={"track": track})
    unturned = replace(run, recording=replace(run.recording, gnss_origin=None, description=description))
    yield _of_kingston("Kingston, the same without Earth rotation", unturned, ends(run.recording))
    yield _of_kingston("Kingston, one position every 300 s besides", run, every(run.recording, 300.0))
    gps = kingston.load(folder, gnss="BESTGPSPOS", centre_speed=True)
    assert gps.recording.gnss is not None
    yield _of_kingston("Kingston, BESTGPSPOS", gps, np.ones(len(gps.recording.gnss), dtype=bool))


def _of_kingston(name: str, run: RealRun, kept: np.ndarray) -> RealScore:
    gnss = run.recording.gnss
    assert gnss is not None
    result = smooth(replace(run.recording, gnss=gnss[kept].reset_index(drop=True)))
    reference = run.reference
    if not kept.all():
        reference = reference[reference["t_s"].between(660.0, gnss["t_s"].max() - 60.0)]
    errors = horizontal_errors(result.trajectory, reference, kingston.LEVER_ARM_M)
    error, sigma = rms(errors["error_m"]), rms(errors["sd_m"])
    return RealScore(name, error, sigma, error / sigma, RATIO[0] <= error / sigma <= RATIO[1])


def _comma(folder: Path) -> RealScore:
    run = comma2k19.load(folder)
    gnss = run.recording.gnss
    assert gnss is not None
    result = smooth(replace(run.recording, gnss=gnss[gnss["t_s"] < _COMMA_GNSS_S].reset_index(drop=True)))
    last = horizontal_errors(result.trajectory, run.reference).iloc[-1]
    error, sigma = float(last["error_m"]), float(last["sd_m"])
    length = float(np.hypot(run.reference["east_m"].diff(), run.reference["north_m"].diff()).sum())
    met = error <= 0.01 * COMMA_PERCENT * length and error <= COMMA_SIGMAS * sigma
    return RealScore(
        f"comma2k19, GNSS for 5 s, at the end ({100 * error / length:.2f} %)", error, sigma, error / sigma, met
    )
