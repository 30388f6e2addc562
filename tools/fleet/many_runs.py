"""A store with many runs over one line, made of a few: the same runs again, with other noise of the size of theirs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from trackfg.datasets.scenarios import scenario, simulate
from trackfg.fleet.catalogue import Run
from trackfg.fleet.key_figures import done_row
from trackfg.fleet.store import Store
from trackfg.mapping.joining.merging import MERGED
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

LINE = "1"
_SMOOTHED = 2
"""Runs that are simulated and smoothed; the others repeat them."""
_SECONDS_PER_KM = 66.0
"""What the measuring car takes for a kilometre, stops included."""
_CORRELATED_CELLS = 8.0
"""Noise of a profile is alike over some cells, 2 m."""
_LOCAL = 0.1
"""Share of cross-level's sigma that is not one offset of the run."""


def write_store(place: Path, runs: int, km: float) -> list[Path]:
    """Write a store of runs of so many kilometres; what is there already stays. Returns the folders of its results."""
    store, rows, folders = Store(place), [], []
    for number in range(runs):
        name = f"run{number:04d}"
        folder = Path(store.result(name))
        if not folder.exists():
            _repeated(_smoothed(number % _SMOOTHED, km), name, number).write(folder)
        rows.append(done_row(Run(name, f"/recordings/{name}", LINE), folder))
        folders.append(folder)
    store.write(rows)
    return folders


@cache
def _smoothed(number: int, km: float) -> Result:
    simulation = simulate(scenario("measuring-car"), seed=1, run=number, duration_s=_SECONDS_PER_KM * km)
    return smooth(simulation.recording)


def _repeated(result: Result, name: str, number: int) -> Result:
    rng, geometry = np.random.default_rng(number), result.geometry.copy()
    for column in MERGED:
        noise = gaussian_filter1d(rng.standard_normal(len(geometry)), _CORRELATED_CELLS)
        share = _LOCAL if column == "cross_level_mm" else 1.0
        geometry[column] += share * geometry[f"{column}_sd"] * noise / noise.std()
    if result.summary.run is None:
        raise ValueError("the result has no facts of its run")
    facts = result.summary.run.model_copy(update={"content_sha256": f"{number:064x}"})
    summary = result.summary.model_copy(update={"recording_id": name, "run": facts})
    return replace(result, geometry=geometry, summary=summary)
