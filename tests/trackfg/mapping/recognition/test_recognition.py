"""Runs over a made-up line, found again on it; and what must not be found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError, TrackfgError
from trackfg.mapping.recognition.recognition import COLUMNS, SURE, Recognition, recognise
from trackfg.numerics.arrays import Array

Line = Any
"""The made-up one of conftest.py."""
Draw = Callable[..., Line]


def sigma(run: pd.DataFrame, sd_m: float) -> Array:
    return np.full(len(run), sd_m)


def errors(found: Recognition, place: object = None) -> Array:
    """Of every section, m; ``place`` of the run's chainage, the same if there is none."""
    run_m = found.sections["run_m"].to_numpy()
    true = place(run_m) if callable(place) else run_m
    return np.asarray(found.sections["reference_m"] - true)


@pytest.mark.parametrize(("shift_m", "scale"), [(1.37, 0.0), (-4.2, 3e-3)])
def test_without_noise_the_place_is_exact(line: Line, shift_m: float, scale: float) -> None:
    def place(chainage: Array) -> Array:
        return chainage + shift_m + scale * (chainage - 2000.0)

    run = line.run(500.0, 3500.0, place=place, noise=0.0)
    found = recognise(
        run, line.run(0.0, 6000.0, noise=0.0), place_sd_m=sigma(run, 5.0), rate_sd=max(scale, 1e-5), direction=1
    )
    assert tuple(found.sections.columns) == COLUMNS
    assert found.sections["used"].all()
    assert np.abs(errors(found, place)).max() < 1e-3


def test_sigmas_of_matches_and_of_the_roll_offset_hold(line: Line, reference: pd.DataFrame) -> None:
    z, bias_z = [], []
    for seed in range(4):
        run = line.run(300.0, 5700.0, seed=seed, roll_mm=2.5)
        found = recognise(run, reference, place_sd_m=sigma(run, 1.0), rate_sd=1e-5, direction=1)
        assert found.sections["used"].all()
        z.append(errors(found) / found.sections["match_sd_m"])
        bias_z.append((found.sections["cross_level_bias_mm"] - 2.5) / found.sections["cross_level_bias_mm_sd"])
    for score in (np.concatenate(z), np.concatenate(bias_z)):
        assert 0.65 < np.sqrt(np.mean(score**2)) < 1.3
        assert np.mean(np.abs(score) < 2.0) > 0.92


@pytest.mark.parametrize("direction", [1, -1])
def test_a_run_started_anywhere_finds_itself(line: Line, reference: pd.DataFrame, direction: int) -> None:
    def place(chainage: Array) -> Array:
        return 1.004 * (chainage - 9000.0) + 1234.5

    run = line.run(9000.0, 12000.0, place=place, seed=3)
    found = recognise(run, reference, place_sd_m=None, rate_sd=0.01, direction=direction)
    assert found.probability > SURE
    assert found.found_after_m <= 300.0
    assert found.sections["used"].all()
    assert np.abs(errors(found, place)).max() < 0.05
    # At the start of travel nothing was known yet, whichever end that is.
    so_far = found.sections["probability_so_far"].to_numpy()[::direction]
    assert so_far[0] < SURE
    assert np.all(so_far[3:] > SURE)


@pytest.mark.parametrize("feature", ["curvature_1pm", "cross_level_mm", "versine_level_mm"])
def test_one_feature_without_sigmas_is_enough(line: Line, reference: pd.DataFrame, feature: str) -> None:
    run = line.run(2000.0, 4000.0, seed=3)[["chainage_m", feature]]
    found = recognise(run, reference, place_sd_m=None, rate_sd=1e-3, direction=1)
    assert found.sections["used"].all()
    assert np.abs(errors(found)).max() < 0.15
    assert found.sections["cross_level_bias_mm"].notna().all() == (feature == "cross_level_mm")


def test_a_run_on_another_line_is_not_recognised(draw_line: Draw, reference: pd.DataFrame) -> None:
    run = draw_line(6000.0, seed=2).run(0.0, 6000.0)
    for place_sd_m in (None, sigma(run, 2.0)):
        found = recognise(run, reference, place_sd_m=place_sd_m, rate_sd=1e-3, direction=1)
        assert found.probability < 0.1
        assert not found.sections["used"].any()
        assert np.isnan(found.found_after_m)


