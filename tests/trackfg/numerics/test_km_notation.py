"""Places as people write them."""

import numpy as np
import pytest

from trackfg.numerics.chainage.km_notation import metres_of, post_and_metres, resolution_m, written_places


@pytest.mark.parametrize(
    ("cell", "metres"),
    [
        ("12+345", 12345.0),
        ("12 + 345,6", 12345.6),
        ("12+0345.25", 12345.25),
        ("km 12+345.6", 12345.6),
        ("km 12,4 + 73", 12473.0),
        ("12+1003.5", 13003.5),
        ("km 12,345", 12345.0),
        ("12.345 km", 12345.0),
        ("12345 m", 12345.0),
        ("12345", 12345.0),
        ("-0+050", -50.0),
        ("twelve", None),
        ("12+", None),
        ("", None),
    ],
)
def test_places_as_people_write_them(cell, metres):
    assert metres_of(cell) == metres


def test_a_bare_number_is_in_the_unit_that_is_stated():
    assert metres_of("12,345", "km") == 12345.0
    assert metres_of("12345 m", "km") == 12345.0


def test_metres_above_a_thousand_stay_with_their_post():
    assert post_and_metres("12+1003.5") == (12, 1003.5)
    assert post_and_metres("12.345") is None


@pytest.mark.parametrize(
    ("text", "metres"), [("12+345", 1.0), ("12+345.60", 0.01), ("12.345", 1.0), ("12345 m", 1.0), ("12", 1000.0)]
)
def test_a_written_place_has_the_resolution_of_its_last_digit(text, metres):
    assert resolution_m(text) == pytest.approx(metres)


def test_places_are_written_in_both_notations():
    places = np.array([12_345.678, 0.0, -50.0, 12_999.996])
    assert written_places(places) == ["12+345.68", "0+000.00", "-0+050.00", "13+000.00"]
    assert written_places(places, decimals=0) == ["12+346", "0+000", "-0+050", "13+000"]
    assert written_places(places, "km", decimals=0) == ["12.346", "0.000", "-0.050", "13.000"]
