"""What a known line does: the track that is named of two, errors in an outage, and what a wrong line pulls.

    python tools/known_line.py                    all cases, 10 runs each
    python tools/known_line.py --seeds 40 --only "GNSS 1.9 m"

Runs of 150 s of the scenario mainline-gnss have no GNSS from 50 to 110 s. The file has the track as it is driven, by
vertices 10 m apart, and another one 4.5 m to a side. A row is a case: runs in which the right track is named over the
run, in which it is undecided or the line disagrees, and in which the other one is named; the largest errors in the
outage across the track, across it without the line, and along it, in per cent of the way; the largest change of the
trajectory by the line, in its sigmas without it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import GnssModel
from trackfg.numerics.arrays import Array
from trackfg.recording.known_line import KnownLine
from trackfg.recording.track_network import place_at, stations
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

DURATION_S, OUTAGE_S = 150.0, (50.0, 110.0)
APART_M, VERTEX_M, BEYOND_M = 4.5, 10.0, 200.0


@dataclass(frozen=True)
class Case:
    """GNSS has white noise of ``gnss_sd_m`` and an error of ``multipath_sd_m`` that lasts 30 s; both tracks of the file
    are off by ``line_off_m`` to the side of the other track.
    """

    name: str
    gnss_sd_m: float = 1.0
    multipath_sd_m: float = 0.0
    line_off_m: float = 0.0
    has_outage: bool = True


CASES = (
    Case("GNSS 0.5 m", 0.5),
    Case("GNSS 1 m", 1.0),
    Case("GNSS 1.9 m", 1.9),
    Case("GNSS 1.9 m, no outage", 1.9, has_outage=False),
    Case("GNSS 1 m and 1.5 m of multipath", 1.0, 1.5),
    Case("GNSS 4 m and 4 m of multipath", 4.0, 4.0),
    Case("line 1 m off", line_off_m=-1.0),
    Case("line 2.25 m off, midway", line_off_m=-2.25),
    Case("line 10 m off", line_off_m=10.0),
)


def tracks(truth: pd.DataFrame, side: float, off_m: float) -> KnownLine:
    """Return the driven track and the other one, by east and north of the truth."""
    place = truth[["east_m", "north_m"]].to_numpy()
    moved = np.append(True, np.linalg.norm(np.diff(place, axis=0), axis=1) > 0.0)
    way = place[moved]
    line = place_at(way, np.arange(0.0, stations(way)[-1], VERTEX_M))
    ends = [line[0] - (line[1] - line[0]) * BEYOND_M / VERTEX_M, line[-1] + (line[-1] - line[-2]) * BEYOND_M / VERTEX_M]
    line = np.concatenate([ends[:1], line, ends[1:]])
    tangent = np.gradient(line, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(tangent, axis=1)[:, None]
    right, other = line + side * off_m * normal, line + side * (off_m + APART_M) * normal
    return KnownLine("tracks", ("right", "other"), (right, other), is_local=True)


def errors(result: Result, truth: pd.DataFrame) -> tuple[Array, Array]:
    """Return the errors along and across the track in the outage, m."""
    of = result.trajectory[result.trajectory["t_s"].between(*OUTAGE_S)]
    east, north = (of[name] - np.interp(of["t_s"], truth["t_s"], truth[name]) for name in ("east_m", "north_m"))
    cos, sin = np.cos(of["yaw_rad"]), np.sin(of["yaw_rad"])
    return (east * cos + north * sin).to_numpy(), (north * cos - east * sin).to_numpy()


def named(result: Result) -> str:
    """Return the track that is named, over more than half of the run, or that none is."""
    assert result.summary.line is not None
    by_track: dict[str, float] = {}
    for stretch in result.summary.line.stretches:
        name = str(stretch.track) if stretch.status == "on" else "none"
        by_track[name] = by_track.get(name, 0.0) + stretch.end_s - stretch.start_s
    return max(by_track, key=lambda name: by_track[name])


def row(case: Case, seeds: int) -> str:
    """Return the figures of a case as a row of the table."""
    receiver = scenario("mainline-gnss").gnss
    assert receiver is not None
    sd, lasting = case.gnss_sd_m, case.multipath_sd_m
    outages = (OUTAGE_S,) if case.has_outage else ()
    gnss: GnssModel = replace(
        receiver, sd_m=(sd, sd, 2.0 * sd), multipath_sd_m=(lasting, lasting, 2.0 * lasting), outages_s=outages
    )
    plan = replace(scenario("mainline-gnss"), gnss=gnss)
    names: list[str] = []
    across_m, alone_m, share, pulled = [], [], [], []
    for seed in range(seeds):
        run = simulate(plan, seed=seed, duration_s=DURATION_S)
        line = tracks(run.truth, 1.0 if seed % 2 else -1.0, case.line_off_m)
        alone, result = smooth(run.recording), smooth(run.recording, known_line=line)
        names.append(named(result))
        along, across = errors(result, run.truth)
        chainage = result.trajectory["chainage_m"][result.trajectory["t_s"].between(*OUTAGE_S)]
        share.append(np.abs(along).max() / float(np.ptp(chainage)))
        across_m.append(np.abs(across).max())
        alone_m.append(np.abs(errors(alone, run.truth)[1]).max())
        moved = [
            (result.trajectory[name] - alone.trajectory[name]).abs() / alone.trajectory[f"{name}_sd"]
            for name in ("east_m", "north_m")
        ]
        pulled.append(max(float(column.max()) for column in moved))
    counts = " | ".join(str(names.count(name)) for name in ("right", "none", "other"))
    return (
        f"| {case.name} | {counts} | {max(across_m):.2f} | {max(alone_m):.2f} | {100.0 * max(share):.2f} % "
        f"| {max(pulled):.2f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="runs of each case")
    parser.add_argument("--only", help="one case by its name")
    options = parser.parse_args()
    print("| case | right | none | wrong | across, m | without, m | along | pulled, sigma |")
    print("|---|---|---|---|---|---|---|---|")
    for case in CASES:
        if options.only in (None, case.name):
            print(row(case, options.seeds), flush=True)


if __name__ == "__main__":
    main()
