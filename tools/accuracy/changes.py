"""Which defects does a run show against a map of a single earlier run, and what is reported where nothing changed?

Per seed, the first run of ``shuttle`` is the map. Later runs, there and back, by another wheel and sensor, are
recognised on it: two on the same track, and for every length of defect and size two on a track where 18 of them came
since: dips, kinks and twists of both rails, of the left and of the right, to either side. Printed is the share found,
per cent, false alarms, and how long it took:

    python tools/change_detection.py [--seeds 4]
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.mapping.changes.changes import Changes, changes
from trackfg.mapping.recognition.conventions import recognised_on_map
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

SHUTTLE = scenario("shuttle")
KINDS, RAILS, SIGNS = ("dip", "kink", "twist"), ("both", "left", "right"), (1.0, -1.0)
LENGTHS_M, SIZES_MM = (3.0, 5.0, 10.0, 20.0), (1.5, 2.0, 3.0)
LATER_RUNS = (6, 7)
FIRST_M, APART_M, NEAR_M = 400.0, 400.0, 20.0
MAP_SD_M = 0.5


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4, help="how many tracks (default 4)")
    arguments = parser.parse_args()
    detections: dict[tuple[float, float, str, str], list[bool]] = {}
    alarms, km, seconds, runs = 0, 0.0, 0.0, 0
    for seed in range(arguments.seeds):
        base = smooth(simulate(SHUTTLE, seed=seed, run=0).recording)
        for (length, size), run in itertools.product([(0.0, 0.0), *itertools.product(LENGTHS_M, SIZES_MM)], LATER_RUNS):
            placed = defects(seed, length, size) if size else ()
            result = smooth(simulate(replace(SHUTTLE, defects=placed), seed=seed, run=run).recording)
            shown, took = compared(base, result)
            near = near_defects(shown.table, placed)
            for defect, is_found in zip(placed, near.any(axis=0), strict=True):
                rails = "both" if defect.rail == "both" else "one"
                detections.setdefault((size, length, defect.kind, rails), []).append(bool(is_found))
            alarms += int(np.sum(~near.any(axis=1)))
            km += 1e-3 * float(np.ptp(shown.cells["chainage_m"]))
            seconds, runs = seconds + took, runs + 1
    console = Console(width=120)
    console.print(table_of(detections))
    console.print(f"{alarms} false alarms in {km:.0f} km; {seconds / runs:.2f} s per run of {km / runs:.1f} km")


def defects(seed: int, length_m: float, size_mm: float) -> tuple[Defect, ...]:
    """One of each kind, rail and side, in another order and at other places for each seed."""
    rng = np.random.default_rng(seed)
    every = list(itertools.product(KINDS, RAILS, SIGNS))
    places = FIRST_M + APART_M * rng.permutation(len(every)) + rng.uniform(0.0, 0.5 * APART_M, len(every))
    return tuple(
        Defect(kind, at_m=float(place), size_m=1e-3 * sign * size_mm, length_m=length_m, rail=rail)  # type: ignore[arg-type]
        for (kind, rail, sign), place in zip(every, places, strict=True)
    )


def compared(base: Result, result: Result) -> tuple[Changes, float]:
    """What changed from the first result to the second, and the seconds it took."""
    grid = base.geometry.assign(observations=1)
    match = recognised_on_map(result, grid, MAP_SD_M)
    to_map, used = match.warp, match.used
    assert to_map is not None
    shift_sd = np.interp(result.geometry["chainage_m"], used["run_m"], used["match_sd_m"])
    began = time.perf_counter()
    meaning = result.summary.geometry
    shown = changes(result.geometry, grid, conventions=meaning, to_map=to_map, shift_sd_m=shift_sd)
    return shown, time.perf_counter() - began


def near_defects(table: pd.DataFrame, placed: Sequence[Defect]) -> np.ndarray:
    """Which change (rows) is near which defect (columns), of bool."""
    first, last = (table[name].to_numpy(dtype=np.float64)[:, None] for name in ("from_m", "to_m"))
    extent = np.array([defect.extent_m for defect in placed]).reshape(-1, 2)
    return np.asarray((first <= extent[:, 1] + NEAR_M) & (last >= extent[:, 0] - NEAR_M))


def table_of(found: dict[tuple[float, float, str, str], list[bool]]) -> Table:
    """A row per size and length."""
    table = Table(title="Found, %", title_justify="left", title_style="bold")
    columns = list(itertools.product(KINDS, ("both", "one")))
    for heading in ("size, mm", "length, m", *(f"{kind}, {rails}" for kind, rails in columns)):
        table.add_column(heading, justify="right")
    for size, length in itertools.product(SIZES_MM, LENGTHS_M):
        shares = [100.0 * np.mean(found[size, length, kind, rails]) for kind, rails in columns]
        table.add_row(f"{size:g}", f"{length:g}", *(f"{share:.0f}" for share in shares))
    return table
