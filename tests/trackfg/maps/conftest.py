"""A made-up map of any size, and where to keep it: a file, or a PostgreSQL server of the tests' own."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.maps import FeatureMap, MapConventions, RunInformation
from trackfg.maps.feature_map import (
    CURVE_POINTS,
    GRID_COLUMNS,
    LANDMARK_COLUMNS,
    LINE_COLUMNS,
    RUN_COLUMNS,
    TEXT_COLUMNS,
)

sys.path.insert(0, str(Path(__file__).parents[3] / "tools"))

from faults.server import Server, programs, running_server

MakeMap = Callable[..., FeatureMap]


@pytest.fixture(scope="session")
def make_map() -> MakeMap:
    def make(
        *,
        curves: int = 3,
        cells: int = 1601,
        runs: int = 2,
        seed: int = 0,
        origin: tuple[float, float, float] | None = None,
        name: str = "line",
    ) -> FeatureMap:
        rng = np.random.default_rng(seed)
        chainage = np.arange(cells) * 0.25
        grid = pd.DataFrame({column: rng.uniform(0.1, 1.0, cells) for column in GRID_COLUMNS})
        grid["chainage_m"] = chainage
        grid["observations"] = rng.integers(1, 9, cells)
        grid.loc[grid.index[3:7], ["cant_mm", "cant_mm_sd"]] = np.nan
        landmarks, covariance = _landmarks(rng, curves, chainage[-1])
        line = pd.DataFrame({column: np.full(cells // 20 + 1, 0.5) for column in LINE_COLUMNS})
        line["chainage_m"] = np.arange(len(line)) * 5.0
        line["east_m"] = line["chainage_m"]
        line["north_m"] = 80.0 * np.sin(line["chainage_m"] / 400.0)
        return FeatureMap(
            name=name,
            conventions=MapConventions(1.067, 1.067, 10.0, 25.0, 10.0),
            landmarks=landmarks,
            covariance=covariance,
            grid=grid,
            line=line,
            runs=_runs(rng, runs),
            information={f"run{i}": _information(i, landmarks) for i in range(runs)},
            configuration={"gate": 3.0, "laws": ["clothoid", "half-sine"], "note": "Strecke Ä", "map": None},
            software={"trackfg": "0.1", "numpy": "2.4"},
            origin=origin,
        )

    return make


def _landmarks(rng: np.random.Generator, curves: int, length_m: float) -> tuple[pd.DataFrame, np.ndarray]:
    n = 4 * curves + 1
    root = np.tril(rng.normal(size=(n, n))) / np.sqrt(n) + np.eye(n)
    covariance = root @ root.T
    covariance = (covariance + covariance.T) / 2.0
    table = pd.DataFrame({column: rng.uniform(0.1, 1.0, n) for column in LANDMARK_COLUMNS})
    table["landmark_id"] = [f"C{i // 4:03d}-{CURVE_POINTS[i % 4]}" for i in range(n - 1)] + ["fix-1"]
    table["kind"] = [CURVE_POINTS[i % 4] for i in range(n - 1)] + ["fix"]
    table["curve_id"] = [f"C{i // 4:03d}" for i in range(n - 1)] + [""]
    table["name"] = [""] * (n - 1) + ['Balise 7, "O\'Hara"; DROP TABLE x -- 駅\n']
    table["sense"] = ["left", "left", "left", "right"] * curves + [""]
    table["law"] = ["clothoid"] * (n - 1) + [""]
    table["chainage_m"] = np.sort(rng.uniform(0.0, length_m, n))
    table["chainage_m_sd"] = np.sqrt(np.diag(covariance))
    table["radius_m"] = [*rng.uniform(200.0, 2000.0, n - 1), np.nan]
    table["east_m"] = table["chainage_m"]
    table["north_m"] = 80.0 * np.sin(table["chainage_m"] / 400.0)
    table.loc[table.index[-1], ["east_m", "north_m", "up_m"]] = np.nan
    table["observations"] = rng.integers(1, 9, n)
    for column in TEXT_COLUMNS.intersection(LANDMARK_COLUMNS):
        table[column] = table[column].astype("str")
    return table, covariance


def _runs(rng: np.random.Generator, runs: int) -> pd.DataFrame:
    table = pd.DataFrame({column: rng.uniform(0.1, 1.0, runs) for column in RUN_COLUMNS})
    table["run_id"] = [f"run{i}" for i in range(runs)]
    table["recording_id"] = [f"2026-05-{i + 1:02d}-down" for i in range(runs)]
    table["start"] = [f"2026-05-{i + 1:02d}T03:12:00+00:00" if i else "" for i in range(runs)]
    table["content_sha256"] = [f"{i:064x}" for i in range(runs)]
    table["direction"] = [1 if i % 2 == 0 else -1 for i in range(runs)]
    for column in TEXT_COLUMNS.intersection(RUN_COLUMNS):
        table[column] = table[column].astype("str")
    return table


def _information(run: int, landmarks: pd.DataFrame) -> RunInformation:
    """What a run said does not depend on the map's seed: it is the same in every version."""
    rng = np.random.default_rng(1000 + run)
    marks = (f"landmark/{mark}/chainage_m" for mark in landmarks["landmark_id"])
    variables = (*marks, f"run/run{run}/offset_m")
    n = len(variables)
    root = np.triu(rng.normal(size=(n, n)))
    return RunInformation(variables, root, rng.normal(size=n))


@pytest.fixture(scope="session")
def assert_same_map() -> Callable[[FeatureMap, FeatureMap], None]:
    """Bit for bit, but for what the store gives: version, parent and time."""
    return _assert_same_map


def _assert_same_map(found: FeatureMap, expected: FeatureMap) -> None:
    for name in ("landmarks", "grid", "line", "runs"):
        pd.testing.assert_frame_equal(getattr(found, name), getattr(expected, name), check_exact=True)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    assert set(found.information) == set(expected.information)
    for run, said in expected.information.items():
        read = found.information[run]
        assert read.variables == said.variables
        np.testing.assert_array_equal(read.R, said.R)
        np.testing.assert_array_equal(read.d, said.d)
    for name in ("name", "conventions", "configuration", "software", "origin"):
        assert getattr(found, name) == getattr(expected, name), name


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    """A server for the tests, with the databases ``plain`` and, where it can be, ``spatial`` (with PostGIS)."""
    if programs() is None:
        pytest.skip("no PostgreSQL server installed")
    pytest.importorskip("psycopg")
    with running_server() as running:
        yield running


@pytest.fixture(params=["gpkg", "plain", "spatial"])
def location(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A place without a map yet: a file, a schema of PostgreSQL, and of PostgreSQL with PostGIS."""
    if request.param == "gpkg":
        yield str(tmp_path / "line.gpkg")
        return
    server: Server = request.getfixturevalue("server")
    if request.param == "spatial" and not server.postgis:
        pytest.skip("PostGIS not installed")
    yield server.url(request.param, "line")
    server.sql(request.param, "SET client_min_messages = error; DROP SCHEMA IF EXISTS line CASCADE")
