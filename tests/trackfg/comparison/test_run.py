"""Every estimator on the same runs, scored by one code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines.result import BaselineResult, filled, resampled_trajectory
from trackfg.comparison.estimators import SMOOTHER, Estimator, estimator, estimators, with_own
from trackfg.comparison.friction_case import friction_estimators
from trackfg.comparison.railway_case import run_railway_case
from trackfg.comparison.run import Case, cases_of, compare
from trackfg.comparison.table import SCORE_COLUMNS, TRUTH, Comparison
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError, UnsolvableError
from trackfg.recording.model import Recording
from trackfg.report import write_report
from trackfg.results.columns import EVENT_COLUMNS, GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS


@pytest.fixture(scope="module")
def two_seeds() -> Comparison:
    return compare(cases_of(scenarios=["trolley"], seeds=2, duration_s=90.0), peers=False)


def test_every_estimator_is_scored_by_what_it_is_for(two_seeds: Comparison) -> None:
    assert tuple(two_seeds.scores) == SCORE_COLUMNS
    scored = two_seeds.scores.groupby("estimator")["quantity"].unique()
    assert {"cross_level_mm", "roll_mrad", "twist_mm"} <= set(scored["complementary"])
    assert "distance_percent" not in scored["complementary"]
    assert "along_track_m" in scored["composite"]
    assert {"twist_mm", "versine_level_mm", "along_track_m", "pitch_mrad"} <= set(scored[SMOOTHER])
    out = {one.estimator: one.reason for one in two_seeds.about.left_out}
    assert "lasers" in out["mid-chord"]
    assert set(out) | set(scored.index) == set(estimators(peers=False))


def test_peers_are_scored_beside_them() -> None:
    beside = compare(cases_of(scenarios=["trolley"], seeds=1, duration_s=12.0))
    left_out = {one.estimator for one in beside.about.left_out}
    assert left_out | set(beside.scores["estimator"]) == set(estimators())


def test_what_the_smoother_is_for(two_seeds: Comparison) -> None:
    rows = {(row.quantity, row.estimator): row for row in two_seeds.about.rows if row.from_kmh is None}
    for quantity, other in (("cross_level_mm", "complementary"), ("twist_mm", "complementary"), ("twist_mm", "gyro")):
        ratio = rows[quantity, other].to_smoother
        assert ratio is not None
        assert ratio > 1.0
    assert rows["twist_mm", SMOOTHER].runs == 2


def test_curves_are_those_of_the_first_run(two_seeds: Comparison) -> None:
    geometry = two_seeds.geometry
    assert {TRUTH, SMOOTHER, "complementary"} <= set(geometry["estimator"])
    smoothed = geometry[geometry["estimator"] == SMOOTHER]
    row = two_seeds.scores.query("estimator == 'smoother' and quantity == 'twist_mm' and seed == 0").iloc[0]
    assert np.sqrt((smoothed["twist_mm_error"] ** 2).mean()) == pytest.approx(row["rms"])
    assert set(two_seeds.positions["estimator"]) >= {SMOOTHER, "composite"}


def test_processes_change_nothing_but_the_time(two_seeds: Comparison) -> None:
    calls: list[float] = []
    cases = cases_of(scenarios=["trolley"], seeds=2, duration_s=90.0)
    parallel = compare(cases, peers=False, jobs=2, progress=lambda what, done: calls.append(done))
    alone = two_seeds.scores[two_seeds.scores["estimator"].isin(parallel.scores["estimator"])]
    pd.testing.assert_frame_equal(
        parallel.scores.drop(columns="seconds"), alone.drop(columns="seconds").reset_index(drop=True), rtol=1e-9
    )
    assert calls == [0.5, 1.0]


def test_recordings_without_truth_are_held_against_the_first(tmp_path: Path) -> None:
    folders = []
    for run in range(2):
        folder = tmp_path / f"run{run}"
        simulated = simulate("shuttle", seed=0, run=2 * run, duration_s=80.0)
        simulated.write(folder)
        folders.append(without_truth(folder))
    result = compare(cases_of(folders), peers=False)
    assert result.about.cases[0].basis == "repeatability"

    def scores_of(name: str) -> pd.DataFrame:
        return result.scores[result.scores["estimator"] == name].set_index(["case", "quantity"])

    scores = scores_of(SMOOTHER)
    first, *others = (case.name for case in result.about.cases)
    assert first not in scores.index
    for name in others:
        twist = scores.loc[(name, "twist_mm")]
        assert twist["sd"] < 0.5 * scores_of("complementary").loc[(name, "twist_mm"), "sd"]
        assert np.isnan(twist["rms"])


def test_a_recording_with_its_truth(tmp_path: Path) -> None:
    simulate("trolley", seed=3, duration_s=60.0).write(tmp_path / "run")
    (case,) = cases_of([tmp_path / "run"])
    assert case == Case("trolley-seed3-run0", "recording", folder=tmp_path / "run")
    result = compare([case], peers=False)
    assert result.about.cases[0].basis == "truth"
    assert {row.case for row in result.about.rows} == {"trolley-seed3-run0"}


def without_truth(folder: Path) -> Path:
    """Take the truth out of a recording's description."""
    toml = folder / "recording.toml"
    text = toml.read_text()
    toml.write_text(text[: text.index("[truth]")])
    return folder


