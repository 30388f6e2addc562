"""A simulated run as a stream, and what came of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import pandas as pd
import pytest

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenarios import Scenario, scenario
from trackfg.recording.model import Recording
from trackfg.results.events import Event
from trackfg.streaming.checkpoint.snapshot import Snapshot, dump, load_attributes
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

TWICE_A_SECOND = SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))


def setting_off(name: str, start_rest_s: float = 12.0) -> Scenario:
    """Return the scenario of that name, which stands for less long at first: a first window takes ten seconds."""
    plan = scenario(name)
    return replace(plan, driver=replace(plan.driver, start_rest_s=start_rest_s))


class Streamed(NamedTuple):
    smoother: FixedLagSmoother
    filtered: pd.DataFrame
    smoothed: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[Event, ...]


def streamed(
    recording: Recording, *, lag_s: float, batch_s: float = 0.5, config: SmoothConfig = TWICE_A_SECOND
) -> Streamed:
    """A recording through intake and smoother."""
    source = RecordingSource(recording, batch_s=batch_s)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, config, lag_s=lag_s)
    pieces: list[Estimates] = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    filled = ([piece[i] for piece in pieces if len(piece[i])] for i in range(3))
    tables = (pd.concat(some, ignore_index=True) if some else pieces[0][i] for i, some in enumerate(filled))
    return Streamed(smoother, *tables, events=tuple(event for piece in pieces for event in piece.events))


@pytest.fixture(scope="session")
def stream() -> Callable[..., Streamed]:
    return streamed


def through_a_snapshot(thing: Any, given: tuple[object, ...] = ()) -> Any:
    """What a stage of a stream is after a checkpoint."""
    snapshot = dump(thing, given)
    saved = Snapshot(json.loads(json.dumps(snapshot.tree)), snapshot.data)
    return type(thing)(**load_attributes(type(thing), saved, given))


@pytest.fixture(scope="session")
def saved_and_restored() -> Callable[..., Any]:
    return through_a_snapshot
