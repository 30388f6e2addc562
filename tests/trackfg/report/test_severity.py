from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.geometry.limits import Limit
from trackfg.report.severity import by_kilometre, by_severity, quantity_text, unsure_text, value_text
from trackfg.report.track_limits import doubt_about, judge
from trackfg.results.result import Result
from trackfg.results.verdict import Verdict

TWIST = Limit(standard="rule", level="alert", parameter="twist", base_m=5.0, kind="peak", value_mm=1.9)
SEVERE = TWIST.model_copy(update={"level": "stop", "value_mm": 1.99})
SAME = TWIST.model_copy(update={"level": "plan"})


def test_the_severest_stands_first_and_once(result: Result) -> None:
    found = judge(result, [TWIST, SEVERE]).found
    shown = by_severity(found)
    assert len(shown) == (found["level"] == "alert").sum()
    assert (shown["level"] == "stop").all()
    assert (np.diff(shown["value_mm"].abs() / shown["limit_mm"]) <= 0.0).all()


def test_levels_of_one_number_are_one(result: Result) -> None:
    found = judge(result, [TWIST, SAME]).found
    assert len(found) == 2 * len(by_severity(found))
    assert set(by_severity(found)["level"]) == {"alert"}


def test_each_kilometre_has_its_exceedances(result: Result) -> None:
    found = by_severity(judge(result, [TWIST]).found)
    kilometres = by_kilometre(found)
    assert [one.km for one in kilometres] == ["0", "1"]
    assert sum(one.count for one in kilometres) == len(found)
    assert sum(one.length_m for one in kilometres) == found["length_m"].sum()
    assert kilometres[0].counts == {"alert": (found["chainage_m"] < 1000.0).sum()}
    assert kilometres[0].worst_text.startswith("twist over 5 m, 105 % at 0.")
    assert by_kilometre(found.head(0)) == []


def test_the_worst_of_a_kilometre_is_of_its_severest_level() -> None:
    """A gang goes to the place to be closed, not to one that is further beyond a limit of planning."""
    rows = {
        "standard": "rule", "kind": "peak", "column": ["twist_mm", "twist_mm", "level_mm", "level_mm"],
        "parameter": ["twist", "twist", "level", "level"], "quantity": ["twist", "twist", "level", "level"],
        "level": ["stop", "alert", "alert", "stop"], "limit_mm": [10.0, 5.0, 8.0, 16.0],
        "value_mm": [10.5, 7.0, 11.0, 17.0], "value_mm_sd": [0.1, 0.1, 0.1, 2.0],
        "chainage_m": [100.0, 200.0, 300.0, 400.0], "from_m": [100.0, 200.0, 300.0, 400.0],
        "to_m": [101.0, 201.0, 301.0, 401.0], "length_m": 1.0,
    }  # fmt: skip

    (kilometre,) = by_kilometre(by_severity(pd.DataFrame(rows)))

    assert kilometre.counts == {"stop": 2, "alert": 2}
    assert kilometre.worst_text == "twist, 105 % at 0.100"


def test_what_exceeds_a_limit_for_sure_stands_first(result: Result) -> None:
    """Twist peaks of 2 mm, three times as high in a gap where nothing was measured."""
    gap = result.geometry["chainage_m"].between(500.0, 540.0)
    twist, sd = result.geometry["twist_mm"], result.geometry["twist_mm_sd"] * 0.1
    table = result.geometry.assign(twist_mm=twist.where(~gap, 3.0 * twist), twist_mm_sd=sd.where(~gap, 20.0))
    found = by_severity(judge(replace(result, geometry=table), [TWIST]).found)
    unsure = found["chainage_m"].between(500.0, 540.0)
    assert 3 <= unsure.sum() < len(found)
    assert unsure.tolist() == sorted(unsure)
    assert [f"{one.share:.2f}" for one in by_kilometre(found)] == ["1.05", "1.05"]
    assert unsure_text(found).startswith(f"{unsure.sum()} of them by less than 1.96 sigma")
    assert value_text(found.iloc[-1].to_dict()).endswith(" ± 20.00")


def test_what_is_not_to_be_trusted_is_marked(make_result: Callable[..., Result]) -> None:
    """Warp has no sigma that would say so."""
    doubted = Verdict(quantity="twist", status="not_trusted", factor=None, reasons=("seen",), hints=("do",))
    warp = TWIST.model_copy(update={"parameter": "warp", "base_m": 20.0, "value_mm": 0.1})
    level = Limit(standard="rule", level="stop", parameter="level", band="D1", kind="peak", value_mm=2.0)
    result = make_result(rows=1000, verdicts=[doubted])
    found = judge(result, [warp, level]).found
    assert found.groupby("parameter")["trusted"].agg(["all", "any"]).to_dict("index") == {
        "level": {"all": True, "any": True},
        "warp": {"all": False, "any": False},
    }
    assert {value_text(row)[-14:] for row in found[~found["trusted"]].to_dict("records")} == {" (not trusted)"}
    assert doubt_about(result) == "not to be trusted in this run: twist"
    assert doubt_about(make_result()) == ""


def test_kilometres_are_official_where_places_are() -> None:
    found = pd.DataFrame(
        {
            **{"chainage_m": [10.0, 20.0, 30.0], "km": ["12+999.00", "13+009.00 (2)", "13.01900"]},
            **{"level": "alert", "quantity": "level, D1", "column": ["level_mm", "level_left_mm", "level_right_mm"]},
            **{"value_mm": [2.0, -4.0, 3.0], "limit_mm": 2.0, "length_m": 1.0},
        }
    )
    first, second = by_kilometre(found)
    assert (first.km, first.count, second.km, second.count) == ("12", 1, "13", 2)
    assert second.worst_text == "level, D1, left rail, 200 % at 13+009.00 (2)"
    assert quantity_text(found.iloc[0].to_dict()) == "level, D1"
