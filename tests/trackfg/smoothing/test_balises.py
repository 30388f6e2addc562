"""Balises of a run: followed where known, surveyed where not, and named where their plan is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.config import PositionConfig, SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Balises
from trackfg.recording.model import Recording
from trackfg.results.result import OPTIONAL_FILES, Result
from trackfg.smoothing.smoother import smooth

COUNT, READING_SD, PLANNED_SD = 40, 0.1, 0.2
WRONG, UNKNOWN = 20, np.arange(3, COUNT, 6)


def _recording(*, off_m: float = 0.0, seed: int = 1, duration_s: float = 150.0) -> tuple[Recording, Array]:
    """Return a run past 40 balises, some with unknown places and one planned ``off_m`` m off, and where they are."""
    run = simulate("mainline", seed=seed, duration_s=duration_s)
    truth, rng = run.truth, np.random.default_rng(seed)
    chainage, t = truth["chainage_m"].to_numpy(), truth["t_s"].to_numpy()
    places = np.linspace(chainage[0] + 10.0, chainage[-1] - 10.0, COUNT)
    planned = places + PLANNED_SD * rng.normal(size=COUNT)
    planned[WRONG] += off_m
    planned[UNKNOWN] = np.nan
    passed = np.interp(places + READING_SD * rng.normal(size=COUNT), chainage, t)
    table = pd.DataFrame({"t_s": passed, "id": [f"B{i}" for i in range(COUNT)], "chainage_m": planned})
    table["chainage_sd_m"] = np.where(np.isnan(planned), np.nan, PLANNED_SD)
    balises = Balises(file="balises.csv", reading_sd_m=READING_SD)
    description = run.recording.description.model_copy(update={"fixes": None, "balises": balises})
    return replace(run.recording, fixes=None, balises=table, description=description), places


def test_one_of_forty_planned_9_m_off_is_named_and_bends_nothing(tmp_path: Path) -> None:
    recording, places = _recording(off_m=9.0)
    wrong, right = smooth(recording), smooth(_recording()[0])
    assert wrong.balises["verdict"].tolist().count("wrong") == 1
    row = wrong.balises.set_index("id").loc[f"B{WRONG}"]
    assert row["verdict"] == "wrong"
    assert row["sigmas"] < -4.0
    assert row["measured_m"] == pytest.approx(places[WRONG], abs=4.0 * row["measured_m_sd"])
    others = wrong.balises["id"] != f"B{WRONG}"
    assert np.abs(wrong.balises["place_m"] - right.balises["place_m"])[others].max() < 0.1
    assert np.abs(wrong.trajectory["chainage_m"] - right.trajectory["chainage_m"]).max() < 0.1
    (named,) = [finding for finding in wrong.summary.findings if finding.code == "balises-wrong"]
    assert f"B{WRONG} by -" in named.message
    surveyed = wrong.balises[wrong.balises["verdict"] == "surveyed"]
    assert surveyed["id"].tolist() == [f"B{i}" for i in UNKNOWN]
    off = surveyed["place_m"].to_numpy() - places[UNKNOWN]
    assert (np.abs(off) < 4.0 * surveyed["place_m_sd"]).all()
    again = Result.read(wrong.write(tmp_path / "out"))
    pd.testing.assert_frame_equal(again.balises, wrong.balises, check_dtype=False)
    pd.testing.assert_frame_equal(again.passages.to_frame(), wrong.passages.to_frame())
    Result.read(right.write(tmp_path / "out"))


def test_the_survey_of_one_run_is_the_graph_with_its_landmarks() -> None:
    """Where an unknown balise is, is where the vehicle was when it passed, by all fixes and everything else."""
    recording, _ = _recording()
    assert recording.balises is not None
    result = smooth(recording, SmoothConfig(position=PositionConfig(robust=False)))
    unknown = result.balises[result.balises["verdict"] == "surveyed"]
    at, trajectory = recording.balises["t_s"].to_numpy()[UNKNOWN], result.trajectory
    chainage, sd = (np.interp(at, trajectory["t_s"], trajectory[name]) for name in ("chainage_m", "chainage_m_sd"))
    np.testing.assert_allclose(unknown["place_m"], chainage, atol=0.005)
    np.testing.assert_allclose(unknown["place_m_sd"], np.hypot(sd, READING_SD), rtol=0.02)


def test_without_balises_a_result_has_no_table_of_them(tmp_path: Path) -> None:
    result = smooth(simulate("mainline", seed=1, duration_s=20.0).recording)
    assert not set(OPTIONAL_FILES) & {path.name for path in result.write(tmp_path / "out").iterdir()}
    assert Result.read(tmp_path / "out").balises.empty


@pytest.mark.slow
def test_surveyed_places_are_within_two_sigma_in_95_percent() -> None:
    within, normalised = [], []
    for seed in range(20):
        recording, places = _recording(seed=seed, duration_s=120.0)
        table = smooth(recording).balises
        unknown = table[table["verdict"] == "surveyed"]
        z = (unknown["place_m"].to_numpy() - places[UNKNOWN]) / unknown["place_m_sd"].to_numpy()
        normalised.append(z)
        within.append(np.abs(z) < 2.0)
    assert np.mean(within) >= 0.93  # of 140 places, in groups that share their run's errors
    assert np.sqrt(np.mean(np.square(normalised))) == pytest.approx(1.0, abs=0.25)
