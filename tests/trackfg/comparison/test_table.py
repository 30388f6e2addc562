"""The rows of a comparison, and its folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.comparison.table import FILES, SCORE_COLUMNS, About, ComparedCase, Comparison, rows_of
from trackfg.errors import BadInputError


def score(estimator: str, seed: int, error: float, **other: float | str) -> dict[str, float | str]:
    row: dict[str, float | str] = dict.fromkeys(SCORE_COLUMNS, np.nan)
    row |= {"case": "mainline", "estimator": estimator, "seed": seed, "quantity": "twist_mm", "places": 100}
    row |= {"rms": error, "sd": 0.5 * error, "max": 3.0 * error, "seconds": 2.0, "distance_km": 4.0}
    return row | other


def test_rows_rank_and_pair_by_seed() -> None:
    scores = [score("smoother", k, e) for k, e in enumerate((0.1, 0.2, 0.4))]
    scores += [score("gyro", k, 2.0 * e) for k, e in enumerate((0.1, 0.2, 0.4))]
    scores += [score("complementary", 1, 0.1)]
    best, middle, worst = rows_of(pd.DataFrame(scores))
    assert [row.estimator for row in (best, middle, worst)] == ["complementary", "smoother", "gyro"]
    assert worst.to_smoother == pytest.approx(2.0)
    assert worst.to_smoother_interval == pytest.approx((2.0, 2.0))  # paired: the seeds' own difficulty is gone
    assert middle.error_margin is not None
    assert middle.to_smoother is None
    assert best.to_smoother == pytest.approx(0.5)  # in the one run that both have
    assert best.to_smoother_interval is None
    assert [row.beats_the_smoother for row in (best, middle, worst)] == [True, False, False]
    assert worst.largest == pytest.approx(2.4)
    assert worst.coverage is None
    assert worst.seconds_per_km == pytest.approx(0.5)


def test_one_offset_per_run_does_not_count_in_a_cross_level() -> None:
    (row,) = rows_of(pd.DataFrame([score("smoother", 0, 3.0, quantity="cross_level_mm")]))
    assert (row.statistic, row.error) == ("sd", 1.5)


def test_bands_are_rows_of_their_own_and_empty_ones_are_none() -> None:
    scores = [score("smoother", 0, 1.0), score("smoother", 0, 2.0, from_kmh=5.0), score("gyro", 0, np.nan, places=0)]
    assert [row.from_kmh for row in rows_of(pd.DataFrame(scores))] == [5.0, None]


@pytest.fixture
def comparison() -> Comparison:
    scores = pd.DataFrame([score("smoother", 0, 1.0), score("gyro", 0, 2.0)])
    about = About(
        seconds=1.5,
        cases=(ComparedCase(name="mainline", duration_s=60.0, distance_km=4.0),),
        estimators={"smoother": "it"},
        left_out=(),
        rows=rows_of(scores),
    )
    curves = pd.DataFrame({"case": "mainline", "estimator": "smoother", "chainage_m": [0.0, 0.25]})
    return Comparison(about, scores, curves, curves.rename(columns={"chainage_m": "t_s"}))


def test_a_folder_comes_back_as_it_was(comparison: Comparison, tmp_path: Path) -> None:
    folder = comparison.write(tmp_path / "out")
    comparison.write(folder)  # an earlier one is replaced
    again = Comparison.read(folder)
    assert again.about == comparison.about
    pd.testing.assert_frame_equal(again.scores, comparison.scores)
    pd.testing.assert_frame_equal(again.geometry, comparison.geometry)
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)


def test_other_folders_are_left_alone(comparison: Comparison, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(BadInputError, match="not a trackfg comparison"):
        comparison.write(tmp_path)
    with pytest.raises(BadInputError, match=r"comparison\.json is missing; expected a trackfg comparison"):
        Comparison.read(tmp_path)
    folder = comparison.write(tmp_path / "out")
    about = json.loads((folder / "comparison.json").read_text())
    for damaged, message in (
        ({"rows": [{**about["rows"][0], "quantity": "1"}]}, "expected one of cross_level_mm, "),
        ({"seconds": float("nan")}, "a finite number"),
    ):
        (folder / "comparison.json").write_text(json.dumps({**about, **damaged}))
        with pytest.raises(BadInputError, match=message):
            Comparison.read(folder)
    (folder / "comparison.json").write_text('{"format": "trackfg-comparison/1"}')
    with pytest.raises(BadInputError, match="not a readable trackfg comparison"):
        Comparison.read(folder)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda table: table.drop(columns="chainage_m"), r"geometry\.parquet: has no column 'chainage_m'"),
        (lambda table: table.assign(chainage_m=[0.0, np.nan]), "'chainage_m' is empty in some rows"),
        (lambda table: table.assign(chainage_m=["0", "x"]), "'chainage_m' is str|object: expected numbers"),
        (lambda table: table.assign(twist_mm=1.0), "has no column 'twist_mm_sd'"),
        (lambda table: table.assign(twist_mm=1.0, twist_mm_sd=np.inf), "'twist_mm_sd' holds an infinite number"),
    ],
)
def test_curves_that_cannot_be_drawn_are_refused(
    damage: Callable[[pd.DataFrame], pd.DataFrame], message: str, comparison: Comparison, tmp_path: Path
) -> None:
    folder = comparison.write(tmp_path / "out")
    damage(comparison.geometry).to_parquet(folder / "geometry.parquet")
    with pytest.raises(BadInputError, match=message):
        Comparison.read(folder)
