"""``trackfg demo``: the whole story on a real drive that is there wherever trackfg is installed.

The KITTI drive of the gtsam wheel (IMU and 1 Hz positions, no odometer) loses its positions for 30 s five times. The
smoother bridges the outages; the positions that it did not see say how well.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from trackfg.atomic_folder import replaced_folder
from trackfg.config import NoiseConfig, SmoothConfig
from trackfg.datasets import kitti
from trackfg.errors import BadInputError
from trackfg.evaluate import Span, score_outages, withhold
from trackfg.plot import plot_trajectory
from trackfg.recording_io import read_recording, write_recording
from trackfg.results import Result
from trackfg.smoother import smooth

OUTAGE_S = 30.0
OUTAGES: tuple[Span, ...] = tuple((start, start + OUTAGE_S) for start in (60.0, 150.0, 240.0, 330.0, 400.0))
"""Seconds after the start of the recording."""

SETTINGS = SmoothConfig(noise=NoiseConfig(adapt=True))
"""A car is no railway vehicle, and the sensor's declared noise knows no vibration: the noise levels are taken from the
residuals at the positions that are left. Nothing is set by hand, and the withheld positions are not looked at.
"""

RECORDING, RESULT, PICTURE, PAGE = CONTENT = ("recording", "result", "demo.png", "demo.html")


@dataclass(frozen=True)
class Demo:
    """``outages`` as of :func:`trackfg.evaluate.score_outages`; ``folder`` holds :data:`CONTENT`."""

    folder: Path
    outages: pd.DataFrame
    result: Result


def run_demo(folder: str | os.PathLike[str], *, progress: Callable[[str, float], None] | None = None) -> Demo:
    """Smooth the drive with its outages and write recording, result, picture and page into ``folder``.

    An earlier demo there is replaced in one step. Raises :class:`BadInputError` if the folder holds anything else.
    """
    folder = Path(folder)
    _refuse_foreign_folder(folder)
    drive = kitti.load()
    gnss = drive.recording.gnss
    assert gnss is not None  # the drive has positions
    kept, _ = withhold(gnss, OUTAGES)
    with replaced_folder(folder) as new:
        write_recording(replace(drive.recording, gnss=kept), new / RECORDING)
        result = smooth(read_recording(new / RECORDING), SETTINGS, progress=progress)
        result.write(new / RESULT)
        for name in (PICTURE, PAGE):
            plot_trajectory(
                result,
                new / name,
                reference=drive.reference,
                title="KITTI drive: positions withheld for 30 s, five times",
                highlight=OUTAGES,
            )
    return Demo(folder=folder, outages=score_outages(result.trajectory, gnss, OUTAGES), result=result)


def _refuse_foreign_folder(folder: Path) -> None:
    if not folder.exists():
        return
    foreign = not folder.is_dir() or {path.name for path in folder.iterdir()} - set(CONTENT)
    if foreign:
        raise BadInputError(f"{folder}: exists and is not an earlier demo; it is left alone: choose another folder")
