"""A run against a map: made-up tracks with noise as stated, and the simulator's."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import make_interp_spline

import trackfg
from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.geometry.curvature import curvature
from trackfg.geometry.gradient import gradient
from trackfg.geometry.twist import twist
from trackfg.geometry.versines import versine
from trackfg.mapping.changes.change_noise import ChangeNoise
from trackfg.mapping.changes.changes import CHANGE_COLUMNS, Changes, changes
from trackfg.mapping.changes.overlay import QUANTITIES, overlay
from trackfg.mapping.changes.residual_shift import ALIGNED_BY, residual_shift
from trackfg.numerics.arrays import Array
from trackfg.results.summary import GeometryConventions

STEP = 0.25
CONVENTIONS = GeometryConventions(
    gauge_m=1.067,
    cross_level_base_m=1.067,
    step_m=STEP,
    twist_base_m=5.0,
    chord_m=10.0,
    band_m=(3.0, 25.0),
    curvature_base_m=10.0,
    gradient_base_m=25.0,
)
NOISE = {
    "curvature_1pm": 3e-6,
    "gradient_permille": 0.01,
    "cross_level_mm": 0.02,
    "versine_level_mm": 0.06,
    "versine_alignment_mm": 0.06,
}
OFFSET = {"gradient_permille": 0.4, "cross_level_mm": 1.6}
"""Sigma of what a run errs by all along, which is part of its stated sigma."""
CELLS = 16_001


def waves(rng: np.random.Generator, n: int, length_m: float) -> Array:
    """A smooth random profile of unit variance: white noise through a Gaussian filter."""
    white = np.fft.rfft(rng.standard_normal(n))
    values = np.fft.irfft(white * np.exp(-0.5 * (2.0 * np.pi * np.fft.rfftfreq(n, STEP) * length_m) ** 2), n)
    return np.asarray(values / values.std())


def shape_of(seed: int, defects: tuple[Defect, ...] = ()) -> dict[str, Array]:
    """Height, lateral position and cross-level, m, at every cell, with defects."""
    rng = np.random.default_rng(seed)
    x = np.arange(CELLS) * STEP
    shape = {name: 1e-3 * waves(rng, CELLS, 1.5) for name in ("height", "lateral", "cross_level")}
    for defect in defects:
        level, alignment, cross_level, _ = defect.deviations(x).T
        shape["height"] += level
        shape["lateral"] += alignment
        shape["cross_level"] += cross_level
    return shape


def true_geometry(shape: dict[str, Array]) -> pd.DataFrame:
    columns = {
        "chainage_m": np.arange(CELLS) * STEP,
        "curvature_1pm": curvature(np.gradient(shape["lateral"], STEP), STEP, 10.0),
        "gradient_permille": 1e3 * gradient(shape["height"], STEP, 25.0),
        "cross_level_mm": 1e3 * shape["cross_level"],
        "versine_level_mm": 1e3 * versine(shape["height"], STEP),
        "versine_alignment_mm": 1e3 * versine(shape["lateral"], STEP),
    }
    return pd.DataFrame(columns)


def seen(shape: dict[str, Array], seed: int, *, times: float = 1.0, shift: Array | float = 0.0) -> pd.DataFrame:
    """A run over it, as a result's geometry: noise ``times`` as stated, its chainage ``shift`` ahead of the true."""
    rng = np.random.default_rng(seed)
    truth = true_geometry(shape)
    x = truth["chainage_m"].to_numpy()
    run = pd.DataFrame({"chainage_m": x, "chainage_m_sd": 0.3, "speed_mps": 20.0 + 10.0 * np.sin(x / 700.0)})
    for name, sd in NOISE.items():
        known = truth[name].notna()
        moved = make_interp_spline(x[known], truth[name][known], k=3)(np.clip(x - shift, x[known][0], x[known][-1]))
        slow = OFFSET.get(name, 0.0) * (rng.normal() + 0.05 * waves(rng, CELLS, 400.0))
        run[name] = np.where(known, moved + times * sd * waves(rng, CELLS, 1.5) + slow, np.nan)
        run[f"{name}_sd"] = np.where(known, np.hypot(sd, OFFSET.get(name, 0.0)), np.nan)
    run["twist_mm"] = twist(run["cross_level_mm"], STEP)
    run["twist_mm_sd"] = np.where(run["twist_mm"].notna(), 2**0.5 * NOISE["cross_level_mm"], np.nan)
    return run


