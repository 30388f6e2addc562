"""Maps of more runs than are joined one after another: in blocks, added up, by anyone."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from trackfg.errors import BadInputError
from trackfg.mapping.joining import build
from trackfg.mapping.joining.anchors import (
    Sensor,
    Sightings,
    information_on_anchors,
    offset_variable,
    roll_variable,
    with_roll_prior,
)
from trackfg.mapping.joining.build import Joining, build_map, with_runs
from trackfg.mapping.joining.joint_solution import joint_solution, pooled
from trackfg.mapping.joining.merging import MERGED
from trackfg.mapping.joining.survey import reopened
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.result import Result

Ride = Callable[..., Any]


def repeated(result: Result, number: int) -> Result:
    """The same run once more, with other noise of its own size."""
    rng, geometry = np.random.default_rng(number), result.geometry.copy()
    for name in MERGED:
        noise = gaussian_filter1d(rng.standard_normal(len(geometry)), 8.0)
        share = 0.05 if name == "cross_level_mm" else 1.0
        geometry[name] += share * geometry[f"{name}_sd"] * noise / noise.std()
    assert result.summary.run is not None
    facts = result.summary.run.model_copy(update={"content_sha256": f"{number:064x}"})
    summary = result.summary.model_copy(update={"recording_id": f"run{number}", "run": facts})
    return replace(result, geometry=geometry, summary=summary)


@pytest.fixture(scope="module", autouse=True)
def small_blocks() -> Iterator[None]:
    """Join four runs one after another, then blocks of three."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "_ONE_BY_ONE", 4)
        patch.setattr(build, "BLOCK", 3)
        yield


@pytest.fixture(scope="module")
def many(ride: Ride) -> list[Result]:
    return [repeated(ride(number % 2).result, number) for number in range(12)]


@pytest.fixture(scope="module")
def of_many(many: list[Result]) -> FeatureMap:
    return build_map(many[:-1], name="short line")


def same_bits(a: FeatureMap, b: FeatureMap) -> bool:
    tables = ((getattr(a, name), getattr(b, name)) for name in ("grid", "landmarks", "line", "runs"))
    return all(one.equals(other) for one, other in tables) and np.array_equal(a.covariance, b.covariance)


def test_whoever_computes_the_blocks_the_map_is_the_same(many: list[Result], of_many: FeatureMap) -> None:
    def elsewhere(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        sent = [pickle.dumps((function, item)) for item in items]
        back = {}
        for number in reversed(range(len(sent))):
            called, item = pickle.loads(sent[number])
            back[number] = pickle.dumps(called(item))
        return (pickle.loads(back[number]) for number in range(len(sent)))

    assert same_bits(build_map(many[:-1], name="short line", joining=Joining(mapped=elsewhere)), of_many)


def test_blocks_know_what_runs_one_after_another_do(
    many: list[Result], of_many: FeatureMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "_ONE_BY_ONE", len(many))
    in_turn = build_map(many[:-1], name="short line")
    assert set(of_many.runs["run_id"]) == set(in_turn.runs["run_id"])
    both = of_many.landmarks.merge(in_turn.landmarks, on="landmark_id", suffixes=("", "_in_turn"))
    assert len(both) == len(in_turn.landmarks)
    assert (np.abs(both["chainage_m"] - both["chainage_m_in_turn"]) < 0.2 * both["chainage_m_sd"]).all()
    np.testing.assert_allclose(both["chainage_m_sd"], both["chainage_m_sd_in_turn"], rtol=0.05)
    grids = of_many.grid.merge(in_turn.grid, on="chainage_m", suffixes=("", "_in_turn"))
    assert len(grids) > 0.99 * len(in_turn.grid)
    for name in MERGED:
        apart = np.abs(grids[name] - grids[f"{name}_in_turn"]) / grids[f"{name}_sd"]
        assert apart.quantile(0.99) < 1.0


def test_what_a_map_keeps_to_add_a_run_does_not_grow(many: list[Result], of_many: FeatureMap) -> None:
    few = build_map(many[:7], name="short line")
    kept = [reopened(feature_map).pooled for feature_map in (few, of_many, with_runs(of_many, many[-1:]))]
    assert kept[0].variables == kept[1].variables == kept[2].variables
    assert {rows.R.shape for rows in kept} == {(len(kept[0].variables),) * 2}


def test_what_all_runs_say_is_kept_and_is_what_their_rows_say_one_by_one(of_many: FeatureMap) -> None:
    kept, again = (reopened(made).pooled for made in (of_many, replace(of_many, pooled=None)))
    order = [again.variables.index(name) for name in kept.variables]
    np.testing.assert_allclose(kept.R.T @ kept.R, (again.R.T @ again.R)[np.ix_(order, order)], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(kept.R.T @ kept.d, (again.R.T @ again.d)[order], rtol=1e-6, atol=1e-6)


def test_runs_that_cannot_be_joined_are_left_out(many: list[Result], ride: Ride) -> None:
    elsewhere = ride(0, seed=4).result
    left_out: dict[str, str] = {}
    joining = Joining(leave_out=lambda run, error: left_out.setdefault(run, str(error)))
    built = build_map([many[0], elsewhere, many[1], many[0]], name="short line", joining=joining)
    assert list(built.runs["run_id"]) == ["run0", "run1"]
    assert "not recognised" in left_out[elsewhere.summary.recording_id]
    assert "in the map already" in left_out["run0"]
    with pytest.raises(BadInputError, match="not recognised"):
        build_map([many[0], elsewhere, many[1]], name="short line")


def test_runs_pooled_say_what_all_their_rows_do() -> None:
    rng, places = np.random.default_rng(5), np.arange(0.0, 1001.0, 250.0)
    errors = PlaceCovariance.of(places, np.diag(np.r_[np.full(5, 0.1**2), np.full(5, 0.05**2)]))
    rows = {}
    for number in range(6):
        run, anchored = f"run{number}", number != 2
        seen = Sightings(tuple("abcde"), places + rng.normal(0.0, 0.1, 5), np.full(5, 0.01), rng.normal(0.0, 1.0, 5))
        sensor = Sensor(run if number > 3 else "shared", 1.067 * (-1) ** number)
        information = information_on_anchors(run, seen, errors, sensor, anchored=anchored)
        new = number in (0, 4, 5)
        rows[run] = with_roll_prior(information, sensor.name, 1e-3) if new else information
    whole = joint_solution(rows.values())
    together = rows["run0"]
    for run in list(rows)[1:]:
        together = pooled(together, rows[run], {roll_variable(run), offset_variable(run)})
    some = joint_solution([together])
    assert len(some.names) == 11
    which = whole.rows(some.names)
    np.testing.assert_allclose(some.x, whole.x[which], atol=1e-9)
    np.testing.assert_allclose(some.covariance, whole.covariance[np.ix_(which, which)], rtol=1e-6, atol=1e-12)
