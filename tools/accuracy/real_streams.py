"""Streams of three real drives with the default settings, scored against what they did not see.

KITTI comes with gtsam; Kingston and comma2k19 are read from a data folder and skipped where it is absent. Errors are
horizontal, of filtered rows and of those after the lag, with the ratio of their rms to that of their sigmas, and the
share beyond 4 sigmas. All positions are used. What the stream itself says of its sigmas stands below. KITTI's reference
are the positions themselves, at times plus the offset of the clock that the stream ends with, 0.06 s.

    python tools/real_streams.py [--data ../shared/data] [--lag 10 20]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.datasets.real.real_run import RealRun
from trackfg.evaluation.outages import horizontal_errors
from trackfg.evaluation.scores import rms
from trackfg.numerics.blas_threads import one_thread
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.streaming.fixed_lag import Estimates, FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

_BEYOND = 4.0
"""Errors beyond so many sigmas are counted."""


def drives(folder: Path) -> Iterator[tuple[str, RealRun]]:
    """Yield the name of each drive that is there, and the drive."""
    if (folder / "kingston").is_dir():
        for gnss in ("BESTGPSPOS", "BESTPOS"):
            yield f"Kingston, {gnss}", kingston.load(folder / "kingston", gnss=gnss, centre_speed=True)
    if (folder / "comma2k19").is_dir():
        yield "comma2k19", comma2k19.load(folder / "comma2k19")
    yield "KITTI", kitti.load()


def streamed(recording: Recording, lag_s: float) -> tuple[list[Estimates], float]:
    """Return what a stream of the recording gives, and the offset of the receiver's clock that it ends with, s."""
    source = RecordingSource(recording, batch_s=1.0)
    smoother, intake = FixedLagSmoother(source.description, lag_s=lag_s), Intake.of(source)
    with one_thread():
        pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
        pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    running = smoother._moving.running
    return pieces, 0.0 if running is None else float(running.newest.states.clock[0, 2])


def score(name: str, run: RealRun, lag_s: float) -> None:
    """Print a row for a drive, and what the stream doubts."""
    pieces, clock_s = streamed(run.recording, lag_s)
    reference, arm = run.reference, kingston.LEVER_ARM_M if name.startswith("Kingston") else np.zeros(3)
    if name == "KITTI":
        reference = reference.assign(t_s=reference["t_s"] + clock_s)
    cells = []
    for tables in ([piece.smoothed for piece in pieces], [piece.filtered for piece in pieces]):
        table = pd.concat(tables, ignore_index=True)
        errors = horizontal_errors(table, reference, arm)
        error, sd = errors["error_m"], errors["sd_m"]
        cells.append(f"{rms(error):.2f} ({rms(error) / rms(sd):.2f}, {100 * np.mean(error > _BEYOND * sd):.0f} %)")
    print(f"| {name} | {lag_s:g} | {cells[0]} | {cells[1]} |")
    for piece in pieces:
        for event in piece.events:
            if event.kind in (DOUBT, "noise-raised", "restarted"):
                print(f"    {event}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=default, help="folder with kingston/ and comma2k19/")
    parser.add_argument("--lag", type=float, nargs="+", default=[10.0], help="seconds (default: 10)")
    arguments = parser.parse_args()
    print("| drive | lag, s | after the lag: error, m (over sigma, beyond 4) | filtered |")
    print("|---|---|---|---|")
    for name, run in drives(arguments.data):
        for lag_s in arguments.lag:
            score(name, run, lag_s)