def grid_of(run: pd.DataFrame, observations: int = 1) -> pd.DataFrame:
    names = [name for quantity in NOISE for name in (quantity, f"{quantity}_sd")]
    return run[["chainage_m", "chainage_m_sd", *names]].assign(observations=observations)


def same(chainage: Array) -> Array:
    return chainage


def compared(run: pd.DataFrame, grid: pd.DataFrame, *, shift_sd: float = 0.05, **options: float) -> Changes:
    sd = np.full(len(run), shift_sd)
    return changes(run, grid, conventions=CONVENTIONS, to_map=same, shift_sd_m=sd, **options)


@pytest.fixture(scope="module")
def grid() -> pd.DataFrame:
    return grid_of(seen(shape_of(0), 100))


def test_nothing_has_changed(grid: pd.DataFrame) -> None:
    """With the run's offset and wander, and a shift that changes along the line."""
    shift = 0.1 * waves(np.random.default_rng(5), CELLS, 300.0)
    found = compared(seen(shape_of(0), 101, shift=shift), grid, shift_sd=0.1)
    assert found.table.empty
    assert tuple(found.table.columns) == CHANGE_COLUMNS
    error = found.cells["shift_m"] - shift
    assert error.std() < 0.02
    assert found.thresholds["sigmas"].between(5.0, 10.0).all()
    alike = found.thresholds.set_index("quantity").loc[["twist_mm", "versine_level_mm", "curvature_1pm"]]
    assert alike["noise_factor"].between(1.0, 1.1).all()


def test_a_wander_goes_on_to_the_ends(grid: pd.DataFrame) -> None:
    run = seen(shape_of(0), 101)
    run["gradient_permille"] += 0.5 * np.exp(-run["chainage_m"] / 100.0)
    assert compared(run, grid).table.empty


def test_fewer_runs_at_an_end_of_the_map_have_another_offset(grid: pd.DataFrame) -> None:
    """One of four runs begins 60 m before the others: where these begin, the gradient of the mean has a step."""
    run, alone = seen(shape_of(0), 101), grid["chainage_m"] < 60.0
    off = grid["gradient_permille"] + 0.5 * alone
    sd = np.where(alone, 1.0, 0.5) * grid["gradient_permille_sd"]
    of_four = grid.assign(gradient_permille=off, gradient_permille_sd=sd, observations=np.where(alone, 1, 4))
    assert compared(run, of_four).table.empty
    assert len(compared(run, of_four.assign(observations=4)).table) == 1


def test_one_of_two_runs_of_the_map_ends_before_the_other(grid: pd.DataFrame) -> None:
    """The mean of the gradient has the offset of both up to there, of one beyond: this step is no change."""
    run, alone = seen(shape_of(0), 101), grid["chainage_m"] > 2000.0
    off = grid["gradient_permille"] + 0.5 * alone
    sd = np.where(alone, 1.0, 0.5**0.5) * grid["gradient_permille_sd"]
    of_two = grid.assign(gradient_permille=off, gradient_permille_sd=sd, observations=np.where(alone, 1, 2))
    assert compared(run, of_two).table.empty
    (row,) = compared(run, of_two.assign(observations=2)).table.itertuples()
    assert row.from_m < 2000.0 < row.to_m


@pytest.mark.parametrize(
    ("defect", "kind", "quantity"),
    [
        (Defect("dip", at_m=1500.0, size_m=3e-3, length_m=5.0), "dip", "versine_level_mm"),
        (Defect("dip", at_m=1500.0, size_m=-3e-3, length_m=5.0, rail="left"), "dip", "cross_level_mm"),
        (Defect("kink", at_m=1500.0, size_m=3e-3, length_m=5.0), "kick", "versine_alignment_mm"),
        (Defect("kink", at_m=1500.0, size_m=3e-3, length_m=8.0, rail="right"), "kick", "versine_alignment_mm"),
        (Defect("twist", at_m=1500.0, size_m=3e-3, length_m=5.0), "twist", "twist_mm"),
        (Defect("twist", at_m=1500.0, size_m=-3e-3, length_m=5.0, rail="left"), "twist", "twist_mm"),
    ],
)
def test_a_defect_is_one_change(grid: pd.DataFrame, defect: Defect, kind: str, quantity: str) -> None:
    found = compared(seen(shape_of(0, (defect,)), 102), grid)
    (row,) = found.table.itertuples()
    first, last = defect.extent_m
    assert first - 15.0 <= row.from_m <= defect.at_m <= row.to_m <= last + 15.0
    assert (row.kind, row.quantity) == (kind, quantity)
    half = defect.rail != "both" and defect.kind == "kink"
    assert abs(row.change) == pytest.approx(1.5 if half else 3.0, abs=0.3)
    assert row.after - row.before == pytest.approx(row.change)
    assert row.sigmas == pytest.approx(abs(row.change) / row.change_sd)


