"""Does the default smoother stay right, or say that it is not, on recordings as rough as real ones?

batch      every effect of :mod:`trackfg.datasets.effects` at each of its magnitudes: error, sigma, and the verdict of
           each quantity; beside it an oracle, the same smoother told the truth of the effect, and dead reckoning

Printed are a table, a row per case and quantity, and the list of what misses the acceptance:

1 silent   more than 5 % of a run's samples beyond 4 sigma, and no verdict that names the quantity
2 sigmas   rms over sigma above 1.5, or coverage of 1.96 sigma below 85 %, where a verdict says trusted or widened
3 oracle   an error more than twice the oracle's
4 floor    an error more than 5 % above that of dead reckoning

    python tools/robustness.py [--parts batch] [--effects clean aliased-vibration imu-noise=3 ...]
                               [--seeds 5] [--first-seed 0] [--duration 600] [--jobs 2] [--out FILE]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import pandas as pd
from benchmark import Call, add_seed_arguments, seeds_of, side_by_side

from robustness.cases import Case, cases
from robustness.scores import measured
from robustness.table import failures, markdown


def measured_case(case: Case, seed: int, duration_s: float) -> pd.DataFrame:
    """Return the scores of a case on one seed."""
    run = case.simulated(seed, duration_s)
    told = case.simulated(seed, duration_s, told=True) if case.has_oracle else None
    return measured(run, told).assign(case=case.name, seed=seed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_seed_arguments(parser)
    parser.set_defaults(seeds=5)
    parser.add_argument("--parts", nargs="+", choices=("batch",), default=["batch"])
    parser.add_argument("--effects", nargs="+", default=[], metavar="NAME[=MAGNITUDE]", help="default: all")
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="of each run (default: %(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the scores of every run to a CSV file")
    arguments = parser.parse_args()
    seeds = seeds_of(parser, arguments)
    start = time.perf_counter()
    names = [name for given in arguments.effects for name in given.split(",")]
    calls: dict[tuple[str, int], Call] = {
        (case.name, seed): (measured_case, (case, seed, arguments.duration)) for case in cases(names) for seed in seeds
    }
    rows = pd.concat(side_by_side(calls, arguments.jobs, "runs").values(), ignore_index=True)
    print(markdown(rows))
    missed = list(failures(rows))
    print(f"\n{len(missed)} misses of the acceptance\n")
    print("\n".join(missed))
    print(f"\n{time.perf_counter() - start:.0f} s in all", file=sys.stderr)
    if arguments.out is not None:
        rows.to_csv(arguments.out, index=False)
    return 0
