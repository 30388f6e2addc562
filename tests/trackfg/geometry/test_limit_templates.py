"""The template of EN 13848-5 is filled in by its user; limits of repeated deviations count neighbours only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.exceedances import exceedances
from trackfg.geometry.limits import Limit, at_level, cfr_213, limit_template, read_limits

ENTRY = {"standard": "rule", "level": "stop", "parameter": "twist", "base_m": 5.0, "kind": "peak", "value_mm": 4.0}


def test_what_is_filled_in_holds_and_the_rest_is_left_out(tmp_path: Path) -> None:
    lines = limit_template().splitlines(keepends=True)
    entries = [number for number, line in enumerate(lines) if "nan }" in line and '"twist"' in line]
    lines[entries[0]] = lines[entries[0]].replace("nan", "9.0")
    path = tmp_path / "limits.toml"
    path.write_text("".join(lines))
    (limit,) = read_limits(path)
    assert (limit.parameter, limit.base_m, limit.value_mm, limit.speed_to_kmh) == ("twist", 3.0, 9.0, 80.0)


def test_the_whole_template_can_be_filled_in(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(limit_template().replace("= nan", "= 7.0"))
    limits = read_limits(path)
    assert {limit.level for limit in limits} == {"alert", "intervention", "immediate action"}
    assert {limit.parameter for limit in limits} == {"level", "alignment", "twist", "gauge_wide", "gauge_narrow"}
    assert len({(limit.level, limit.quantity, limit.speed_to_kmh) for limit in limits}) == len(limits)


def test_a_template_as_it_is_has_no_limits(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(limit_template())
    with pytest.raises(BadInputError, match=r"limits.toml: every value_mm is nan: expected numbers"):
        read_limits(path)


def test_deviations_count_where_enough_are_near_each_other() -> None:
    chainage = 0.25 * np.arange(2000)
    twist = np.zeros(2000)
    twist[[100, 160, 200, 900, 1000, 1500, 1560]] = 5.0  # at 25, 40, 50; 225, 250; 375, 390 m
    twist[1620] = -5.0  # at 405 m
    limit = Limit(
        standard="rule",
        level="stop",
        parameter="twist",
        base_m=5.0,
        kind="peak",
        value_mm=4.0,
        repeats=3,
        within_m=30.0,
    )
    table = pd.DataFrame({"chainage_m": chainage, "twist_mm": twist})
    assert exceedances(table, [limit], speed_kmh=0.0).found["chainage_m"].tolist() == [25, 40, 50, 375, 390, 405]
    assert limit.quantity == "twist over 5 m, 3 within 30 m"


@pytest.mark.parametrize("keys", [{"repeats": 3}, {"within_m": 5.0}, {"repeats": 3, "within_m": 5.0, "kind": "sd"}])
def test_repeats_need_a_length_and_peaks(keys: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="repeats: expected above 1"):
        Limit.model_validate(ENTRY | keys)


def test_the_law_has_three_deviations_within_five_chords() -> None:
    repeated = [limit for limit in at_level(cfr_213(), "class 7") if limit.repeats == 3]
    inches = [(limit.chord_m / 0.3048, limit.within_m / limit.chord_m, limit.value_mm / 25.4) for limit in repeated]
    assert np.array(inches) == pytest.approx(np.array([(31, 5, 3 / 8), (62, 5, 3 / 8), (124, 5, 7 / 8)]))