def test_a_changed_curve_is_no_kick(grid: pd.DataFrame) -> None:
    shape = shape_of(0)
    x = np.arange(CELLS) * STEP
    shape["lateral"] += np.cumsum(np.cumsum(3e-4 * np.exp(-0.5 * ((x - 3000.0) / 40.0) ** 2))) * STEP**2
    found = compared(seen(shape, 103), grid)
    assert found.table["kind"].tolist() == ["curvature"]
    assert found.table["change"][0] == pytest.approx(-12.5 * 0.3, abs=0.3)  # its versine


def test_small_changes_count_from_the_floor_on(grid: pd.DataFrame) -> None:
    run = seen(shape_of(0, (Defect("dip", at_m=1500.0, size_m=0.8e-3, length_m=5.0),)), 104)
    assert compared(run, grid).table.empty
    for floor in (0.5, 0.0):
        (row,) = compared(run, grid, floor_mm=floor).table.itertuples()
        assert (row.kind, row.quantity) == ("dip", "versine_level_mm")


def test_more_noise_than_stated_raises_the_sigmas(grid: pd.DataFrame) -> None:
    """And so does a map whose sigmas are too small; no alarm comes of it."""
    found = compared(seen(shape_of(0), 105, times=8.0), grid, floor_mm=0.0)
    factor = found.thresholds.set_index("quantity")["noise_factor"]
    assert factor["versine_level_mm"] == pytest.approx(np.hypot(8.0, 1.0) / 2**0.5, rel=0.1)
    assert found.table.empty


def test_twice_the_noise_at_high_speed_only(grid: pd.DataFrame) -> None:
    run = seen(shape_of(0), 106)
    noise = run["versine_level_mm"] - true_geometry(shape_of(0))["versine_level_mm"]
    fast = run["speed_mps"] >= 16.0
    run.loc[fast, "versine_level_mm"] += 5.0 * noise[fast]
    sd = compared(run, grid).cells["versine_level_mm_sd"]
    assert sd[fast].median() > 2.0 * sd[~fast].median()


def test_a_lasting_step_of_the_cross_level_is_a_twist(grid: pd.DataFrame) -> None:
    shape = shape_of(0)
    shape["cross_level"] += 3e-3 * np.clip((np.arange(CELLS) * STEP - 2000.0) / 4.0, 0.0, 1.0)
    (row,) = compared(seen(shape, 107), grid).table.itertuples()
    assert (row.kind, row.quantity) == ("twist", "twist_mm")
    assert row.change == pytest.approx(3.0, abs=0.2)
    assert 1990.0 < row.from_m < row.to_m < 2020.0


def test_where_the_map_knows_nothing(grid: pd.DataFrame) -> None:
    """Holes and ends of the map are not compared, and the coverage says so."""
    hole = (grid["chainage_m"] > 1480.0) & (grid["chainage_m"] < 1520.0)
    part = grid[~hole & (grid["chainage_m"] > 300.0)].reset_index(drop=True)
    run = seen(shape_of(0, (Defect("dip", at_m=1500.0, size_m=3e-3, length_m=5.0),)), 108)
    found = compared(run, part)
    assert found.table.empty
    assert found.cells["chainage_m"].iloc[0] == 300.25
    at = found.cells.set_index("chainage_m").loc[1500.0]
    assert at[[*QUANTITIES, "observations"]].isna().all()
    coverage = found.coverage.set_index("from_m")
    assert coverage.index[0] == 200.0
    assert coverage.loc[1400.0, "compared"] == pytest.approx(0.78, abs=0.01)
    assert coverage.loc[1600.0, "compared"] == 1.0
    assert coverage.loc[1600.0, "versine_level_mm"] == pytest.approx(1.0)
    assert found.thresholds["compared_m"].between(3600.0, 3720.0).all()


