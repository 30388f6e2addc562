"""How a map is drawn: pieces of the line, places of landmarks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from trackfg.maps import FeatureMap
from trackfg.maps.layers import layers
from trackfg.numerics.geodesy import geodetic_to_enu

MakeMap = Callable[..., FeatureMap]


def line_without(feature_map: FeatureMap, *missing: int) -> FeatureMap:
    line = feature_map.line.copy()
    line.loc[list(missing), ["east_m", "north_m", "up_m"]] = np.nan
    return dataclasses.replace(feature_map, line=line)


def test_pieces_join_at_whole_kilometres(make_map: MakeMap) -> None:
    made = make_map(cells=10_001)
    _, line = layers(made)
    assert [piece[[0, -1], 3].tolist() for piece in line.coordinates if piece is not None] == [
        [0.0, 1000.0],
        [1000.0, 2000.0],
        [2000.0, 2500.0],
    ]
    for before, after in pairwise(line.coordinates):
        assert before is not None
        assert after is not None
        np.testing.assert_array_equal(before[-1], after[0])
    assert line.extent == (0.0, made.line["north_m"].min(), 2500.0, made.line["north_m"].max())


@pytest.mark.parametrize(
    ("missing", "spans"),
    [
        ([10, 11], [[0.0, 45.0], [60.0, 100.0]]),
        ([0], [[5.0, 100.0]]),
        ([20], [[0.0, 95.0]]),
        ([1], [[10.0, 100.0]]),
        (list(range(21)), []),
    ],
)
def test_a_missing_position_breaks_the_line(make_map: MakeMap, missing: list[int], spans: list[list[float]]) -> None:
    _, line = layers(line_without(make_map(cells=401), *missing))
    assert [piece[[0, -1], 3].tolist() for piece in line.coordinates if piece is not None] == spans
    assert line.attributes.to_numpy().tolist() == spans
    assert (line.extent is None) == (not spans)


def test_georeferenced_places(make_map: MakeMap) -> None:
    origin = (35.2, 137.1, 40.0)
    made = make_map(origin=origin)
    marks, _ = layers(made)
    lonlat = np.array([place for place in marks.coordinates if place is not None])
    enu = geodetic_to_enu(lonlat[:, [1, 0, 2]], np.array(origin))
    known = made.landmarks[["east_m", "north_m", "up_m"]].dropna()
    np.testing.assert_allclose(enu, known, atol=1e-6)
