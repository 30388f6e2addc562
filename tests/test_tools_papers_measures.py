"""What the papers' benchmark counts: slips missed, start points, the worst 200 m, the best method of a speed band."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def positioning(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("papers.positioning")


@pytest.fixture
def versines(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("papers.versines")


def wet_run() -> SimpleNamespace:
    """10 m/s with two slips: one to 20 %, one to 5 %; balises at 50, 150 and 250 s."""
    t = np.arange(0.0, 301.0)
    return SimpleNamespace(
        truth=pd.DataFrame({"t_s": t, "chainage_m": 10.0 * t, "speed_mps": 10.0}),
        slips=pd.DataFrame({"start_s": [100.0, 200.0], "end_s": [104.0, 206.0], "peak_creep": [0.2, -0.05]}),
        recording=SimpleNamespace(fixes=pd.DataFrame({"t_s": [10.0, 50.0, 150.0, 250.0]})),
    )


def test_slips_are_found_by_overlap_and_strong_above_3_7_kmh(positioning: ModuleType) -> None:
    run = wet_run()
    events = pd.DataFrame({"kind": ["slip", "fix used"], "start_s": [99.0, 203.0], "end_s": [101.0, 203.0]})
    assert positioning._found(run.slips, events).tolist() == [True, False]
    assert positioning._found(run.slips, events[:0]).tolist() == [False, False]
    assert positioning._strong(run).tolist() == [True, False]
    begins = pd.DataFrame({"start_s": [99.0, 101.0, 204.0]})
    assert positioning._starts_in_slip(run.slips, begins).tolist() == [False, True, True]


def test_a_distance_is_wrong_by_its_share(positioning: ModuleType) -> None:
    run = wet_run()
    legs = positioning.legs_with_slip(run)
    np.testing.assert_allclose(legs, [[50.0, 150.0], [150.0, 250.0]])
    wheel = pd.DataFrame({"t_s": [0.0, 100.0, 104.0, 300.0], "chainage_m": [0.0, 1000.0, 1050.0, 3010.0]})
    np.testing.assert_allclose(positioning.errors_percent(run, wheel, legs, 1.0), [1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(positioning.errors_percent(run, wheel, legs, 1.01), [2.01, 1.0], atol=1e-9)


def test_worst_200_m_are_those_of_middle_speed(versines: ModuleType) -> None:
    place = np.arange(0.0, 2000.0, 0.25)
    error = np.where((place >= 700.0) & (place < 900.0), 1.0, 0.1) + np.where(place > 1500.0, 5.0, 0.0)
    table = pd.DataFrame({"place_m": place, "level": -error, "kmh": np.where(place > 1500.0, 90.0, 40.0)})
    assert versines._worst_section(table, "level") == (700.0, 899.75)


def test_a_band_is_held_against_the_best_method_there(versines: ModuleType) -> None:
    column = {f"{method} level 10": [1.0, 3.0] for method in versines.METHODS}
    column |= {"difference level 10": [0.5, 0.7], "smoother level 10": [0.6, 0.7]}
    line = versines._band(column, "level", 10)
    assert "difference" in line.quantity
    assert line.met is False
    assert versines._band(column | {"smoother level 10": [0.5, 0.6]}, "level", 10).met is True