def test_changed_track_does_not_veto_the_place(draw_line: Draw, reference: pd.DataFrame) -> None:
    run = draw_line(6000.0, seed=1, changed=(2000.0, 2450.0)).run(500.0, 5000.0)
    for place_sd_m, rate_sd in ((sigma(run, 3.0), 1e-5), (None, 0.01)):
        found = recognise(run, reference, place_sd_m=place_sd_m, rate_sd=rate_sd, direction=1)
        run_m = found.sections["run_m"]
        away = (run_m < 1950.0) | (run_m > 2500.0)
        assert found.sections["used"][away].all()
        assert np.abs(errors(found)[away]).max() < 0.1
        # On the changed stretch the place is known from both sides, but nothing claims to be a sharp match.
        assert np.abs(errors(found)).max() < 3.0
        assert not (found.sections["match_sd_m"][run_m.between(2050.0, 2400.0)] < 0.1).any()


def test_a_line_tamped_everywhere_is_found_by_its_curves(draw_line: Draw, reference: pd.DataFrame) -> None:
    tamped = draw_line(6000.0, seed=1, changed=(0.0, 6000.0))
    run = tamped.run(500.0, 5000.0, place=lambda x: 1.003 * (x - 500.0) + 500.0)
    found = recognise(run, reference, place_sd_m=None, rate_sd=0.01, direction=1)
    assert found.probability > SURE
    assert found.found_after_m <= 2500.0
    used = found.sections["used"].to_numpy()
    assert used.sum() >= 5
    z = errors(found, lambda x: 1.003 * (x - 500.0) + 500.0)[used] / found.sections["match_sd_m"][used]
    assert np.sqrt(np.mean(z**2)) < 2.0


def test_equal_curves_stay_ambiguous(draw_line: Draw) -> None:
    """Two places with the same curve, and the track changed since: either, or neither."""
    curves = [(1000.0, 1400.0, 2e-3), (4000.0, 4400.0, 2e-3)]
    run = draw_line(6000.0, seed=3, curves=curves, changed=(0.0, 6000.0)).run(700.0, 1700.0)
    reference = draw_line(6000.0, seed=3, curves=curves).run(0.0, 6000.0, seed=1)
    found = recognise(run, reference, place_sd_m=None, rate_sd=0.01, direction=1)
    assert found.probability < 0.6
    assert not found.sections["used"].any()


@pytest.mark.parametrize("place_sd_m", [None, 30.0])
def test_a_straight_without_features_says_nothing(draw_line: Draw, place_sd_m: float | None) -> None:
    smooth = draw_line(4000.0, seed=3, curves=[], rough=0.0)
    run = smooth.run(1000.0, 3000.0, seed=2)
    prior = None if place_sd_m is None else sigma(run, place_sd_m)
    found = recognise(run, smooth.run(0.0, 4000.0, seed=1), place_sd_m=prior, rate_sd=1e-3, direction=1)
    assert not found.sections["used"].any()
    assert found.probability < 0.95


def test_a_run_over_the_end_of_the_reference(line: Line) -> None:
    for low, high in ((0.0, 3000.0), (3000.0, 6000.0)):
        reference = line.run(low, high, seed=100)
        run = line.run(1500.0, 4500.0, seed=4)
        found = recognise(run, reference, place_sd_m=None, rate_sd=0.01, direction=1)
        inside = found.sections["run_m"].between(low + 50.0, high - 50.0)
        assert found.sections["used"][inside].all()
        assert np.abs(errors(found)[inside]).max() < 0.1
        assert not found.sections["used"][~inside].any()


def test_a_slip_that_nobody_saw(line: Line, reference: pd.DataFrame) -> None:
    def place(chainage: Array) -> Array:
        return np.where(chainage < 2500.0, chainage, chainage + 12.0)

    run = line.run(500.0, 5000.0, place=place, seed=4)
    found = recognise(run, reference, place_sd_m=sigma(run, 5.0), rate_sd=1e-5, direction=1)
    assert found.sections["used"].all()
    assert np.abs(errors(found, place)).max() < 0.1


def test_rows_and_values_may_be_missing(line: Line, reference: pd.DataFrame) -> None:
    run = line.run(500.0, 5000.0, seed=4)
    run.loc[3000:3600, "curvature_1pm"] = np.nan
    run = run.drop(index=range(6000, 6800))
    holed = reference.drop(index=range(12000, 12400))
    found = recognise(run, holed, place_sd_m=sigma(run, 5.0), rate_sd=1e-4, direction=1)
    assert found.sections["used"].sum() >= len(found.sections) - 4
    assert np.abs(errors(found)[found.sections["used"]]).max() < 0.1


