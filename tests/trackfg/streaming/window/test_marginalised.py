"""Long stops: what is kept of them, and that nothing else changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import simulate


@pytest.mark.slow
def test_of_a_long_stop_only_its_ends_are_kept(stream: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    plan = scenario("shunting")
    plan = replace(plan, driver=replace(plan.driver, dwell_s=(120.0, 121.0)))
    recording = simulate(plan, seed=2, duration_s=300.0).recording
    ours = stream(recording, lag_s=10.0, config=SmoothConfig())
    kept = len(ours.smoother._tables.history.t)
    samples = len(ours.smoother._buffer.inertial)
    monkeypatch.setattr("trackfg.streaming.window.marginalised._AT_REST_M", -1.0)
    whole = stream(recording, lag_s=10.0, config=SmoothConfig())
    assert kept < 0.5 * len(whole.smoother._tables.history.t)
    assert samples < 0.5 * len(whole.smoother._buffer.inertial)
    assert len(ours.smoothed) == len(whole.smoothed)
    for one, other, name in (
        (ours.smoothed, whole.smoothed, "roll_rad"),
        (ours.smoothed, whole.smoothed, "chainage_m"),
        (ours.geometry, whole.geometry, "cross_level_mm"),
        (ours.geometry, whole.geometry, "versine_level_mm"),
        (ours.geometry, whole.geometry, "curvature_1pm"),
    ):
        assert len(one) == len(other)
        np.testing.assert_allclose(one[name], other[name], atol=0.02 * other[f"{name}_sd"].median(), rtol=1e-9)
        ratio = (one[f"{name}_sd"] / other[f"{name}_sd"]).dropna()  # it is made from those of the keyframes about
        assert ratio.between(0.75, 1.33).all()
        # Sigmas of geometry are from 64 samples: each knows them to 9 %.
        assert ratio.median() == pytest.approx(1.0, abs=0.06 if name == "curvature_1pm" else 0.03)
