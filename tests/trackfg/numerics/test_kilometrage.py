"""Official kilometrage: one to one with chainage but for its jumps."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trackfg.numerics.chainage.kilometrage import Kilometrage, KmPost, Stretch, between_posts

CENTIMETRE = 0.01


@st.composite
def kilometrages(draw):
    """Lines with up to six equations: gaps, overlaps, changes of direction, kilometrage in plan, both notations."""
    lengths = draw(st.lists(st.integers(1, 5_000_000), min_size=1, max_size=7))
    edges = draw(st.integers(-1_000_000, 50_000_000)) + np.cumsum([0, *lengths])
    stretches = [
        Stretch(
            float(1e-3 * edge),
            float(1e-3 * edge),
            1e-3 * draw(st.integers(-5_000_000, 500_000_000)),
            draw(st.sampled_from((1.0, -1.0, 0.9995, -0.9998))),
        )
        for edge in edges[:-1]
    ]
    return Kilometrage(tuple(stretches), float(1e-3 * edges[-1]), draw(st.sampled_from(("km+m", "km"))))


def within(kilometrage, share):
    """Return a chainage on the line or up to a tenth of it beyond."""
    start, end = kilometrage.stretches[0].from_m, kilometrage.end_m
    return start + share * (end - start)


@given(kilometrages(), st.floats(-0.1, 1.1), st.floats(1.0, 5000.0), st.sampled_from((1.0, 50.0, 200.0)))
def test_round_places_are_all_that_there_are(kilometrage, share, length, step):
    x = within(kilometrage, share)
    found = kilometrage.round_places(x, x + length, step)
    steps = kilometrage.official_m(found) / step
    between = np.flatnonzero(np.isclose(steps, np.round(steps), atol=1e-6))
    edges = [stretch.from_m for stretch in kilometrage.stretches[1:]]
    at_edges = sum(bool(np.isclose(edges, one, atol=1e-6, rtol=0.0).any()) for one in found)
    assert len(found) - len(between) <= at_edges  # the place there is that of the stretch behind
    assert np.all(np.diff(found) >= -1e-6)
    assert np.all((found >= x - 1e-6) & (found <= x + length + 1e-6))
    dense = np.arange(x, x + length, 0.01)
    passed = np.flatnonzero(np.diff(np.floor(kilometrage.official_m(dense) / step)) != 0.0)
    known = np.sort(np.concatenate([edges, found, [-np.inf, np.inf]]))
    after = np.searchsorted(known, dense[passed])
    assert np.all(np.minimum(dense[passed] - known[after - 1], known[after] - dense[passed]) <= 0.02)


@given(kilometrages(), st.floats(-0.1, 1.1))
def test_chainage_is_one_to_one_with_place_and_part(kilometrage, share):
    x = within(kilometrage, share)
    place, part = kilometrage.official_m(np.array(x)), int(kilometrage.part(np.array(x)))

    assert kilometrage.chainages(float(place), part) == pytest.approx((x,), abs=1e-6)


@given(kilometrages(), st.floats(-0.1, 1.1))
def test_a_written_place_leads_back_to_its_chainage(kilometrage, share):
    """Unless it is on a stretch that is shorter than the centimetre to which places are written."""
    edges = [*(stretch.from_m for stretch in kilometrage.stretches), kilometrage.end_m]
    assume(np.diff(edges).min() > 2.0 * CENTIMETRE)
    x = within(kilometrage, share)
    (text,) = kilometrage.written(np.array([x]))

    assert kilometrage.read(text) == pytest.approx(x, abs=1.01 * CENTIMETRE)


@given(kilometrages(), st.floats(0.0, 1.0, exclude_max=True))
def test_a_place_without_a_part_is_no_other_parts_place(kilometrage, share):
    x = within(kilometrage, share)
    (text,) = kilometrage.written(np.array([x]))
    others = [
        at
        for at in kilometrage.chainages(float(kilometrage.official_m(np.array(x))))
        if kilometrage.part(np.array(at)) != kilometrage.part(np.array(x)) and abs(at - x) > 3 * CENTIMETRE
    ]

    assert "(" in text or not others


@given(st.integers(0, 100_000_000), st.integers(-400_000, 400_000).filter(lambda jump: abs(jump) > 100), st.booleans())
def test_an_equation_makes_a_gap_or_an_overlap_of_its_size(at_mm, jump_mm, ascending):
    sense, at, jump = 1.0 if ascending else -1.0, 1e-3 * at_mm, 1e-3 * jump_mm
    line = Kilometrage((Stretch(at - 1e3, at, 50_000.0, sense), Stretch(at, at, 50_000.0 + jump, sense)), at + 1e3)
    (found,) = line.jumps
    middle = 50_000.0 + 0.5 * jump

    assert (found.chainage_m, found.ahead_m - found.back_m) == pytest.approx((at, jump))
    assert found.kind == ("gap" if (jump > 0) == ascending else "overlap")
    assert len(line.chainages(middle)) == (0 if found.kind == "gap" else 2)


@given(st.lists(st.integers(900_000, 1_100_000), min_size=1, max_size=6), st.booleans(), st.floats(-0.2, 1.2))
def test_metres_count_from_the_smaller_of_two_posts(lengths_mm, ascending, share):
    at = 1e-3 * np.cumsum([77, *lengths_mm])
    count = np.arange(len(at))
    km = 40 + (count if ascending else -count)
    posts = [KmPost(float(x), 1000.0 * k) for x, k in zip(at, km, strict=True)]
    line = Kilometrage(between_posts(posts))
    x = at[0] + share * (at[-1] - at[0])
    (text,) = line.written(np.array([x]), decimals=3)

    assert line.read(text) == pytest.approx(x, abs=0.51e-3)
    for post, number in zip(at, km, strict=True):
        assert line.read(str(number)) == pytest.approx(post)
    if 0.0 < share < 1.0 and x not in at:
        behind = at[at < x].max() if ascending else at[at > x].min()
        metres = abs(x - behind)
        assert text.startswith(f"{km[list(at).index(behind)]}+")
        assert float(text.partition("+")[2]) == pytest.approx(metres, abs=0.51e-3)


def test_a_line_that_descends_counts_down():
    line = Kilometrage((Stretch(1000.0, 1000.0, 85_000.0, -1.0),))

    assert line.written(np.array([1000.0, 1345.6, 2000.5])) == ["85+000.00", "84+654.40", "83+999.50"]
    assert line.read("84+654.4") == pytest.approx(1345.6)


def test_only_places_of_an_overlap_carry_their_part():
    line = Kilometrage((Stretch(0.0, 0.0, 12_000.0), Stretch(500.0, 500.0, 12_400.0)), 2000.0)

    assert line.written(np.array([399.0, 450.0, 550.0, 601.0])) == [
        "12+399.00", "12+450.00 (1)", "12+450.00 (2)", "12+501.00",
    ]  # fmt: skip
    with pytest.raises(ValueError, match=r"is there 2 times, .* 450.00 m, 550.00 m: expected 12\+450.00 \(1\)"):
        line.read("12+450")


def test_a_place_in_a_gap_is_none():
    line = Kilometrage((Stretch(0.0, 0.0, 12_000.0), Stretch(500.0, 500.0, 13_000.0)))

    with pytest.raises(ValueError, match="in a gap"):
        line.read("12,750")
    assert line.read("12+500") == line.read("13+000") == 500.0


def test_what_is_no_place_is_empty_or_refused():
    line = Kilometrage((Stretch(0.0, 0.0, 0.0),))

    assert line.written(np.array([math.nan, 1.0])) == ["", "0+001.00"]
    with pytest.raises(ValueError, match="no place"):
        line.read("bridge")
    with pytest.raises(ValueError, match="no part 2"):
        line.read("0+100 (2)")


def test_stretches_must_be_in_order():
    with pytest.raises(ValueError, match="expected ascending chainages"):
        Kilometrage((Stretch(10.0, 10.0, 0.0), Stretch(5.0, 5.0, 0.0)))
    with pytest.raises(ValueError, match="expected where kilometrage begins"):
        Kilometrage(())
    with pytest.raises(ValueError, match="ascends or descends"):
        Stretch(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("notation", ["equations", "posts"])
def test_feet_count_from_the_milepost_that_is_named(notation):
    mile, foot = 1609.344, 0.3048
    # Mile 12 has 5310 ft, mile 13 has 4990.
    posts = [KmPost(0.0, 12 * mile), KmPost(5310 * foot, 13 * mile), KmPost(10_300 * foot, 14 * mile)]
    stretches = tuple(Stretch(post.chainage_m, post.chainage_m, post.official_m) for post in posts)
    line = Kilometrage(stretches if notation == "equations" else between_posts(posts))

    feet = {
        "12 mi 100 ft": 100,
        "12 mi 5305 ft": 5305,
        "13 mi 5 ft": 5315,
        "13 mi 4980 ft": 10_290,
        "14 mi 5 ft": 10_305,
    }
    for place, along in feet.items():
        assert line.read(place) == pytest.approx(along * foot, abs=1e-6)
    assert line.read("13 mi 10 yd") == pytest.approx(5340 * foot)
    with pytest.raises(ValueError, match="gap"):
        line.read("13 mi 5100 ft")