def test_a_poorly_known_map_hides_changes(grid: pd.DataFrame) -> None:
    """What a run measured badly is no alarm, and the least change that would be found is said."""
    poor = grid.copy()
    rows = poor["chainage_m"].between(1400.0, 1600.0)
    rng = np.random.default_rng(1)
    for name in ("versine_level_mm", "versine_alignment_mm"):
        poor.loc[rows, f"{name}_sd"] = 1.0
        poor.loc[rows, name] += waves(rng, int(rows.sum()), 1.5)
    found = compared(seen(shape_of(0), 109), poor)
    assert found.table.empty
    coverage = found.coverage.set_index("from_m")
    assert coverage.loc[1400.0, "versine_level_mm"] > 5.0
    assert coverage.loc[1800.0, "versine_level_mm"] == pytest.approx(1.0)


def test_another_chainage(grid: pd.DataFrame) -> None:
    """A run whose wheel is 0.2 % off, brought to the map by what recognition found."""
    run = seen(shape_of(0, (Defect("dip", at_m=1500.0, size_m=3e-3, length_m=5.0),)), 110)
    own = run["chainage_m"].to_numpy()
    scaled = {
        name: make_interp_spline(own[60:-60], run[name][60:-60], k=3)(own[80:-120] * 1.002)
        for name in run.columns.drop("chainage_m")
    }
    moved = pd.DataFrame({"chainage_m": own[80:-120], **scaled})
    found = changes(
        moved,
        grid,
        conventions=CONVENTIONS,
        to_map=lambda chainage: chainage * 1.002,
        shift_sd_m=np.full(len(moved), 0.02),
    )
    (row,) = found.table.itertuples()
    assert row.from_m < 1500.0 < row.to_m
    assert row.kind == "dip"


@pytest.mark.parametrize("cells", [0, 1, 30])
def test_little_or_nothing_in_common(grid: pd.DataFrame, cells: int) -> None:
    run = seen(shape_of(0), 111)
    found = compared(run.iloc[2000:6000], grid.iloc[6000 - cells :])
    assert len(found.cells) == cells
    assert found.table.empty
    assert list(found.thresholds["quantity"]) == list(QUANTITIES)


def test_what_is_refused(grid: pd.DataFrame) -> None:
    run = seen(shape_of(0), 112)
    sd = np.full(len(run), 0.05)
    options: dict[str, Any]
    for options, message in (
        ({"to_map": lambda x: -x, "shift_sd_m": sd}, "rise with those of the run"),
        ({"to_map": lambda x: np.where(x > 9.0, np.nan, x), "shift_sd_m": sd}, "finite"),
        ({"to_map": same, "shift_sd_m": sd[1:]}, "a value for each of 16001 rows"),
    ):
        with pytest.raises(ValueError, match=message):
            changes(run, grid, conventions=CONVENTIONS, **options)


def test_changes_as_csv(grid: pd.DataFrame, tmp_path: Path) -> None:
    found = compared(seen(shape_of(0, (Defect("twist", at_m=900.0, size_m=3e-3, length_m=5.0),)), 113), grid)
    found.write(tmp_path / "changes.csv")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "changes.csv"), found.table)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_shift_is_known_as_well_as_it_says(seed: int) -> None:
    """A shift of half a metre, wandering: found to a centimetre or two, and its sigma is not too small."""
    rng = np.random.default_rng(seed)
    shift = 0.3 + 0.15 * waves(rng, CELLS, 300.0)
    over = overlay(
        seen(shape_of(seed), 200 + seed, shift=shift),
        grid_of(seen(shape_of(seed), 300 + seed)),
        conventions=CONVENTIONS,
        to_map=same,
        shift_sd_m=np.full(CELLS, 0.3),
    )
    sigma = {name: np.sqrt(2.0) * over.run_column(f"{name}_sd") for name in ALIGNED_BY}
    found, sd = residual_shift(over, sigma)
    error = (found - shift)[100:-100]
    assert error.std() < 0.02
    assert np.sqrt(np.mean((error / sd[100:-100]) ** 2)) < 1.5


