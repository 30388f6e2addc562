"""Balises of a run: followed where known, surveyed where not, and named where their plan is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.config import PositionConfig, SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import Kind
from trackfg.mapping.runs.balise_survey import surveyed
from trackfg.numerics.arrays import Array
from trackfg.output.own_passages import own_passages
from trackfg.recording.description import Balises
from trackfg.recording.model import Recording
from trackfg.results.result import OPTIONAL_FILES, Result
from trackfg.smoothing.fixes.balise_fixes import with_balise_fixes
from trackfg.smoothing.smoother import smooth, smooth_states

COUNT, READING_SD, PLANNED_SD = 40, 0.1, 0.2
WRONG, UNKNOWN = 20, np.arange(3, COUNT, 6)


def _recording(*, off_m: float = 0.0, seed: int = 1, duration_s: float = 100.0) -> tuple[Recording, Array]:
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


def test_balises_with_known_places_anchor_a_run() -> None:
    recording, _ = _recording(duration_s=60.0)
    assert recording.balises is not None
    assert smooth(recording).summary.run.anchored
    unknown = recording.balises.assign(chainage_m=np.nan, chainage_sd_m=np.nan)
    assert not smooth(replace(recording, balises=unknown)).summary.run.anchored


def test_without_balises_a_result_has_no_table_of_them(tmp_path: Path) -> None:
    result = smooth(simulate("mainline", seed=1, duration_s=20.0).recording)
    assert not set(OPTIONAL_FILES) & {path.name for path in result.write(tmp_path / "out").iterdir()}
    assert Result.read(tmp_path / "out").balises.empty


@pytest.mark.slow
def test_surveyed_places_are_within_two_sigma_in_95_percent() -> None:
    within, normalised = [], []
    for seed in range(12):
        recording, places = _recording(seed=seed)
        table = smooth(recording).balises
        unknown = table[table["verdict"] == "surveyed"]
        z = (unknown["place_m"].to_numpy() - places[UNKNOWN]) / unknown["place_m_sd"].to_numpy()
        normalised.append(z)
        within.append(np.abs(z) < 2.0)
    assert np.mean(within) >= 0.93  # of 84 places, in groups that share their run's errors
    assert np.sqrt(np.mean(np.square(normalised))) == pytest.approx(1.0, abs=0.25)


def _to_and_fro() -> Recording:
    """Return shunting past eight balises, most of them more than once; every other place is known."""
    run = simulate("shunting", seed=0, duration_s=300.0)
    truth, rng = run.truth, np.random.default_rng(2)
    chainage, t = truth["chainage_m"].to_numpy(), truth["t_s"].to_numpy()
    rows = []
    for number, place in enumerate(np.linspace(chainage.min() + 5.0, chainage.max() - 5.0, 8)):
        beyond = chainage - place
        for k in np.flatnonzero(beyond[1:] * beyond[:-1] < 0.0):
            at = t[k] + (READING_SD * rng.normal() - beyond[k]) / (beyond[k + 1] - beyond[k]) * (t[k + 1] - t[k])
            rows.append((at, str(number), place if number % 2 else np.nan, PLANNED_SD if number % 2 else np.nan))
    table = pd.DataFrame(rows, columns=["t_s", "id", "chainage_m", "chainage_sd_m"]).sort_values("t_s")
    table = table[(table["t_s"].diff() != 0.0) & table["t_s"].between(t[0] + 1.0, t[-1] - 1.0)]
    balises = Balises(file="balises.csv", reading_sd_m=READING_SD)
    description = run.recording.description.model_copy(update={"fixes": None, "balises": balises})
    return replace(run.recording, fixes=None, balises=table.reset_index(drop=True), description=description)


def test_places_in_the_graph_are_those_of_the_survey() -> None:
    """Balises passed again are variables of the graph: fixes, their ties and the plan are one landmark each."""
    recording, config = _to_and_fro(), SmoothConfig(position=PositionConfig(robust=False))
    smoothed = smooth_states(with_balise_fixes(recording), config)
    passages = own_passages(recording, smoothed.problem, smoothed.solution.states)
    table = surveyed([passages], ["run"]).table.set_index("id")
    again = table.index[table["passes"] > 1]
    assert recording.balises is not None
    ids = [one for one in recording.balises["id"].unique() if one in again]
    assert len(ids) >= 4
    places = smoothed.solution.states.sensor.ravel()[: len(ids)]
    sd = np.sqrt(np.diag(smoothed.covariance.of(Kind.SENSOR)[0]))[: len(ids)]
    unknown = np.array([int(one) % 2 == 0 for one in ids])
    of_survey = table.loc[ids]
    np.testing.assert_allclose(places[unknown], of_survey["place_m"][unknown], atol=0.003)
    np.testing.assert_allclose(sd[unknown], of_survey["place_m_sd"][unknown], rtol=0.02)
    fixes = smoothed.problem.family(FactorType.ABSOLUTE_FIX)
    assert fixes is not None
    assert len(fixes) == recording.balises["chainage_m"].notna().sum()


def test_a_place_that_is_passed_again_is_known_no_better_than_its_plan() -> None:
    recording = _to_and_fro()
    assert recording.balises is not None
    known = recording.balises.dropna()
    known = known[known["id"] == known["id"].mode()[0]]
    fixes = with_balise_fixes(replace(recording, balises=known)).fixes
    assert fixes is not None
    n = len(known)
    assert n > 1
    together = 1.0 / np.sum(fixes["chainage_sd_m"] ** -2)
    assert together == pytest.approx(PLANNED_SD**2 + READING_SD**2 / n)
