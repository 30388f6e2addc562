"""The kilometrage of a line as it is written in TOML."""

import tomllib

import numpy as np
import pytest
from pydantic import ValidationError

from trackfg.datasets.line.line_description import read_line
from trackfg.errors import BadInputError
from trackfg.io.description_reader import validated
from trackfg.recording.line_kilometrage import LineKilometrage

LINE = """
format = "trackfg-line/1"
id = "branch"
start_chainage_m = 1000.0
[[speed_limit]]
chainage_m = 1000.0
kmh = 80
[[element]]
type = "straight"
length_m = 500.0
[kilometrage]
"""
RECORDING = {
    "format": "trackfg-recording/1",
    "id": "run",
    "imu": {"file": "imu.csv", "gyro": ["a", "b", "c"], "accel": ["d", "e", "f"]},
}


def kilometrage(text):
    return LineKilometrage.model_validate(tomllib.loads(text))


def written(text, *chainage):
    return kilometrage(text).kilometrage().written(np.array(chainage))


def test_equations_count_up_or_down_from_their_place():
    text = """
    line = "4201"
    track = "2"
    direction = "descending"
    equation = [{chainage_m = 0, km = "85+000"}, {chainage_m = 600, km = 84.5}]
    """
    assert kilometrage(text).name == "line 4201, track 2"
    assert written(text, 0.0, 599.0, 600.0, 700.0) == ["85+000.00", "84+401.00 (1)", "84+500.00 (2)", "84+400.00 (2)"]


def test_posts_are_counted_from_and_another_notation_is_shown():
    text = "post = [{chainage_m = 7, km = 12}, {chainage_m = 1020, km = 13}, {chainage_m = 2015, km = 14}]"
    assert written(text, 7.0, 1018.5, 1020.0, 2014.0) == ["12+000.00", "12+1011.50", "13+000.00", "13+994.00"]
    assert written(text + '\nnotation = "km"', 7.0) == ["12.00000"]


def test_without_equations_kilometrage_is_the_chainage():
    assert written('line = "1"', 1234.5) == ["1+234.50"]


def test_a_scale_stretches_kilometrage_between_equations():
    text = (
        "equation = [{chainage_m = 0, km = 0}]\nscale = [{chainage_m = 0, scale = 1}, {chainage_m = 500, scale = 0.99}]"
    )
    assert kilometrage(text).kilometrage().official_m(np.array([-10.0, 400.0, 600.0])).tolist() == [-10.0, 400.0, 599.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('equation = [{chainage_m = 0, km = "km"}]', "is 'km': expected a place such as 12"),
        (
            "equation = [{chainage_m = 5, km = 1}, {chainage_m = 5, km = 2}]",
            "equation 2: chainage_m is 5: expected more",
        ),
        ("equation = [{chainage_m = 5, km = 1}]\npost = [{chainage_m = 5, km = 1}]", "expected equations or posts"),
        ("post = [{chainage_m = 5, km = 1}, {chainage_m = 9, km = 1}]", "posts 1 and 2 show the same kilometre"),
        ("equation = [{chainage_m = 5, km = 1}]\nend_chainage_m = 4", "expected ascending chainages"),
        ('direction = "up"', "'ascending' or 'descending'"),
    ],
)
def test_what_is_no_kilometrage_is_refused(text, message):
    with pytest.raises(ValidationError, match=message):
        kilometrage(text)


def test_a_line_file_has_kilometrage_to_its_end(tmp_path):
    path = tmp_path / "line.toml"
    path.write_text(LINE + 'equation = [{chainage_m = 1000, km = "12+000"}, {chainage_m = 1200, km = "20+000"}]')
    line = read_line(path).kilometrage
    assert (line.line, line.end_chainage_m) == ("branch", 1500.0)
    assert line.kilometrage().read("20+100") == 1300.0

    path.write_text(LINE + "equation = [{chainage_m = 1600, km = 12}]")
    with pytest.raises(
        BadInputError, match=r"kilometrage: chainage_m is 1600: expected one before the line's end, 1500"
    ):
        read_line(path)


def test_a_recording_has_kilometrage_and_faults_are_found_by_key():
    good = validated(
        {**RECORDING, "kilometrage": {"line": "1", "post": [{"chainage_m": 0, "km": 3}]}}, "recording.toml"
    )
    assert good.description.kilometrage.post[0].official_m == 3000.0

    bad = validated(
        {**RECORDING, "kilometrage": {"equation": [{"chainage_m": 0, "km": "x", "kn": 1}]}}, "recording.toml"
    )
    assert {(finding.code, finding.column) for finding in bad.findings} == {
        ("bad-value", "kilometrage.equation.km"),
        ("unknown-key", "kilometrage.equation.kn"),
    }
    assert {finding.expected for finding in bad.findings if finding.code == "unknown-key"} == {
        "one of chainage_m, km, direction"
    }
    both = {"equation": [{"chainage_m": 0, "km": 1}], "post": [{"chainage_m": 0, "km": 1}]}
    (finding,) = validated({**RECORDING, "kilometrage": both}, "recording.toml").findings
    assert (finding.column, finding.expected) == ("kilometrage", "equations or posts to count from")
