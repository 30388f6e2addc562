"""Files of earlier versions can be read: tests/formats has a folder for each version that changed a format."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

import trackfg
from trackfg.maps.store import read_map

VERSIONS = sorted((Path(__file__).parents[1] / "formats").iterdir())
"""Folders named by the version of trackfg that wrote them; what they hold is never written again."""


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
def test_files_of_earlier_versions_are_read(folder: Path, tmp_path: Path) -> None:
    recording = trackfg.read_recording(folder / "recording")
    assert (len(recording.imu), recording.tach is not None, recording.fixes is not None) == (1875, True, True)

    result = trackfg.Result.read(folder / "result")
    assert result.summary.distance_m == pytest.approx(569.868, abs=1e-3)
    assert (len(result.trajectory), list(result.events["kind"])) == (75, ["standstill", "fix used"])

    (tmp_path / "map.gpkg").write_bytes(gzip.decompress((folder / "map.gpkg.gz").read_bytes()))
    grid = read_map(tmp_path / "map.gpkg").grid
    places = result.geometry["chainage_m"]
    assert grid["chainage_m"].between(places.iloc[0], places.iloc[-1]).all()
    assert len(grid) > 0.9 * len(places)
