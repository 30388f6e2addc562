"""Does the default smoother stay right, or say that it is not, on recordings as rough as real ones?

batch      every effect of :mod:`trackfg.datasets.effects` at each of its magnitudes: error, sigma, and the verdict of
           each quantity; beside it an oracle, the same smoother with the effect declared or left out, and dead
           reckoning
stream     six of the effects, or those that are named, as a stream with 20 s of lag
floor      100 random runs with sensors of a few euros against dead reckoning
combined   60 random runs in which two to six effects come together
maps       maps of ten rough rides: curve points against the designed line
real       KITTI, Kingston, comma2k19 and drives of the Wheel Inertial Dataset with the default settings

Printed are a table, a row per case and quantity, and the list of what misses the acceptance:

1 silent   more than 5 % of a run's samples beyond 4 sigma, and no verdict that names the quantity
2 sigmas   rms over sigma above 1.5, or coverage of 1.96 sigma below 85 % (without an effect, over 20 runs or more,
           outside 90-98 %), where a verdict says trusted or widened
3 oracle   an error more than twice the oracle's
4 floor    an error more than 5 % above that of dead reckoning

    python tools/robustness.py [--parts batch stream floor combined maps real] [--effects clean imu-noise=3 ...]
                               [--seeds 5] [--first-seed 0] [--duration 600] [--jobs 2] [--floor-runs 100]
                               [--combined-runs 60] [--out FILE] [--data ../shared/data]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import pandas as pd
from benchmark import Call, add_seed_arguments, seeds_of, side_by_side

from robustness import drives, maps
from robustness.cases import STREAMED, Case, cases
from robustness.combined import CombinedRun
from robustness.low_cost import LowCostRun
from robustness.real import as_table, real_scores
from robustness.scores import measured, measured_stream
from robustness.table import failures, floor_markdown, markdown

PARTS = ("batch", "stream", "floor", "combined", "maps", "real")
RANDOM = ("floor", "combined")
"""Parts whose runs are drawn."""


def measured_case(case: Case, seed: int, duration_s: float) -> pd.DataFrame:
    """Return the scores of a case on one seed."""
    run = case.simulated(seed, duration_s)
    of_oracle = case.simulated(seed, duration_s, for_oracle=True) if case.has_oracle else None
    return measured(run, of_oracle).assign(case=case.name, seed=seed)


def measured_stream_case(case: Case, seed: int, duration_s: float) -> pd.DataFrame:
    """Return the scores of a case on one seed as a stream."""
    return measured_stream(case.simulated(seed, duration_s)).assign(case=case.name, seed=seed)


def measured_random(one: LowCostRun | CombinedRun) -> pd.DataFrame:
    """Return the scores of a random run."""
    return measured(one.simulated(), None).assign(case=one.name, seed=one.number)


def calls_of(arguments: argparse.Namespace, seeds: range) -> dict[tuple[str, str, int], Call]:
    """Return what is to be measured, by part, case and seed."""
    chosen = cases([name for given in arguments.effects for name in given.split(",")])
    calls: dict[tuple[str, str, int], Call] = {}
    for part, measure in (("batch", measured_case), ("stream", measured_stream_case)):
        if part in arguments.parts:
            run = [case for case in chosen if part == "batch" or arguments.effects or case.effect in STREAMED]
            calls |= {
                (part, case.name, seed): (measure, (case, seed, arguments.duration)) for case in run for seed in seeds
            }
    for part, kind, count in (
        ("floor", LowCostRun, arguments.floor_runs),
        ("combined", CombinedRun, arguments.combined_runs),
    ):
        if part in arguments.parts:
            runs = [kind(number) for number in range(count)]
            calls |= {(part, one.name, one.number): (measured_random, (one,)) for one in runs}
    return calls


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_seed_arguments(parser)
    parser.set_defaults(seeds=5, first_seed=1)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=["batch"], help="default: batch")
    parser.add_argument("--effects", nargs="+", default=[], metavar="NAME[=MAGNITUDE]", help="default: all")
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="of each run (default: %(default)s)")
    parser.add_argument("--floor-runs", type=int, default=100, metavar="N", help="default: %(default)s")
    parser.add_argument("--combined-runs", type=int, default=60, metavar="N", help="default: %(default)s")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the scores of every run to a CSV file")
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=default, help="folder with kingston/ and comma2k19/")
    arguments = parser.parse_args()
    start = time.perf_counter()
    seeds = seeds_of(parser, arguments)
    calls = calls_of(arguments, seeds)
    if calls:
        rows = pd.concat(side_by_side(calls, arguments.jobs, "runs").values(), ignore_index=True)
        missed = list(failures(rows))
        part = rows["case"].map({case: part for part, case, _ in calls})
        if not part.isin(RANDOM).all():
            print(markdown(rows[~part.isin(RANDOM)]))
        for name in RANDOM:
            if (part == name).any():
                print(floor_markdown(rows[part == name]))
        print(f"\n{len(missed)} misses of the acceptance\n", *missed, sep="\n")
        if arguments.out is not None:
            rows.to_csv(arguments.out, index=False)
    if "maps" in arguments.parts:
        made: dict[tuple[str, int], Call] = {
            ("map", seed): (maps.measured_maps, (seed, arguments.duration)) for seed in seeds
        }
        print(maps.as_table(pd.concat(side_by_side(made, arguments.jobs, "maps").values(), ignore_index=True)))
    if "real" in arguments.parts:
        print(as_table(list(real_scores(arguments.data))))
        if (arguments.data / "wid").is_dir():
            print(drives.as_table(list(drives.drive_scores(arguments.data / "wid"))))
    print(f"\n{time.perf_counter() - start:.0f} s in all", file=sys.stderr)
