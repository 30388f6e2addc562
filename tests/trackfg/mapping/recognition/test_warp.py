from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfg.mapping.recognition.warp import Warp, warped


@given(
    st.lists(st.floats(1.0, 300.0), min_size=1, max_size=20),
    st.lists(st.floats(-0.4, 0.4), min_size=20, max_size=20),
    st.floats(-1e4, 1e4),
)
def test_inverse_undoes_it(gaps: list[float], errors: list[float], place: float) -> None:
    old = np.cumsum(gaps)
    warp = Warp(old, old + np.array(errors[: len(old)]))
    assert abs(warp.inverse(warp(np.array([place])))[0] - place) < 1e-7


def test_places_must_ascend() -> None:
    with pytest.raises(ValueError, match="ascend"):
        Warp(np.array([0.0, 1.0]), np.array([1.0, 1.0]))


def test_a_table_by_another_chainage() -> None:
    x = np.arange(0.0, 500.0, 0.25)
    wave = np.sin(x / 2.0)
    table = pd.DataFrame(
        {"chainage_m": x, "level_mm": wave, "level_mm_sd": 0.1 + 1e-4 * x, "observations": np.full(len(x), 2)}
    )
    warp = Warp(np.array([0.0, 250.0, 500.0]), np.array([0.13, 250.4, 500.1]))
    there = warped(table, warp, 0.25)
    new = there["chainage_m"].to_numpy()
    assert np.abs(new / 0.25 - np.rint(new / 0.25)).max() < 1e-9
    inside = slice(20, -20)
    expected = np.sin(warp.inverse(new) / 2.0)
    np.testing.assert_allclose(there["level_mm"].to_numpy()[inside], expected[inside], atol=1e-6)
    assert (there["observations"] == 2).all()
    np.testing.assert_allclose(there["level_mm_sd"].to_numpy()[inside], (0.1 + 1e-4 * warp.inverse(new))[inside])


def test_gaps_stay_gaps() -> None:
    x = np.concatenate([np.arange(0.0, 100.0, 0.25), np.arange(200.0, 300.0, 0.25)])
    table = pd.DataFrame({"chainage_m": x, "level_mm": x, "level_mm_sd": 0.1, "observations": 1})
    there = warped(table, Warp(np.zeros(1), np.array([0.1])), 0.25)
    assert not there["chainage_m"].between(101.0, 199.0).any()
    known = there.dropna()
    np.testing.assert_allclose(known["level_mm"], known["chainage_m"] - 0.1, atol=1e-6)
