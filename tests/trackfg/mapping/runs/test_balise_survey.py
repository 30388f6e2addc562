"""The survey of balises finds places, wrong plans, misread ids and wheels that erred, with sigmas that hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.mapping.runs.balise_survey import BaliseSurvey, surveyed
from trackfg.numerics.arrays import Array
from trackfg.results.balise_passages import PASSAGE_COLUMNS, BalisePassages

READING_SD, PLANNED_SD = 0.1, 0.2
SCALE_SD, CREEP_SD = 1e-2, 5e-3
"""Of a wheel: its scale, and a random walk, m per root of a metre."""


def _run(
    rng: np.random.Generator, places: Array, planned: Array, passed: np.ndarray | None = None, sign: int = 1
) -> BalisePassages:
    """Return what a wheel measures of the places with numbers ``passed``, from an unknown start."""
    number = np.arange(len(places)) if passed is None else passed
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places[number])))])
    shared = np.minimum(way[:, None], way[None])
    moved = sign * (places[number] - places[number[0]])
    covariance = SCALE_SD**2 * np.outer(moved, moved) + CREEP_SD**2 * shared
    error = rng.multivariate_normal(np.zeros(len(number)), covariance)
    measured = places[number] + error + READING_SD * rng.normal(size=len(number)) + 1000.0 * rng.normal()
    known = np.isfinite(planned[number])
    table = pd.DataFrame(
        {
            "t_s": way / 20.0,
            "id": [str(one) for one in number],
            "chainage_m": measured,
            "reading_m_sd": READING_SD,
            "planned_m": planned[number],
            "planned_m_sd": np.where(known, PLANNED_SD, np.nan),
        }
    )
    return BalisePassages(table[list(PASSAGE_COLUMNS)], covariance)


def _line(rng: np.random.Generator, count: int = 40, unknown: int = 0) -> tuple[Array, Array]:
    """Return places of balises, and their plans, some of them unknown."""
    places = np.cumsum(rng.uniform(50.0, 300.0, size=count))
    planned = places + PLANNED_SD * rng.normal(size=count)
    planned[rng.permutation(count)[:unknown]] = np.nan
    return places, planned


def _names(runs: list[BalisePassages]) -> list[str]:
    return [f"run {number}" for number in range(len(runs))]


def _by_number(survey: BaliseSurvey) -> pd.DataFrame:
    return survey.table.set_index(survey.table["id"].astype(int)).sort_index()


@pytest.mark.parametrize("count", [1, 3])
def test_sigmas_hold_of_places_and_of_differences(count: int) -> None:
    """Normalised errors over 40 lines: rms 1 and 95 % within 1.96, of surveyed places and of plans alike."""
    rng = np.random.default_rng(count)
    of_places, of_unknown, of_plans, of_measured = [], [], [], []
    for _ in range(40):
        places, planned = _line(rng, 20, unknown=5)
        runs = [_run(rng, places, planned) for _ in range(count)]
        table = _by_number(surveyed(runs, _names(runs)))
        error = (table["place_m"] - places) / table["place_m_sd"]
        of_places.append(error)
        of_unknown.append(error[table["verdict"] == "surveyed"])
        of_plans.append(table["sigmas"].dropna())
        of_measured.append((table["measured_m"] - places) / table["measured_m_sd"])
    for normalised in map(np.concatenate, (of_places, of_unknown, of_plans, of_measured)):
        assert np.sqrt(np.mean(normalised**2)) == pytest.approx(1.0, abs=0.1)
        assert np.mean(np.abs(normalised) < 1.96) == pytest.approx(0.95, abs=0.03)


def test_one_wrong_plan_of_forty_is_found_and_bends_nothing() -> None:
    rng = np.random.default_rng(5)
    for wrong in (1, 17, 38):
        places, planned = _line(rng, unknown=0)
        right = _run(rng, places, planned)
        table = right.table.copy()
        table.loc[wrong, "planned_m"] += 9.0
        clean = _by_number(surveyed([right], ["right"]))
        found = _by_number(surveyed([replace(right, table=table)], ["wrong"]))
        assert found.index[found["verdict"] == "wrong"].tolist() == [wrong]
        assert found.loc[wrong, "sigmas"] < -4.0
        assert found.loc[wrong, "difference_m"] == pytest.approx(-9.0, abs=4.0 * found.loc[wrong, "difference_m_sd"])
        others = np.arange(40) != wrong
        assert np.abs(found["place_m"] - clean["place_m"])[others].max() < 0.1


def test_right_plans_are_not_named() -> None:
    rng = np.random.default_rng(6)
    named = 0
    for _ in range(25):
        places, planned = _line(rng)
        named += int((_by_number(surveyed([_run(rng, places, planned)], ["run"]))["verdict"] == "wrong").sum())
    assert named <= 1  # of 1000 plans, 6e-5 of which are beyond 4 sigma


def test_a_misread_id_is_distinguished_from_a_wrong_plan_by_other_runs() -> None:
    rng = np.random.default_rng(7)
    places, planned = _line(rng, 12)
    runs = [_run(rng, places, planned) for _ in range(3)]
    table = runs[1].table.copy()
    table.loc[5, "chainage_m"] -= 7.0
    survey = surveyed([runs[0], replace(runs[1], table=table), runs[2]], ["a", "b", "c"])
    assert (survey.table["verdict"] == "agrees").all()
    assert survey.misread[["run", "id"]].to_numpy().tolist() == [["b", "5"]]
    assert survey.misread["off_m"].iloc[0] == pytest.approx(-7.0, abs=1.0)
    assert _by_number(survey).loc[5, "left_out"] == 1


def test_a_wheel_that_erred_is_distinguished_from_wrong_plans() -> None:
    rng = np.random.default_rng(8)
    places, planned = _line(rng, 12)
    runs = [_run(rng, places, planned) for _ in range(2)]
    table = runs[0].table.copy()
    table.loc[6:, "chainage_m"] += 8.0
    survey = surveyed([replace(runs[0], table=table), runs[1]], ["a", "b"])
    assert (survey.table["verdict"] == "agrees").all()
    (slip,) = survey.slips.to_dict("records")
    assert (slip["run"], slip["from_s"], slip["to_s"]) == ("a", table["t_s"][5], table["t_s"][6])
    assert slip["off_m"] == pytest.approx(8.0, abs=4.0 * slip["off_m_sd"])


def test_an_id_that_two_balises_have_is_left_out_at_one_of_them() -> None:
    """Passed at two places of a line in each of two runs: both passages cannot be of one balise."""
    rng = np.random.default_rng(9)
    places, planned = _line(rng, 12)
    runs = [_run(rng, places, planned) for _ in range(2)]
    for run in runs:
        run.table.loc[9, ["id", "planned_m"]] = ["3", planned[3]]
    survey = surveyed(runs, ["a", "b"])
    assert sorted(survey.misread["id"]) == ["3", "3"]
    table = _by_number(survey)
    others = [number for number in range(12) if number not in (3, 9)]
    assert (table.loc[others, "verdict"] == "agrees").all()
    assert np.abs(table.loc[others, "place_m"] - places[others]).max() < 1.0


def test_passages_of_one_balise_tie_a_run_together() -> None:
    """There and back over the same balises: the scale of the wheel shows in how places come twice."""
    rng = np.random.default_rng(10)
    places, planned = _line(rng, 6)
    planned[1:] = np.nan
    there = np.concatenate([np.arange(6), np.arange(5)[::-1]])
    once, twice = _run(rng, places, planned), _run(rng, places, planned, there)
    table = _by_number(surveyed([twice], ["run"]))
    assert table["passes"].tolist() == [2, 2, 2, 2, 2, 1]
    assert (table["verdict"][1:] == "surveyed").all()
    assert (np.abs(table["place_m"] - places) < 4.0 * table["place_m_sd"]).all()
    alone = _by_number(surveyed([once], ["run"]))
    assert (table["place_m_sd"] <= alone["place_m_sd"] + 1e-9).all()


def test_a_run_without_any_known_place_helps_another() -> None:
    rng = np.random.default_rng(11)
    places, planned = _line(rng, 10, unknown=4)
    known, lost = _run(rng, places, planned), _run(rng, places, np.full(10, np.nan))
    with_one, with_both = (_by_number(surveyed(runs, _names(runs))) for runs in ([known], [known, lost]))
    assert (with_both["place_m_sd"] < with_one["place_m_sd"]).all()
    assert (np.abs(with_both["place_m"] - places) < 4.0 * with_both["place_m_sd"]).all()


def test_without_plans_places_count_in_the_first_run() -> None:
    rng = np.random.default_rng(12)
    places = np.linspace(0.0, 1000.0, 6)
    run = _run(rng, places, np.full(6, np.nan))
    table = _by_number(surveyed([run], ["run"]))
    assert (table["verdict"] == "relative").all()
    np.testing.assert_allclose(table["place_m"], run.table["chainage_m"])


def test_the_only_plan_is_not_checked() -> None:
    rng = np.random.default_rng(13)
    places, planned = _line(rng, 6)
    planned[[0, 1, 2, 4, 5]] = np.nan
    table = _by_number(surveyed([_run(rng, places, planned)], ["run"]))
    assert table.loc[3, "verdict"] == "unchecked"
    assert np.isnan(table.loc[3, ["measured_m", "difference_m", "sigmas"]].astype(float)).all()
    assert table.loc[3, "place_m"] == pytest.approx(planned[3])


def test_of_two_plans_that_contradict_each_other_neither_is_named() -> None:
    rng = np.random.default_rng(14)
    places = np.array([0.0, 200.0])
    run = _run(rng, places, places + np.array([0.0, 30.0]))
    table = _by_number(surveyed([run], ["run"]))
    assert (table["verdict"] == "undecided").all()


def test_plans_from_elsewhere_hold_instead_of_the_runs_own() -> None:
    rng = np.random.default_rng(15)
    places, planned = _line(rng, 5)
    a, b = _run(rng, places, planned), _run(rng, places, planned + 0.5)
    with pytest.raises(BadInputError, match="--planned"):
        surveyed([a, b], ["a", "b"])
    given = pd.DataFrame({"id": [*"01234", "far"], "chainage_m": [*planned, 9e4], "chainage_sd_m": PLANNED_SD})
    table = surveyed([a, b], ["a", "b"], given).table
    np.testing.assert_allclose(table["planned_m"], given["chainage_m"])
    assert table["verdict"].tolist() == ["agrees"] * 5 + ["not passed"]


def test_fixes_without_an_id_are_places_of_their_own() -> None:
    rng = np.random.default_rng(16)
    places, planned = _line(rng, 8)
    run = _run(rng, places, planned)
    run.table.loc[[0, 7], "id"] = ""
    table = surveyed([run], ["run"]).table
    assert table["id"].tolist() == list("123456")
    assert (table["verdict"] == "agrees").all()


def test_no_balises_are_refused() -> None:
    with pytest.raises(BadInputError, match="no balise"):
        surveyed([BalisePassages.none()], ["run"])
