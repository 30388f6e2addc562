from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trackfg
from trackfg.geometry.limits import Limit, cfr_213
from trackfg.plots.strip_chart import LimitLine
from trackfg.plots.strip_limits import limit_lines
from trackfg.results.columns import RAIL_COLUMNS
from trackfg.results.result import Result


@pytest.fixture(scope="module")
def with_rails(result: Result) -> Result:
    return replace(result, geometry=result.geometry.assign(**dict.fromkeys(RAIL_COLUMNS, 1.0)))


def limit(**fields: object) -> Limit:
    common = {"standard": "rule", "level": "alert", "kind": "peak", "value_mm": 10.0}
    return Limit.model_validate({**common, **fields})


def at(line: LimitLine, chainage_m: float) -> float | None:
    """The line's value at a place; None where it is broken."""
    for start in range(0, len(line.chainage_m), 3):
        if line.chainage_m[start] <= chainage_m <= line.chainage_m[start + 1]:
            assert line.value[start] == line.value[start + 1]
            return float(line.value[start])
    return None


def test_a_limit_both_ways_is_two_lines_with_one_label(result: Result) -> None:
    lines, left_out = limit_lines(result, [limit(parameter="twist", base_m=5.0)])
    assert [(line.column, line.label, at(line, 700.0)) for line in lines] == [
        ("twist_mm", "alert", 10.0),
        ("twist_mm", "", -10.0),
    ]
    assert [len(line.chainage_m) for line in lines] == [3, 3]
    assert not left_out


def test_a_limit_stands_where_the_chart_has_its_quantity(with_rails: Result) -> None:
    empty = {name: np.nan for name in RAIL_COLUMNS if name.startswith("level")}
    partly = replace(with_rails, geometry=with_rails.geometry.assign(**empty))
    lines, _ = limit_lines(partly, [limit(parameter=name, band="D1") for name in ("level", "alignment")])
    assert list(dict.fromkeys(line.column for line in lines)) == ["level_mm", "alignment_left_mm", "alignment_right_mm"]


def test_bands_of_each_rail_and_gauge_from_the_nominal_one(with_rails: Result) -> None:
    table = [
        limit(parameter="level", band="D1"),
        limit(parameter="gauge_wide", value_mm=30.0),
        limit(parameter="gauge_narrow", value_mm=5.0),
    ]
    lines, _ = limit_lines(with_rails, table)
    assert [(line.column, at(line, 0.0)) for line in lines] == [
        ("level_left_mm", 10.0),
        ("level_left_mm", -10.0),
        ("level_right_mm", 10.0),
        ("level_right_mm", -10.0),
        ("gauge_mm", 1097.0),
        ("gauge_mm", 1062.0),
    ]


def test_what_holds_the_design_is_limited_on_straight_track(result: Result) -> None:
    table = [
        limit(parameter="cross_level"),
        limit(parameter="alignment", chord_m=10.0),
        limit(parameter="reverse_cross_level", value_mm=20.0),
    ]
    lines, _ = limit_lines(result, table)
    cross_level, _, versine, _, reverse = lines
    for line in (cross_level, versine):
        assert [at(line, place) for place in (100.0, 750.0, 1450.0)] == [10.0, None, 10.0]
    assert [at(reverse, place) for place in (100.0, 750.0, 1450.0)] == [None, 20.0, None]


def test_reverse_cross_level_is_on_the_side_of_the_inner_rail(result: Result) -> None:
    mirrored = replace(result, geometry=result.geometry.assign(curvature_1pm=-result.geometry["curvature_1pm"]))
    (line,), _ = limit_lines(mirrored, [limit(parameter="reverse_cross_level")])
    assert at(line, 750.0) == -10.0


def test_by_speed_of_the_line(result: Result) -> None:
    table = [
        limit(parameter="twist", base_m=5.0, speed_to_kmh=80.0, value_mm=12.0),
        limit(parameter="twist", base_m=5.0, speed_from_kmh=80.0, value_mm=9.0),
    ]
    assert limit_lines(result, table, 80.0)[0][0].value[0] == 12.0
    assert limit_lines(result, table, 80.1)[0][0].value[0] == 9.0
    with pytest.raises(trackfg.BadInputError, match="give the line's speed"):
        limit_lines(result, table)


def test_what_no_panel_shows_is_counted(result: Result) -> None:
    table = [
        limit(parameter="level", band="D1", kind="sd"),
        limit(parameter="level", band="D2"),
        limit(parameter="level", chord_m=20.0),
        limit(parameter="twist", base_m=3.0),
        limit(parameter="warp", base_m=18.9),
        limit(parameter="alignment", chord_m=10.0, uniformity=True),
        limit(parameter="gauge_wide"),
    ]
    lines, left_out = limit_lines(result, table)
    assert lines == []
    assert dict(left_out) == {
        "sd over 200 m": 1,
        "level in the band D2": 1,
        "level on a chord of 20 m": 1,
        "twist on 3 m": 1,
        "warp": 1,
        "alignment, uniformity": 1,
        "gauge, which the result has not": 1,
    }


def test_the_law(result: Result) -> None:
    lines, left_out = limit_lines(result, cfr_213())
    assert {line.column for line in lines} == {"cross_level_mm"}
    assert [line.label for line in lines if line.label] == [f"class {number}" for number in range(1, 6)]
    assert sum(left_out.values()) == len(cfr_213()) - 10
    assert all(np.isfinite(line.chainage_m[0]) for line in lines)