def test_a_shift_without_track_to_show_it_stays_unknown(grid: pd.DataFrame) -> None:
    """Where the map has a hole, as before."""
    part = grid[(grid["chainage_m"] < 1000.0) | (grid["chainage_m"] > 1400.0)].reset_index(drop=True)
    over = overlay(seen(shape_of(0), 1), part, conventions=CONVENTIONS, to_map=same, shift_sd_m=np.full(CELLS, 0.2))
    sigma = {name: np.sqrt(2.0) * over.run_column(f"{name}_sd") for name in ALIGNED_BY}
    shift, sd = residual_shift(over, sigma)
    middle = over.chainage == 1200.0
    assert shift[middle] == pytest.approx(0.0, abs=0.01)
    assert sd[middle] == pytest.approx(0.2, rel=0.01)
    assert np.median(sd) < 0.02


def test_rice() -> None:
    """Gaussian noise leaves the threshold about as often as asked for, in 1000 km of it."""
    noise = waves(np.random.default_rng(3), 2**22, 1.5)
    crossings = np.mean(noise[1:] * noise[:-1] < 0.0) / STEP
    known = ChangeNoise(np.ones(1), 1.0, float(crossings), freedom=1e9)
    level = known.sigmas_for(1e-4)
    outside = np.abs(noise) >= level
    assert np.sum(outside[1:] & ~outside[:-1]) == pytest.approx(1e-4 * STEP * 2**22, rel=0.2)
    assert level < dataclasses.replace(known, freedom=20.0).sigmas_for(1e-4)


@pytest.mark.slow
def test_defects_between_simulated_runs() -> None:
    """The other way, another wheel, another sensor; 3 mm defects of every kind are found, and nothing else."""
    every: Iterable[Any] = itertools.product(("dip", "kink", "twist"), ("both", "left", "right"), (3e-3, -3e-3))
    defects = tuple(
        Defect(kind, at_m=500.0 + 250.0 * i, size_m=size, length_m=5.0, rail=rail)
        for i, (kind, rail, size) in enumerate(every)
    )
    balises = BaliseModel(spacing_m=1000.0, sd_m=0.1, places_m=(100.0, 5400.0))
    plan = dataclasses.replace(scenario("shuttle"), length_m=5500.0, duration_s=700.0, balises=balises)
    first = simulate(plan, seed=0, run=0)
    later = simulate(dataclasses.replace(plan, defects=defects), seed=0, run=7)
    base, run = trackfg.smooth(first.recording), trackfg.smooth(later.recording)
    to_truth = [true_chainage(result, simulation.truth) for result, simulation in ((base, first), (run, later))]
    names = [name for quantity in NOISE for name in (quantity, f"{quantity}_sd")]
    grid = base.geometry[["chainage_m", "chainage_m_sd", *names]].assign(observations=1)
    truth_of_map = to_truth[0](grid["chainage_m"].to_numpy())
    found = changes(
        run.geometry,
        grid,
        conventions=run.summary.geometry,
        to_map=lambda x: 0.05 + np.interp(to_truth[1](x), truth_of_map, grid["chainage_m"]),
        shift_sd_m=np.full(len(run.geometry), 0.05),
    )
    table, truth = found.table, np.interp(found.table[["from_m", "to_m"]], grid["chainage_m"], truth_of_map)
    alarms = np.ones(len(table), dtype=bool)
    for defect in defects:
        first_m, last_m = defect.extent_m
        near = (truth[:, 1] > first_m - 15.0) & (truth[:, 0] < last_m + 15.0)
        assert near.any(), defect
        assert set(table["kind"][near]) == {"kick" if defect.kind == "kink" else defect.kind}
        alarms &= ~near
    assert not alarms.any()


def true_chainage(result: trackfg.Result, truth: pd.DataFrame) -> Callable[[Array], Array]:
    """From a result's chainage to where the vehicle was."""
    estimated = result.trajectory["chainage_m"].to_numpy()
    true = np.interp(result.trajectory["t_s"], truth["t_s"], truth["chainage_m"])
    moving = np.flatnonzero(np.diff(np.maximum.accumulate(np.sign(true[-1] - true[0]) * estimated)) > 1e-4)
    order = np.argsort(estimated[moving])
    return make_interp_spline(estimated[moving][order], true[moving][order], k=1)
