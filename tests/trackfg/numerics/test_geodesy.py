"""East, north and up to latitude and longitude, held against the way there and, where it is installed, PROJ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfg.numerics.geodesy import ecef_to_geodetic, enu_to_geodetic, geodetic_to_ecef, geodetic_to_enu

METRES_PER_DEGREE = 111e3


@given(st.floats(-89.0, 89.0), st.floats(-179.9, 179.9), st.floats(-500.0, 9000.0))
def test_ecef_there_and_back(latitude: float, longitude: float, height: float) -> None:
    place = np.array([latitude, longitude, height])
    found = ecef_to_geodetic(geodetic_to_ecef(place))
    np.testing.assert_allclose((found - place)[:2], 0.0, atol=1e-8 / METRES_PER_DEGREE * 10.0)
    assert found[2] == pytest.approx(height, abs=1e-8)


@given(st.floats(-80.0, 80.0), st.floats(-179.9, 179.9), st.floats(-150e3, 150e3), st.floats(-150e3, 150e3))
def test_enu_there_and_back(latitude: float, longitude: float, east: float, north: float) -> None:
    origin = (latitude, longitude, 120.0)
    enu = np.array([[east, north, 35.0], [0.0, 0.0, 0.0]])
    geodetic = enu_to_geodetic(enu, origin)
    np.testing.assert_allclose(geodetic_to_enu(geodetic, np.array(origin)), enu, atol=1e-7)
    np.testing.assert_allclose(geodetic[1], origin, atol=1e-9)
    np.testing.assert_allclose(geodetic[:, 2], [155.0, 120.0], atol=1e-7)


def test_agrees_with_proj() -> None:
    pyproj = pytest.importorskip("pyproj")
    ecef = geodetic_to_ecef(np.array([[35.2, 137.1, 40.0], [-33.0, -70.5, 520.0], [60.0, 25.0, -3.0]]))
    to_geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    longitude, latitude, height = to_geodetic.transform(*ecef.T)
    np.testing.assert_allclose(ecef_to_geodetic(ecef), np.column_stack([latitude, longitude, height]), atol=1e-8)