def test_a_short_recording_without_truth_has_nothing_to_be_compared_with(tmp_path: Path) -> None:
    simulate("trolley", seed=0, duration_s=60.0).write(tmp_path / "run")
    with pytest.raises(BadInputError, match=r"expected \[truth\], another recording of the track, or measurements"):
        cases_of([without_truth(tmp_path / "run")])


def test_one_recording_without_truth_is_judged_by_what_was_withheld(tmp_path: Path) -> None:
    simulate("mainline", seed=1, duration_s=80.0).write(tmp_path / "run")
    cases = cases_of([without_truth(tmp_path / "run")])
    name = "mainline-seed1-run0"
    assert [(case.name, case.kind, case.seed) for case in cases] == [
        (name, "alone", 0),
        *((f"{name}, tach", "withheld", part) for part in range(3)),
    ]
    result = compare(cases, peers=False)
    assert [case.basis for case in result.about.cases] == ["smoother", "withheld"]
    rows = {row.estimator: row for row in result.about.rows}
    assert {row.quantity for row in rows.values()} == {"withheld_way_m"}
    assert rows[SMOOTHER].error < 0.1
    assert rows["composite"].to_smoother is not None
    assert rows["composite"].to_smoother > 1.0
    differences = {(one.estimator, one.quantity): one for one in result.about.differences}
    assert 0.0 < differences["complementary", "twist_mm"].rms < 1.0
    assert ("complementary", "along_track_m") not in differences
    assert SMOOTHER not in {one.estimator for one in result.about.differences}
    assert Comparison.read(result.write(tmp_path / "cmp")).about == result.about
    page = write_report(tmp_path / "cmp", tmp_path / "page.html")
    assert "Where estimators differ from the smoother" in page.read_text()


def test_a_recording_on_springs_without_truth_has_differences_but_of_geometry(tmp_path: Path) -> None:
    simulate("mainline", seed=1, duration_s=80.0).write(tmp_path / "run")
    toml = without_truth(tmp_path / "run") / "recording.toml"
    toml.write_text(toml.read_text().replace("rigid = true", "rigid = false"))
    alone, *_ = cases_of([tmp_path / "run"])
    run = run_railway_case(alone, peers=False, keep=True, show=lambda *_: None, own={})
    assert run.geometry.empty
    assert {"roll_mrad", "speed_kmh"} <= {one.quantity for one in run.differences}


def at_rest(recording: Recording) -> BaselineResult:
    """It says that nothing moves, and of a run without a tachometer that it can say nothing."""
    if recording.tach is None:
        raise UnsolvableError("no wheel")
    t = recording.tach["t_s"].to_numpy()
    trajectory = resampled_trajectory(t, {"chainage_m": np.zeros_like(t), "speed_mps": np.zeros_like(t)})
    return BaselineResult("at-rest", trajectory, filled(GEOMETRY_COLUMNS, {}), filled(EVENT_COLUMNS, {}))


def test_an_estimator_of_ones_own_is_scored_like_the_others(tmp_path: Path) -> None:
    simulation = simulate("trolley", seed=0, duration_s=90.0)
    simulation.write(tmp_path / "run")
    own = {"at-rest": Estimator("nothing moves", "this test", at_rest, ("distance and position",))}
    cases = cases_of([str(tmp_path / "run")])
    comparison = compare(cases, own=own, peers=False)
    scores = comparison.scores.set_index(["estimator", "quantity"])["rms"]
    true_speed = 3.6 * simulation.truth["speed_mps"]
    assert scores["at-rest", "speed_kmh"] == pytest.approx(np.sqrt(np.mean(true_speed**2)), rel=0.01)
    assert scores["at-rest", "speed_kmh"] > 5.0 * scores["smoother", "speed_kmh"]
    assert comparison.about.estimators["at-rest"] == "nothing moves (this test)"
    with pytest.raises(BadInputError, match="'gyro': the name is taken"):
        compare(cases, own={"gyro": own["at-rest"]}, peers=False)


def in_place(recording: Recording) -> BaselineResult:
    """It takes its own zero off the tables that it is given."""
    assert recording.tach is not None
    recording.imu["wx_radps"] -= 1.0
    recording.tach.loc[:, "distance_m"] = 0.0
    recording.imu.loc[:, "fz_mps2"] = 0.0
    return at_rest(recording)


def test_an_estimator_of_ones_own_changes_no_table_of_the_others() -> None:
    recording = simulate("trolley", seed=0, duration_s=30.0).recording
    before = {name: table.copy() for name, table in recording.tables.items()}
    own = {"mine": Estimator("nothing moves", "this test", in_place, ("distance and position",))}
    with_own({}, own)["mine"].run(recording)
    assert before.keys() == recording.tables.keys()
    for name, table in recording.tables.items():
        pd.testing.assert_frame_equal(table, before[name])


def nothing(recording: Recording) -> None:
    """It forgets to return what it has estimated."""


