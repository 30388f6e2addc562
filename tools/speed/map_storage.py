"""How long a feature map takes to write and to read, and how large it is.

A made-up map of ``--km`` kilometres (a cell per 0.25 m, four landmarks per kilometre, a vertex of the line per 5 m, and
what ``--runs`` runs said of the landmarks) is written twice and read, in a GeoPackage and, with ``--url``, in a
PostgreSQL database, where it must find no map yet. Printed are seconds, and the size of the file after each version::

    python tools/map_storage_speed.py --km 100
    python tools/map_storage_speed.py --km 100 --url 'postgresql://me@host/scratch?schema=speed'
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.mapping.changes.difference import difference
from trackfg.maps import FeatureMap, MapConventions, RunInformation, read_map, write_map
from trackfg.maps.feature_map import (
    CURVE_POINTS,
    GRID_COLUMNS,
    INTEGER_COLUMNS,
    LANDMARK_COLUMNS,
    LINE_COLUMNS,
    RUN_COLUMNS,
    TEXT_COLUMNS,
)

STEP_M, VERTEX_M, SD_M = 0.25, 5.0, 0.4


def filled(columns: tuple[str, ...], rows: int, rng: np.random.Generator) -> pd.DataFrame:
    """Numbers with all their digits, so that nothing is stored smaller than real ones would be."""
    table = {}
    for name in columns:
        if name in TEXT_COLUMNS:
            table[name] = pd.Series([""] * rows, dtype="str")
        elif name in INTEGER_COLUMNS:
            table[name] = pd.Series(np.ones(rows, dtype=np.int64))
        else:
            table[name] = pd.Series(rng.uniform(0.1, 1.0, rows))
    return pd.DataFrame(table)


def made_up(km: float, runs: int) -> FeatureMap:
    """A map of ``km`` kilometres near the origin of its frame."""
    rng = np.random.default_rng(0)
    length = 1000.0 * km
    chainage = STEP_M * np.arange(round(length / STEP_M) + 1)
    marks = max(4 * round(km), 4)
    identity = pd.Series([f"C{i // 4:04d}-{CURVE_POINTS[i % 4]}" for i in range(marks)], dtype="str")
    vertices = VERTEX_M * np.arange(round(length / VERTEX_M) + 1)
    names = pd.Series([f"run{i}" for i in range(runs)], dtype="str")
    variables = (*(f"landmark/{mark}/chainage_m" for mark in identity), "offset_m", "scale")
    return FeatureMap(
        name="made up",
        conventions=MapConventions(1.067, 1.067, 10.0, 25.0, 10.0, STEP_M),
        landmarks=filled(LANDMARK_COLUMNS, marks, rng).assign(
            landmark_id=identity,
            kind=[CURVE_POINTS[i % 4] for i in range(marks)],
            chainage_m=np.sort(rng.uniform(0.0, length, marks)),
            chainage_m_sd=SD_M,
        ),
        covariance=np.eye(marks) * SD_M**2,
        grid=filled(GRID_COLUMNS, chainage.size, rng).assign(chainage_m=chainage),
        line=filled(LINE_COLUMNS, vertices.size, rng).assign(chainage_m=vertices, east_m=vertices),
        runs=filled(RUN_COLUMNS, runs, rng).assign(run_id=names, content_sha256=names),
        information={
            name: RunInformation(
                variables, rng.normal(size=(len(variables), len(variables))), rng.normal(size=len(variables))
            )
            for name in names
        },
        configuration={},
        software={},
        origin=(35.0, 137.0, 20.0),
    )


def measure(feature_map: FeatureMap, location: str) -> None:
    """Write two versions and read the newest."""
    file = Path(location)
    print(location.partition("?")[0] if "://" in location else file.name)
    versions = []
    for parent in (None, 1):
        began = time.perf_counter()
        versions.append(write_map(feature_map, location, parent=parent))
        size = f", {file.stat().st_size / 1e6:.0f} MB in all" if file.exists() else ""
        print(f"  version {versions[-1].version} written in {time.perf_counter() - began:.1f} s{size}")
    began = time.perf_counter()
    newest = read_map(location)
    print(f"  read in {time.perf_counter() - began:.1f} s")
    began = time.perf_counter()
    difference(versions[0], newest)
    print(f"  compared in {time.perf_counter() - began:.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--km", type=float, default=100.0, help="length of the line (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=10, help="runs in the map (default: %(default)s)")
    parser.add_argument("--url", help="a PostgreSQL database to measure too")
    options = parser.parse_args()
    feature_map = made_up(options.km, options.runs)
    print(f"{options.km:g} km: {len(feature_map.grid)} cells, {len(feature_map.landmarks)} landmarks")
    with tempfile.TemporaryDirectory() as folder:
        measure(feature_map, str(Path(folder) / "line.gpkg"))
    if options.url:
        measure(feature_map, options.url)
