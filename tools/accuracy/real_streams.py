"""Streams of three real drives with the default settings, scored against what they did not see.

KITTI comes with gtsam; Kingston and comma2k19 are read from a data folder and skipped where it is absent. Errors are
horizontal, of filtered rows and of those after the lag, with the ratio of their rms to that of their sigmas, and the
share beyond 4 sigmas. All positions are used. What the stream itself says of its sigmas stands below. KITTI's reference
are the positions themselves, at times plus the offset of the clock that the stream ends with, 0.06 s.

    python tools/real_streams.py [--data ../shared/data] [--lag 10 20] [--speeds]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from streaming.run_tables import tables_of

from accuracy.real_data import without_tach
from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.datasets.real.real_run import RealRun
from trackfg.evaluation.outages import horizontal_errors
from trackfg.evaluation.scores import rms
from trackfg.numerics.blas_threads import one_thread
from trackfg.results.events import DOUBT
from trackfg.streaming.events import event_table
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.sources.source import RecordingSource

_BEYOND = 4.0
"""Errors beyond so many sigmas are counted."""


def drives(folder: Path, *, speeds: bool = False) -> Iterator[tuple[str, RealRun]]:
    """Yield the name of each drive that is there, and the drive; with its receiver's ``speeds`` those that have them,
    also without their tach.
    """
    if (folder / "kingston").is_dir():
        for gnss in ("BESTGPSPOS", "BESTPOS"):
            run = kingston.load(folder / "kingston", gnss=gnss, centre_speed=True, speeds=speeds)
            yield f"Kingston, {gnss}", run
    if (folder / "comma2k19").is_dir():
        run = comma2k19.load(folder / "comma2k19", speeds=speeds)
        yield "comma2k19", run
        yield "comma2k19, no wheel", without_tach(run)
    if not speeds:
        yield "KITTI", kitti.load()


def score(name: str, run: RealRun, lag_s: float) -> None:
    """Print a row for a drive, and what the stream doubts."""
    source = RecordingSource(run.recording)
    smoother = FixedLagSmoother(source.description, lag_s=lag_s)
    with one_thread():
        tables, _ = tables_of(source, smoother)
    reference, arm = run.reference, kingston.LEVER_ARM_M if name.startswith("Kingston") else np.zeros(3)
    running = smoother._moving.running
    if name == "KITTI" and running is not None:
        reference = reference.assign(t_s=reference["t_s"] + running.newest.states.clock[0, 2])
    cells = []
    for table in ("smoothed", "filtered"):
        errors = horizontal_errors(tables[table], reference, arm)
        error, sd = errors["error_m"], errors["sd_m"]
        cells.append(f"{rms(error):.2f} ({rms(error) / rms(sd):.2f}, {100 * np.mean(error > _BEYOND * sd):.0f} %)")
    print(f"| {name} | {lag_s:g} | {cells[0]} | {cells[1]} |")
    events = tables.get("events", event_table([]))  # a stream may have none
    for event in events[events["kind"].isin((DOUBT, "noise-raised", "restarted"))].itertuples():
        print(f"    {event.kind} at {event.t_s:.0f} s: {event.detail}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=default, help="folder with kingston/ and comma2k19/")
    parser.add_argument("--lag", type=float, nargs="+", default=[10.0], help="seconds (default: 10)")
    parser.add_argument("--speeds", action="store_true", help="with the receivers' own speeds")
    arguments = parser.parse_args()
    print("| drive | lag, s | after the lag: error, m (over sigma, beyond 4) | filtered |")
    print("|---|---|---|---|")
    for name, run in drives(arguments.data, speeds=arguments.speeds):
        for lag_s in arguments.lag:
            score(name, run, lag_s)
