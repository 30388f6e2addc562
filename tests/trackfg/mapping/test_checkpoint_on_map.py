"""A stream that is located on a map goes on from its state as if it had not been stopped."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.maps.feature_map import FeatureMap
from trackfg.streaming.checkpoint.snapshot import Snapshot
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource


@pytest.mark.slow
def test_while_it_is_sought_and_when_it_is_found(line_map: FeatureMap, ride: Callable[..., Any]) -> None:
    recording = replace(ride(4).simulation.recording, fixes=None)
    source = RecordingSource(recording, batch_s=1.0)
    intake = Intake.of(source)

    def made() -> FixedLagSmoother:
        return FixedLagSmoother(recording.description, lag_s=10.0, feature_map=line_map)

    smoother, again, end = made(), made(), np.inf
    for batch in source:
        rows = intake.push(batch)[0]
        ours, theirs = smoother.put(rows), again.put(rows)
        for one, other in zip(ours, theirs, strict=True):
            assert one.equals(other) if hasattr(one, "equals") else one == other
        if "located" in {event.kind for event in theirs.events}:
            end = batch.position + 40_000  # two more states, of a stream that is located
        if batch.position % 20_000 == 0:
            state = again.state()
            assert len(state.data) < 4_000_000
            tree = json.loads(json.dumps(state.tree))
            again = made()
            again.restore(Snapshot(tree, state.data))
        if batch.position >= end:
            break
    assert np.isfinite(end)
