"""The line that a TOML file describes, and what is wrong with bad ones."""

import re
from pathlib import Path

import numpy as np
import pytest

from trackfg.datasets.line.line_description import read_line
from trackfg.errors import BadInputError

PAGE = Path(__file__).parents[3] / "docs" / "line-files.md"


@pytest.fixture
def read(tmp_path):
    """Reads a description written to a file."""

    def function(text):
        path = tmp_path / "branch.toml"
        path.write_text(text)
        return read_line(path)

    return function


@pytest.fixture(scope="module")
def example():
    """The example of the documentation."""
    return re.search(r"```toml[^\n]*\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


def test_the_documented_example_is_the_line_it_says(read, example):
    described = read(example)
    line = described.line
    assert (described.name, described.gauge_m, described.chainage_origin_m) == ("branch", 1.067, 12_000.0)
    assert described.remarks == ()
    assert line.length_m == 400 + 60 + 250 + 60 + 45 + 150 + 45 + 500
    assert line.cross_level_base_m == 1.067
    np.testing.assert_allclose(line.limit_from_m, [0, 400])
    np.testing.assert_allclose(line.limit_mps * 3.6, [85, 65])
    np.testing.assert_allclose(line.stations_m, [150])
    assert np.degrees(line.start_yaw_rad) == pytest.approx(15.0)

    at = np.array([200.0, 430.0, 500.0, 770.0, 900.0, 1100.0])
    np.testing.assert_allclose(line.curvature(at), [0, 1 / 800, 1 / 400, 0, -1 / 600, 0], atol=1e-15)
    np.testing.assert_allclose(line.cant(at), [0, -0.04, -0.08, 0, 0.05, 0], atol=1e-15)
    quarter = (1 - np.cos(np.pi / 4)) / 2
    assert line.curvature(415.0) == pytest.approx(quarter / 400, abs=1e-14)
    assert line.cant(415.0) == pytest.approx(-0.08 * quarter, abs=1e-14)
    assert line.cant(965.0 + 11.25) == pytest.approx(0.05 * 0.75, abs=1e-14)  # linear beside a cubic parabola

    gamma = np.arctan(0.015)
    half = 4000 * gamma / 2
    np.testing.assert_allclose(line.grade(np.array([600 - half, 600.0, 600 + half])), [0, gamma / 2, gamma], atol=1e-12)
    np.testing.assert_allclose(line.grade(np.array([590.0, 610.0]), 1), 1 / 4000)


def test_a_radius_with_a_sign_and_one_with_a_turn_are_the_same(read, example):
    signed = read(example.replace('radius_m = 400.0\nturn = "left"', "radius_m = 400.0"))
    turned = read(example.replace("radius_m = -600.0", 'radius_m = 600.0\nturn = "right"'))
    s = np.linspace(0, 1500, 31)
    for line in (signed.line, turned.line):
        np.testing.assert_array_equal(line.curvature(s), read(example).line.curvature(s))


SHORT = """
format = "trackfg-line/1"
id = "x"
[[speed_limit]]
chainage_m = 0
kmh = 60
"""
STRAIGHT = '[[element]]\ntype = "straight"\nlength_m = 100.0\n'


def curve(**keys):
    keys = {"radius_m": 500.0, "length_m": 80.0, **keys}
    return '[[element]]\ntype = "curve"\n' + "".join(f"{key} = {value}\n" for key, value in keys.items())


def transition(length=50.0, law="clothoid"):
    return f'[[element]]\ntype = "transition"\nlength_m = {length}\nlaw = "{law}"\n'


def gradient(chainage, permille, radius=None):
    text = f"[[gradient]]\nchainage_m = {chainage}\npermille = {permille}\n"
    return text + (f"vertical_radius_m = {radius}\n" if radius else "")


def test_a_jump_of_the_curvature_is_reported(read):
    described = read(SHORT + STRAIGHT + curve() + STRAIGHT)
    assert described.remarks == (
        "the curvature jumps by +0.002 1/m between elements 1 and 2 (chainage 100.000 m)",
        "the curvature jumps by -0.002 1/m between elements 2 and 3 (chainage 180.000 m)",
    )
    assert described.line.curvature(140.0) == 0.002


def test_a_compound_curve_has_one_transition_between_its_circles(read):
    line = read(SHORT + curve() + transition(40.0, "bloss") + curve(radius_m=250.0)).line
    assert line.curvature(100.0) == pytest.approx(0.003)
    assert line.yaw(np.array(120.0)) == pytest.approx(80 / 500 + 40 * 0.003)


def test_without_gradients_the_line_is_level(read):
    line = read(SHORT + STRAIGHT).line
    assert line.position(np.array(100.0)) == pytest.approx([100.0, 0.0, 0.0])


def test_a_curve_of_adverse_cant_raises_the_inner_rail(read):
    ramp = transition()
    line = read(SHORT + STRAIGHT + ramp + curve(cant_mm=-20) + ramp + STRAIGHT).line
    assert line.cant(190.0) == pytest.approx(0.02)


BAD = {
    "not TOML": ("format = ", "not valid TOML"),
    "other format": (SHORT.replace("line/1", "line/9") + STRAIGHT, "format: is 'trackfg-line/9': expected"),
    "no elements": (SHORT, "element: required key is missing"),
    "unknown key": (SHORT + STRAIGHT + "lenght = 3", "element 1, lenght: unknown key"),
    "unknown key at the top": ("colour = 1\n" + SHORT + STRAIGHT, "colour: unknown key"),
    "unknown type": (SHORT + STRAIGHT.replace("straight", "loop"), "element 1: type: expected 'straight', 'curve' or"),
    "no type": (SHORT + "[[element]]\nlength_m = 5", "element 1: type: expected"),
    "unknown law": (SHORT + STRAIGHT + transition(law="spline") + STRAIGHT, "element 2, law: is 'spline': expected"),
    "no length": (SHORT + STRAIGHT + '[[element]]\ntype = "straight"', "element 2, length_m: required key is missing"),
    "zero length": (SHORT + STRAIGHT + curve(length_m=0.0), "element 2, length_m: is 0.0: expected greater than 0"),
    "NaN": (SHORT + STRAIGHT + curve(length_m="nan"), "element 2, length_m: is nan: expected"),
    "a line round the world": (SHORT + STRAIGHT + curve(length_m=4e7), "the elements are 40000.1 km long: expected"),
    "text": (SHORT + STRAIGHT + curve(length_m='"long"'), "element 2, length_m: is 'long': expected"),
    "small radius": (SHORT + curve(radius_m=-2), "element 1: radius_m is -2: expected at least 10 m"),
    "zero radius": (SHORT + curve(radius_m=0), "element 1: radius_m is 0: expected at least 10 m"),
    "sign and turn": (SHORT + curve(radius_m=-300, turn='"left"'), "element 1: .* expected a sign or a turn, not both"),
    "cant jumps": (
        SHORT + STRAIGHT + curve(cant_mm=60),
        "elements 1 and 2: the cant jumps by 60 mm: expected a transition",
    ),
    "cant too high": (SHORT + curve(cant_mm=900), "element 1: cant_mm is 900: expected below 750"),
    "transition first": (SHORT + transition() + STRAIGHT, "element 1: a transition at an end of the line"),
    "transition last": (SHORT + STRAIGHT + transition(), "element 2: a transition at an end of the line"),
    "cubic parabola too steep": (
        SHORT + STRAIGHT + transition(60.0, "cubic-parabola") + curve(radius_m=30),
        "element 2: a cubic parabola 60 m long .* steeper than 24.1 degrees",
    ),
    "limit not at the start": (
        SHORT.replace("chainage_m = 0", "chainage_m = 5") + STRAIGHT,
        "speed_limit 1: .* start, 0",
    ),
    "limit beyond the end": (
        SHORT + "[[speed_limit]]\nchainage_m = 500\nkmh = 50\n" + STRAIGHT,
        "speed_limit 2: chainage_m is 500: expected one on the line, 0 to 100",
    ),
    "stations not in order": (
        SHORT + STRAIGHT + "".join(f'[[station]]\nname = "s"\nchainage_m = {at}\n' for at in (50, 20)),
        "station 2: chainage_m is 20: expected more than the one before it",
    ),
    "gradient not at the start": (SHORT + STRAIGHT + gradient(10, 5), "gradient 1: expected it at the line's start"),
    "gradient without a curve": (
        SHORT + STRAIGHT + gradient(0, 5) + gradient(50, 9),
        "gradient 2: vertical_radius_m is missing",
    ),
    "steep": (
        SHORT + STRAIGHT + gradient(0, 5000),
        "gradient 1, permille: is 5000: expected less than or equal to 500",
    ),
    "vertical curves overlap": (
        SHORT + STRAIGHT + gradient(0, 0) + gradient(40, 10, 5000) + gradient(70, 0, 5000),
        "gradient 3: its vertical curve begins 19.998 m before the vertical curve before it ends",
    ),
    "vertical curve before the line": (
        SHORT + STRAIGHT + gradient(0, 0) + gradient(20, 10, 5000),
        "gradient 2: its vertical curve begins 4.999 m before the line begins",
    ),
    "vertical curve beyond the end": (
        SHORT + STRAIGHT + gradient(0, 0) + gradient(80, 10, 5000),
        "gradient 2: its vertical curve ends 4.999 m after the line",
    ),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_description_gives_one_clear_error(read, fault):
    text, message = BAD[fault]
    with pytest.raises(BadInputError, match=message) as caught:
        read(text)
    assert "branch.toml: " in str(caught.value)
    assert "pydantic" not in str(caught.value)


def test_a_missing_file_and_other_bytes_are_refused(tmp_path):
    with pytest.raises(BadInputError, match=r"none\.toml: cannot be read: No such file"):
        read_line(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInputError, match=r"bytes\.toml: not valid TOML in UTF-8"):
        read_line(tmp_path / "bytes.toml")
