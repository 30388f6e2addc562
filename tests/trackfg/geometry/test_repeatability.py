from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.repeatability import ALIGNED_BY, best_shift, section_repeatability
from trackfg.numerics.arrays import Array

STEP_M = 0.25
NOISE_MM = 0.1
Measure = Callable[..., pd.DataFrame]


@pytest.fixture(scope="module")
def measure() -> Measure:
    """A run over a made-up track of many waves: what it writes at each chainage."""
    rng = np.random.default_rng(4)
    wavelength, phase = rng.uniform(4.0, 40.0, 60), rng.uniform(0.0, 2.0 * np.pi, (2, 60))

    def run(
        low: float,
        high: float,
        *,
        late_m: Callable[[Array], Array] | float = 0.0,
        seed: int,
        noise_mm: float = NOISE_MM,
    ) -> pd.DataFrame:
        noise = np.random.default_rng(seed)
        x = np.arange(round(low / STEP_M), round(high / STEP_M) + 1) * STEP_M
        place = x - (late_m(x) if callable(late_m) else late_m)
        waves = np.cos(2.0 * np.pi * place[:, None] / wavelength + phase[:, None, :]).sum(axis=2) / 4.0
        columns = {
            name: values + noise_mm * noise.standard_normal(len(x))
            for name, values in zip(ALIGNED_BY, waves, strict=True)
        }
        return pd.DataFrame({"chainage_m": x} | columns)

    return run


def test_the_shift_between_grid_places(measure: Measure) -> None:
    reference = measure(0.0, 1000.0, seed=1)
    for late in (-3.1, 0.0, 0.37, 12.6):
        found = best_shift(reference, measure(0.0, 1000.0, late_m=late, seed=2), within_m=20.0)
        assert found == pytest.approx(late, abs=0.02)


def test_the_shift_is_sought_where_it_was_asked_for(measure: Measure) -> None:
    reference = measure(200.0, 400.0, seed=1)
    run = measure(0.0, 1000.0, late_m=5.2, seed=2)
    assert best_shift(reference, run, about_m=5.0, within_m=1.0) == pytest.approx(5.2, abs=0.02)
    # Out of reach: the best of what was allowed, on the grid.
    assert abs(best_shift(reference, run, within_m=1.0)) <= 1.0


def test_no_shift_without_a_place_in_common(measure: Measure) -> None:
    apart = measure(0.0, 300.0, seed=1), measure(500.0, 800.0, seed=2)
    assert np.isnan(best_shift(*apart, within_m=20.0))
    assert section_repeatability(*apart, ALIGNED_BY, each_section=False).empty


def test_gaps_and_missing_values_do_not_count(measure: Measure) -> None:
    reference, run = measure(0.0, 1000.0, seed=1), measure(0.0, 1000.0, late_m=0.6, seed=2)
    run.loc[100:150, "twist_mm"] = np.nan
    run = run.drop(index=range(2000, 2400))
    assert best_shift(reference, run, within_m=5.0) == pytest.approx(0.6, abs=0.02)
    sections = section_repeatability(reference, run, ALIGNED_BY, each_section=False)
    # The gap is from 500 to 600 m: half of the third section.
    assert sections["from_m"].tolist() == [0.0, 200.0, 600.0, 800.0]


def test_noise_is_what_is_left(measure: Measure) -> None:
    reference, run = measure(0.0, 1000.0, seed=1), measure(0.0, 1000.0, late_m=-1.33, seed=2)
    sections = section_repeatability(reference, run, ALIGNED_BY, each_section=False)
    assert len(sections) == 5
    for name in ALIGNED_BY:
        np.testing.assert_allclose(sections[name], np.sqrt(2.0) * NOISE_MM, rtol=0.15)


def test_an_offset_does_not_count(measure: Measure) -> None:
    reference = measure(0.0, 1000.0, seed=1)
    offset = measure(0.0, 1000.0, seed=2) + {"chainage_m": 0.0, "twist_mm": 5.0, "versine_level_mm": 0.0}
    sections = section_repeatability(reference, offset, ALIGNED_BY, each_section=False)
    assert sections["twist_mm"].max() < 2.0 * NOISE_MM


def test_a_shift_per_section_takes_out_the_wheel(measure: Measure) -> None:
    reference = measure(0.0, 2000.0, seed=1)
    worn = measure(0.0, 2000.0, late_m=lambda x: 3.0 + 4e-4 * (x - 1000.0), seed=2)
    whole, each = (section_repeatability(reference, worn, ALIGNED_BY, each_section=own) for own in (False, True))
    assert np.ptp(whole["shift_m"]) == 0.0
    middle = 0.5 * (each["from_m"] + each["to_m"])
    np.testing.assert_allclose(each["shift_m"], 3.0 + 4e-4 * (middle - 1000.0), atol=0.03)
    assert whole["twist_mm"].max() > 1.5 * each["twist_mm"].max()
    assert each["twist_mm"].max() < 0.2


def test_falling_chainage_is_the_same_run(measure: Measure) -> None:
    reference, run = measure(0.0, 1000.0, seed=1), measure(0.0, 1000.0, late_m=0.37, seed=2)
    falling = run.iloc[::-1].reset_index(drop=True)
    expected = section_repeatability(reference, run, ALIGNED_BY, each_section=True)
    pd.testing.assert_frame_equal(section_repeatability(reference, falling, ALIGNED_BY, each_section=True), expected)
    falling.loc[5, "chainage_m"] = falling.loc[4, "chainage_m"]
    with pytest.raises(BadInputError, match="is there twice"):
        section_repeatability(reference, falling, ALIGNED_BY, each_section=True)


def test_runs_with_the_rails_alone_are_laid_over_each_other(measure: Measure) -> None:
    names = dict(zip(ALIGNED_BY, ("level_left_mm", "level_right_mm"), strict=True))
    reference = measure(0.0, 1000.0, seed=1).rename(columns=names)
    run = measure(0.0, 1000.0, late_m=-1.33, seed=2).rename(columns=names)
    sections = section_repeatability(reference, run, list(names.values()), each_section=False)
    assert sections["shift_m"].iloc[0] == pytest.approx(-1.33, abs=0.02)
    with pytest.raises(BadInputError, match="run: no column 'gauge_mm'"):
        section_repeatability(reference.assign(gauge_mm=1435.0), run, ["gauge_mm"], each_section=False)
    with pytest.raises(BadInputError, match="no column in common"):
        best_shift(reference, run.rename(columns={name: f"{name}_of_b" for name in names.values()}), within_m=5.0)
