"""Doubts become verdicts: what is combined, what is refused, and what older summaries have of it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import pytest

from trackfg.results.result import Result
from trackfg.results.summary import Summary
from trackfg.results.verdict import QUANTITIES, Doubt, Quantity, Verdict, verdicts, widening


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
