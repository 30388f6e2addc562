"""How well does it know where the train is? In parts, over seeds.

slips      distances in spite of slip and slide, and what is reported of these (slippery-line)
map        landmarks of a map of one run and of ten, and the roll of the sensors' mountings (shuttle)
localise   a later run on that map, with a fix at its start alone; and runs that start anywhere with none
stream     later runs on that map by the fixed-lag smoother, begun anywhere too, and runs on other track
changes    defects that came after the map was made, and false alarms
speed      ten runs of 70 km: time and memory of making the map and of adding an eleventh (the first seed alone)

Each line of a table has what was measured over all seeds, its range over the seeds, the target, and whether it is met.
Twenty seeds take some 25 minutes on two free cores.

    python tools/positioning.py [--seeds 20] [--first-seed 0] [--jobs 2] [--out FILE] [--per-seed FILE]
                                [--parts slips map localise stream changes speed]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from benchmark import add_seed_arguments, finish, printed, seeds_of, show, side_by_side, table_of

from positioning.changes import PART as CHANGES
from positioning.localise import PART as LOCALISE
from positioning.map import PART as MAP
from positioning.slips import PART as SLIPS
from positioning.speed import PART as SPEED
from positioning.stream import PART as STREAM

PARTS = {part.name: part for part in (SLIPS, MAP, LOCALISE, STREAM, CHANGES, SPEED)}


def measured(names: Sequence[str], seeds: range, jobs: int) -> dict[str, pd.DataFrame]:
    """One row per seed of each part's measurements, with a progress bar on a terminal.

    A measurement that fails ends it at once. What is measured alone comes last, when the processors are free.
    """
    together = [name for name in names if not PARTS[name].alone]
    rows = side_by_side({seed: (measured_on, (seed, together)) for seed in seeds}, jobs) if together else {}
    tables = {name: pd.DataFrame([rows[seed][name] for seed in seeds], index=seeds) for name in together}
    for name in names:
        if PARTS[name].alone:
            tables[name] = pd.DataFrame([PARTS[name].measure(seeds[0])], index=seeds[:1])
    return tables


def measured_on(seed: int, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """The measurements of parts on one seed, in one process: they share its runs."""
    return {name: PARTS[name].measure(seed) for name in names}


def write_per_seed(tables: dict[str, pd.DataFrame], path: Path) -> None:
    """Every measurement of every seed: CSV with ``part, seed, quantity, value``, or JSON by part and seed."""
    if path.suffix == ".json":
        by_part = {name: json.loads(table.to_json(orient="index")) for name, table in tables.items()}
        path.write_text(json.dumps(by_part, indent=1) + "\n", encoding="utf-8")
        return
    long = [
        table.rename_axis("seed").reset_index().melt("seed", var_name="quantity").assign(part=name)
        for name, table in tables.items()
    ]
    pd.concat(long)[["part", "seed", "quantity", "value"]].to_csv(path, index=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_seed_arguments(parser)
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the lines of all tables to a CSV file")
    parser.add_argument("--per-seed", type=Path, metavar="FILE", help="write what each seed gave: .csv or .json")
    arguments = parser.parse_args()
    seeds = seeds_of(parser, arguments)
    if arguments.per_seed is not None and arguments.per_seed.suffix not in (".csv", ".json"):
        parser.error(f"--per-seed {arguments.per_seed}: expected a name that ends in .csv or .json")
    start = time.perf_counter()
    names = list(dict.fromkeys(arguments.parts))
    by_part = measured(names, seeds, arguments.jobs)
    tables = []
    for name in names:
        part, rows = PARTS[name], by_part[name]
        table = table_of(part, part.figures(rows))
        show(part, printed(table), len(rows))
        tables.append(table)
    finish(tables, arguments.out, start)
    if arguments.per_seed is not None:
        write_per_seed(by_part, arguments.per_seed)
