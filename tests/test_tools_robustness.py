"""The acceptance of rough recordings: its cases, its scores, and what counts as a miss."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.effects.catalogue import EFFECTS
from trackfg.errors import BadInputError

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    monkeypatch.syspath_prepend(TOOLS)
    names = ("cases", "combined", "low_cost", "scores", "table")
    return SimpleNamespace(**{name: importlib.import_module(f"robustness.{name}") for name in names})


def row(**changes: object) -> dict[str, object]:
    """A quantity of a run about which there is nothing to say."""
    usual: dict[str, object] = {
        "case": "shaken",
        "seed": 1,
        "estimator": "smoother",
        "quantity": "roll_mrad",
        "verdict": "trusted",
        "rms": 1.0,
        "mean_sd": 1.0,
        "ratio": 1.0,
        "coverage": 0.95,
        "far": 0.0,
        "converged": True,
        "findings": "",
    }
    return usual | changes


def test_all_effects_have_cases_and_hours_are_left_out(tools: SimpleNamespace) -> None:
    chosen = {(case.effect, case.magnitude) for case in tools.cases.cases([]) if case.effect != "clean"}
    assert chosen == {(name, size) for name, kind in EFFECTS.items() for size in kind.magnitudes if name != "long-rest"}
    assert {effect for effect, _ in tools.cases.ORACLES} <= set(EFFECTS)
    assert set(tools.cases.STREAMED) <= set(EFFECTS)


def test_a_case_is_chosen_by_name_and_magnitude(tools: SimpleNamespace) -> None:
    chosen = tools.cases.cases(["imu-noise=4", "canyon"])
    assert [case.name for case in chosen] == [
        "imu-noise 4, odometry",
        *(f"canyon {size}, {base}" for size in (5, 10) for base in ("gnss", "gnss alone")),
    ]
    with pytest.raises(BadInputError, match="wobble"):
        tools.cases.cases(["wobble"])


def test_the_oracle_of_a_case_is_the_same_ride(tools: SimpleNamespace) -> None:
    (case,) = tools.cases.cases(["imu-noise=10"])
    run, oracle = (case.simulated(1, 60.0, for_oracle=for_oracle) for for_oracle in (False, True))
    assert case.has_oracle
    assert run.recording.imu.equals(oracle.recording.imu)
    assert oracle.recording.description.imu.noise.gyro_white == pytest.approx(
        10.0 * run.recording.description.imu.noise.gyro_white
    )
    (alone,) = (case for case in tools.cases.cases(["canyon=5"]) if case.base == "gnss alone")
    assert alone.simulated(1, 60.0).recording.tach is None


def test_effects_come_together_at_random(tools: SimpleNamespace) -> None:
    runs = [tools.combined.CombinedRun(number) for number in range(40)]
    names = [run.name for run in runs]
    assert len(set(names)) == 40
    assert tools.combined.CombinedRun(7).name == names[7]
    assert all(any(place in name for name in names) for place in ("odometry", "fixes", "gnss,", "gnss alone"))
    assert not any("late-tach" in name for name in names if "gnss alone" in name)
    alone = next(run for run in runs if "gnss alone" in run.name)
    assert alone.simulated().recording.tach is None


def test_random_runs_repeat_and_differ(tools: SimpleNamespace) -> None:
    runs = [tools.low_cost.LowCostRun(number) for number in range(40)]
    names = [run.name for run in runs]
    assert len(set(names)) == 40
    assert tools.low_cost.LowCostRun(7).name == names[7]
    assert 3 <= sum("no rest" in name for name in names) <= 20
    first, again = (tools.low_cost.LowCostRun(4).simulated().recording for _ in range(2))
    assert first.content_sha256() == again.content_sha256()


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({}, []),
        ({"far": 0.3, "verdict": "widened"}, []),
        ({"far": 0.3}, ["1 silent: shaken, seed 1, smoother: roll_mrad 30 % beyond 4 sigma"]),
        ({"ratio": 1.6}, ["2 sigmas: shaken, smoother: roll_mrad 1.60, 95 %, trusted"]),
        ({"coverage": 0.8, "verdict": "widened"}, ["2 sigmas: shaken, smoother: roll_mrad 1.00, 80 %, widened"]),
        ({"case": "clean", "coverage": 1.0}, []),
        ({"ratio": 9.0, "coverage": 0.1, "far": 0.9, "verdict": "not_trusted"}, []),
        ({"converged": False}, ["1 not converged: shaken, seed 1, smoother: roll_mrad trusted"]),
        ({"converged": False, "verdict": "not_trusted"}, []),
        ({"quantity": "", "findings": "no rows"}, ["refused: shaken, seed 1, smoother: no rows"]),
        ({"estimator": "oracle", "far": 0.3, "ratio": 3.0}, []),
    ],
)
def test_what_misses_the_acceptance(tools: SimpleNamespace, changes: dict[str, object], missed: list[str]) -> None:
    assert list(tools.table.failures(pd.DataFrame([row(**changes)]))) == missed


@pytest.mark.parametrize(
    ("other", "allowed", "label"), [("oracle", 2.0, "3 oracle"), ("dead-reckoning", 1.05, "4 floor")]
)
def test_an_error_is_held_against_others(tools: SimpleNamespace, other: str, allowed: float, label: str) -> None:
    within = pd.DataFrame([row(rms=0.99 * allowed), row(estimator=other)])
    beyond = pd.DataFrame([row(rms=1.01 * allowed), row(estimator=other)])
    assert list(tools.table.failures(within)) == []
    assert [line.split(":")[0] for line in tools.table.failures(beyond)] == [label]


def test_seeds_are_pooled_in_the_table(tools: SimpleNamespace) -> None:
    rows = pd.DataFrame([row(rms=3.0, ratio=1.0), row(seed=2, rms=4.0, ratio=2.0, verdict="widened", coverage=0.85)])
    cells = tools.table.markdown(rows).splitlines()[-1]
    assert "| shaken | smoother |" in cells
    assert f"3.5 ({np.sqrt(2.5):.2f}, 90" in cells


@pytest.mark.parametrize(("coverage", "met"), [(0.89, False), (0.95, True), (0.99, False)])
def test_many_clean_runs_are_covered_as_they_should(tools: SimpleNamespace, coverage: float, met: bool) -> None:
    rows = pd.DataFrame([row(case="clean, odometry", seed=seed, coverage=coverage) for seed in range(20)])
    assert (list(tools.table.failures(rows)) == []) == met


def test_runs_that_are_not_to_be_believed_do_not_count_among_those_that_are(tools: SimpleNamespace) -> None:
    rows = pd.DataFrame([row(ratio=1.4), row(seed=2, ratio=9.0, coverage=0.0, verdict="not_trusted")])
    assert list(tools.table.failures(rows)) == []
    table = tools.table.summed_up(rows)
    assert table["ratio"].iloc[0] == pytest.approx(np.sqrt(0.5 * (1.4**2 + 81.0)))


def test_a_plan_is_fitted_by_turn_and_shift(tools: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    true = rng.standard_normal(50) + 1j * rng.standard_normal(50)
    fitted = tools.scores.rigidly_fitted(true * np.exp(0.7j) + 3.0 - 2.0j, true)
    assert fitted == pytest.approx(true - true.mean())


def test_an_estimate_is_scored_in_all_its_quantities(tools: SimpleNamespace) -> None:
    (case,) = tools.cases.cases(["imu-noise=10"])
    scores = tools.scores.measured(case.simulated(1, 90.0), None)
    scores = scores[scores["estimator"] == "smoother"].set_index("quantity")
    assert set(scores.index) == set(tools.scores.QUANTITIES)
    assert (scores["rms"] > 0.0).all()
    assert scores.loc["plan_m", "rms"] < 10.0
    assert np.isnan(scores.loc["plan_m", "ratio"])
