"""One short drive, as arrays: what the tests write in each foreign form and expect back."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trackfg.interchange.importing.conversion import Imported, write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import propose
from trackfg.interchange.importing.proposals.questions import Question
from trackfg.interchange.importing.registry import source_format

sys.path.insert(0, str(Path(__file__).parents[4] / "tools"))

from interchange.foreign_forms import Drive


@pytest.fixture(scope="session")
def drive() -> Drive:
    """A start from rest along the x axis of a FLU sensor, 20 s at 100 Hz."""
    rng = np.random.default_rng(3)
    t = np.arange(2000) / 100.0
    acceleration = np.where((t > 4.0) & (t < 12.0), 0.8 * np.sin((t - 4.0) * np.pi / 4.0) ** 2, 0.0)
    speed = np.cumsum(acceleration) / 100.0
    gyro = 1e-3 * rng.standard_normal((t.size, 3))
    accel = 0.01 * rng.standard_normal((t.size, 3)) + np.stack([acceleration, 0 * t, 0 * t + 9.81], axis=1)
    gnss_t = np.arange(0.0, 20.0, 1.0)
    distance = np.interp(gnss_t, t, np.cumsum(speed) / 100.0)
    return Drive(t, gyro, accel, speed, gnss_t, 46.9 + distance / 111_200.0, 7.4 + 0 * gnss_t, 500.0 + 0 * gnss_t)


@pytest.fixture
def imported(tmp_path: Path) -> Callable[..., Imported]:
    """Import a source with answers by key, ``tach_pulses_per_rev`` for instance, and the default to other questions."""

    def run(source: Path, name: str | None = None, **answers: str) -> Imported:
        def answer(question: Question) -> str:
            return answers.get(question.key.replace(".", "_"), question.default)

        form = source_format(source, name)
        tables = form.tables(source, lambda _: None)
        proposal = propose(tables, answer, form.mapping(tables))
        mapping = mapping_of(proposal.sections, "proposal")
        return write_imported(tables, mapping, tmp_path / "imported", run_id=source.stem)

    return run