def test_a_run_too_short_has_no_sections(line: Line, reference: pd.DataFrame) -> None:
    found = recognise(line.run(510.0, 540.0), reference, place_sd_m=None, rate_sd=0.01, direction=1)
    assert found.sections.empty
    assert tuple(found.sections.columns) == COLUMNS
    assert found.probability == 0.0
    assert np.isnan(found.found_after_m)


def test_a_reference_shorter_than_a_section_recognises_nothing(line: Line) -> None:
    found = recognise(line.run(0.0, 1000.0), line.run(510.0, 540.0), place_sd_m=None, rate_sd=0.01, direction=1)
    assert not found.sections["used"].any()


def test_bad_input_is_named(line: Line, reference: pd.DataFrame) -> None:
    run = line.run(0.0, 500.0)
    good = {"place_sd_m": sigma(run, 1.0), "rate_sd": 0.01, "direction": 1}
    with pytest.raises(BadInputError, match="no feature in common"):
        recognise(run[["chainage_m", "curvature_1pm"]], reference.drop(columns="curvature_1pm"), **good)
    with pytest.raises(BadInputError, match=r"run: chainage_m: expected whole multiples"):
        recognise(run.assign(chainage_m=run["chainage_m"] + 0.1), reference, **good)
    with pytest.raises(BadInputError, match=r"reference: chainage_m: expected ascending"):
        recognise(run, reference.iloc[::-1], **good)
    with pytest.raises(BadInputError, match="no column chainage_m"):
        recognise(run, reference.drop(columns="chainage_m"), **good)
    with pytest.raises(BadInputError, match="one for each row"):
        recognise(run, reference, **{**good, "place_sd_m": np.ones(3)})
    for name, value in (("rate_sd", -1.0), ("direction", 0), ("section_m", 55.0)):
        with pytest.raises(TrackfgError, match=f"{name} is"):
            recognise(run, reference, **{**good, name: value})


def test_tables_on_two_grids_are_named(line: Line, reference: pd.DataFrame) -> None:
    run = line.run(1000.0, 2000.0)
    for tables, what in (((run.iloc[::2], reference), "run"), ((run, reference.iloc[::4]), "reference")):
        with pytest.raises(BadInputError, match=rf"{what}: chainage_m: rows are .* m apart; expected 0.25 m"):
            recognise(*tables, place_sd_m=None, rate_sd=0.01, direction=1)
    nowhere = [table.drop(columns="chainage_m") for table in (run, reference)]
    with pytest.raises(BadInputError, match="run: no column chainage_m"):
        recognise(*nowhere, place_sd_m=None, rate_sd=0.01, direction=1)


def test_places_that_do_not_ascend_give_no_function() -> None:
    def recognised(reference_m: list[float]) -> Recognition:
        table = pd.DataFrame({"run_m": [50.0, 150.0], "reference_m": reference_m, "used": True})
        return Recognition(table, 1.0, 100.0)

    assert recognised([51.0, 151.0]).warp is not None
    assert recognised([151.0, 51.0]).warp is None


@pytest.mark.parametrize(("rows", "step_m"), [(2, 0.5), (4, 1.0)])
def test_a_coarser_grid_will_do(line: Line, reference: pd.DataFrame, rows: int, step_m: float) -> None:
    run = line.run(1000.0, 3000.0, seed=2)
    coarse = [table.assign(chainage_m=table["chainage_m"] - 1.0).iloc[::rows] for table in (run, reference)]
    assert coarse[0]["chainage_m"].diff().max() == step_m
    found = recognise(*coarse, place_sd_m=sigma(coarse[0], 5.0), rate_sd=1e-4, direction=1)
    assert found.sections["used"].mean() > 0.9
    assert np.abs(errors(found)[found.sections["used"]]).max() < 0.1


def test_a_grid_that_no_cell_of_a_metre_fits_is_named(line: Line, reference: pd.DataFrame) -> None:
    run = line.run(0.0, 500.0)
    run, reference = (table.assign(chainage_m=1.2 * table["chainage_m"]) for table in (run, reference))
    with pytest.raises(BadInputError, match=r"rows are 0.3 m apart; expected a whole part of 1 m"):
        recognise(run, reference, place_sd_m=None, rate_sd=0.01, direction=1)
