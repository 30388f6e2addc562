"""Units at the rim."""

from __future__ import annotations

import math

import pytest

from trackfg.numerics import units


@pytest.mark.parametrize(
    ("quantity", "unit", "factor"),
    [
        ("time", "ms", 1e-3), ("time", "ns", 1e-9), ("angular rate", "deg/s", math.pi / 180),
        ("acceleration", "g", 9.80665), ("length", "mm", 1e-3), ("speed", "km/h", 1 / 3.6), ("count", "1", 1.0),
    ],
)  # fmt: skip
def test_factors_to_si(quantity: str, unit: str, factor: float) -> None:
    assert units.to_si(quantity, unit) == pytest.approx(factor, rel=1e-15)
    assert unit in units.known_units(quantity)


def test_the_si_unit_changes_nothing() -> None:
    for quantity in ("time", "angular rate", "acceleration", "length", "speed", "count"):
        assert units.to_si(quantity, units.known_units(quantity)[0]) == 1.0


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(KeyError):
        units.to_si("length", "inch")
