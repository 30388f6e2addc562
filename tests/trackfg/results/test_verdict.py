"""Doubts become verdicts: what is combined, what is refused, and what older summaries have of it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest

from trackfg.recording.findings import Finding
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.result import Result
from trackfg.results.summary import Summary
from trackfg.results.verdict import (
    QUANTITIES,
    Cause,
    Doubt,
    Opinion,
    Quantity,
    Verdict,
    causes,
    opinions,
    verdicts,
    widening,
)
from trackfg.results.widening import widened, widened_places


def doubt(factor: float, *quantities: Quantity, reason: str = "seen", hint: str = "do") -> Doubt:
    return Doubt(quantities, factor, reason, hint)


def test_quantities_without_doubt_are_trusted() -> None:
    by_name = {verdict.quantity: verdict for verdict in verdicts([doubt(2.0, "chainage")])}
    assert tuple(by_name) == QUANTITIES
    assert by_name["roll"] == Verdict(quantity="roll", status="trusted", factor=1.0)
    assert by_name["chainage"].status == "widened"
    assert by_name["chainage"].reasons == ("seen",)


def test_variances_of_independent_causes_add() -> None:
    # Excess variances 3 and 8 sigma^2: 1 + 3 + 8 = 12.
    found = verdicts([doubt(2.0, "roll", reason="small"), doubt(3.0, "roll", reason="large")])
    assert widening(found, "roll") == pytest.approx(math.sqrt(12.0))
    assert next(verdict for verdict in found if verdict.quantity == "roll").reasons == ("large", "small")
    assert widening(found, "pitch") == 1.0
    assert widening((), "roll") == 1.0


def test_an_infinite_doubt_is_a_quantity_not_to_be_trusted() -> None:
    found = verdicts([doubt(math.inf, "chainage"), doubt(2.0, "chainage")], {"chainage": ("3 fixes",)})
    assert (found[0].status, found[0].factor, found[0].widening) == ("not_trusted", None, math.inf)
    assert found[0].checked_by == ("3 fixes",)
    assert Verdict.model_validate_json(found[0].model_dump_json()) == found[0]


@pytest.mark.parametrize("factor", [0.5, math.nan])
def test_a_doubt_never_narrows(factor: float) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        doubt(factor, "roll")


def test_a_doubt_without_quantity_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        doubt(2.0)


def test_summaries_of_before_there_were_verdicts_are_read(make_result: Callable[..., Result]) -> None:
    page = json.loads(make_result().summary.model_dump_json())
    del page["verdicts"]
    assert Summary.model_validate(page).verdicts == ()


def test_people_read_each_verdict_and_each_reason_once() -> None:
    lost = doubt(math.inf, "chainage", "speed", reason="no wheel", hint="add one")
    shaky = doubt(2.04, "cross_level", "speed", reason="shaky", hint="damp it")
    found = verdicts([shaky, shaky, lost], {"roll": ("3 rests",)})
    read, why = opinions(found), causes(found)
    assert read[0] == Opinion("not to be trusted", ("chainage", "speed"))
    assert read[1] == Opinion("sigmas widened by 2.7", ("cross-level",))
    assert (read[2].verdict, "roll" in read[2].quantities) == ("trusted", True)
    assert why[0] == Cause("no wheel", ("chainage", "speed"), "add one")
    assert why[1] == Cause("shaky", ("speed", "cross-level"), "damp it")
    assert Cause("what is measured more than once agrees within its sigmas", ("roll",), "") in why
    assert "nothing in the recording tests it: the sigma is the model's" in [cause.reason for cause in why]
    assert [opinion.quantities for opinion in opinions(verdicts([]))] == [("all",)]
    assert [cause.quantities for cause in causes(verdicts([]))] == [("all",)]


def test_fixes_that_were_withheld_did_not_agree() -> None:
    found = verdicts([], {"chainage": ("8 fixes",), "roll": ("3 rests",)})
    agrees = "what is measured more than once agrees within its sigmas"
    withheld = Finding("warning", "fixes-withheld", "1 of 9 fixes contradicts the others and was withheld")
    assert Cause(f"{agrees}, but for fixes that were withheld", ("chainage",), "") in causes(found, [withheld])
    assert Cause(agrees, ("roll",), "") in causes(found, [withheld])
    assert Cause(agrees, ("chainage", "roll"), "") in causes(found)


def test_sigmas_are_widened_by_the_factor_of_their_quantity(make_result: Callable[..., Result]) -> None:
    result = make_result()
    found = verdicts([doubt(2.0, "level", "chainage"), doubt(3.0, "cross_level"), doubt(math.inf, "yaw")])
    geometry, trajectory = widened(result.geometry, found), widened(result.trajectory, found)
    for column, factor in {"versine_level_mm": 2.0, "level_mm": 2.0, "cross_level_mm": 3.0, "twist_mm": 1.0}.items():
        assert geometry[f"{column}_sd"].to_numpy() == pytest.approx(factor * result.geometry[f"{column}_sd"])
        assert geometry[column].equals(result.geometry[column])
    assert trajectory["chainage_m_sd"].to_numpy() == pytest.approx(2.0 * result.trajectory["chainage_m_sd"])
    assert (trajectory["yaw_rad_sd"] == math.pi).all()
    unknown = widened(result.geometry, verdicts([doubt(math.inf, "gradient")]))["gradient_permille_sd"]
    assert (unknown == 1e3).all()
    assert tuple(trajectory.columns) == TRAJECTORY_COLUMNS


def test_a_height_in_doubt_leaves_the_position_in_plan_as_it_is(make_result: Callable[..., Result]) -> None:
    trajectory = make_result().trajectory
    wide = widened(trajectory, verdicts([doubt(3.0, "height")]))
    ratio = {name: (wide[f"{name}_sd"] / trajectory[f"{name}_sd"]).iloc[0] for name in ("east_m", "north_m", "up_m")}
    assert ratio == pytest.approx({"east_m": 1.0, "north_m": 1.0, "up_m": 3.0})


def test_the_joint_covariance_is_widened_on_both_sides() -> None:
    places = PlaceCovariance.of(np.array([0.0, 250.0]), np.ones((4, 4)))
    wide = widened_places(places, verdicts([doubt(2.0, "chainage"), doubt(3.0, "cross_level")]))
    assert wide.matrix[:, 0].tolist() == [4.0, 4.0, 6.0, 6.0]
    assert wide.matrix[3].tolist() == [6.0, 6.0, 9.0, 9.0]
    assert widened_places(places, verdicts([doubt(math.inf, "cross_level")])).matrix.size == 0