def test_what_is_no_estimator_of_ones_own_is_said_so(tmp_path: Path) -> None:
    simulate("trolley", seed=0, duration_s=60.0).write(tmp_path / "run")
    cases = cases_of([tmp_path / "run"])
    named: dict[str, Any] = {
        "expected a trackfg.comparison.Estimator, not function": nothing,
        "tasks 'place'; expected a tuple of 'attitude": Estimator("", "", at_rest, ("place",)),  # type: ignore[arg-type]
        "tasks 'twist'; expected a tuple of 'attitude": Estimator("", "", at_rest, "twist"),  # type: ignore[arg-type]
        "BaselineResult, not NoneType": Estimator("", "", nothing, ("twist",)),  # type: ignore[arg-type]
    }
    for said, one in named.items():
        with pytest.raises((TypeError, BadInputError), match=f"estimator 'mine': .*{said}"):
            compare(cases, own={"mine": one}, peers=False)
    with pytest.raises(TypeError, match=r"expected \['run1'\]"):
        cases_of("run1")


def _of_own(trajectory: pd.DataFrame, geometry: pd.DataFrame | None = None) -> Estimator:
    empty = filled(GEOMETRY_COLUMNS, {})
    result = BaselineResult("mine", trajectory, empty if geometry is None else geometry, filled(EVENT_COLUMNS, {}))
    return Estimator("mine", "this test", lambda recording: result, ("distance and position", "twist"))


def test_tables_that_cannot_be_scored_are_left_out_with_the_reason(tmp_path: Path) -> None:
    simulate("trolley", seed=0, duration_s=60.0).write(tmp_path / "run")
    t, still = np.arange(0.0, 60.0, 0.1), np.zeros(600)
    place = filled(GEOMETRY_COLUMNS, {"chainage_m": np.arange(40) / 4.0, "twist_mm": np.zeros(40)})
    named = {
        "expected when it was where: chainage_m in its trajectory": _of_own(filled(TRAJECTORY_COLUMNS, {}), place),
        "expected a value in its tables": _of_own(filled(TRAJECTORY_COLUMNS, {"t_s": t})),
        "row 601: expected times that grow": _of_own(
            filled(TRAJECTORY_COLUMNS, {"t_s": np.tile(t, 2), "chainage_m": np.tile(still, 2)})
        ),
        "is from 0 to 59900 s; expected seconds": _of_own(
            filled(TRAJECTORY_COLUMNS, {"t_s": 1000.0 * t, "chainage_m": still})
        ),
    }
    own = {str(number): estimator for number, estimator in enumerate(named.values())}

    comparison = compare(cases_of([tmp_path / "run"]), own=own, peers=False)

    left_out = {one.estimator: one.reason for one in comparison.about.left_out}
    for number, reason in enumerate(named):
        assert reason in left_out[str(number)]


def test_a_trajectory_is_resampled_from_columns_over_growing_times() -> None:
    t = np.array([0.0, 1.0, 0.5])
    with pytest.raises(ValueError, match="t, row 3: expected times that grow"):
        resampled_trajectory(t, {"chainage_m": t})
    with pytest.raises(ValueError, match="chainage_m: 1 values at 2 times"):
        resampled_trajectory(t[:2], {"chainage_m": t[:1]})


def test_an_estimator_of_ones_own_predicts_what_is_withheld(tmp_path: Path) -> None:
    simulate("slippery-line", seed=1, duration_s=150.0).write(tmp_path / "run")
    without_truth(tmp_path / "run")
    cases = [case for case in cases_of([tmp_path / "run"]) if case.kind == "withheld"][:1]
    own = {"at-rest": Estimator("nothing moves", "this test", at_rest, ("distance and position",))}
    assert {"at-rest", "smoother"} <= set(compare(cases, own=own, peers=False).scores["estimator"])


def test_unknown_names_and_ids_given_twice(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="mainlin"):
        cases_of(scenarios=["mainlin"])
    simulate("trolley", seed=0, duration_s=30.0).write(tmp_path / "run")
    with pytest.raises(BadInputError, match="two recordings have the id 'trolley-seed0-run0'"):
        cases_of([tmp_path / "run", tmp_path / "run"])
    with pytest.raises(
        BadInputError, match="no estimator 'gyr'; expected one of smoother, dead-reckoning, complementary"
    ):
        estimator("gyr")
    with pytest.raises(BadInputError, match="mid-chord: its paper prints nothing that differs"):
        estimator("mid-chord", as_printed=True)


def test_the_standard_cases_are_all_there_is_to_estimate() -> None:
    assert {case.name for case in cases_of(seeds=1)} >= {"trolley", "measuring-car", "slippery-line", "j-turn"}


def test_friction() -> None:
    result = compare(cases_of(scenarios=["j-turn"], seeds=2))
    rows = {(row.quantity, row.estimator): row for row in result.about.rows}
    assert {name for _, name in rows} == set(friction_estimators())
    assert rows["friction", SMOOTHER].error < rows["friction", "imm-10"].error
    assert rows["slip_angle_mrad", SMOOTHER].coverage is not None
