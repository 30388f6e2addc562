"""Hints name the antenna's lever arm where it may be the cause and is not declared."""

from __future__ import annotations

import pytest

from trackfg.recording.antenna import with_antenna_named
from trackfg.recording.description import Gnss
from trackfg.recording.findings import Finding

GNSS = Gnss(file="gnss.csv", position=("e", "n", "u"), sd=("se", "sn", "su"), frame="local")


@pytest.mark.parametrize(
    "code", ["gnss-clock", "gnss-delay", "gnss-level", "tach-clock", "tach-2-clock", "fixes-withheld"]
)
def test_what_an_antenna_elsewhere_causes_names_it(code: str) -> None:
    (finding,) = with_antenna_named([Finding("warning", code, "is off", hint="add 0.4")], GNSS)
    assert finding.hint is not None
    assert finding.hint.startswith("add 0.4; or declare gnss.lever_arm_m")


@pytest.mark.parametrize(
    ("code", "gnss"),
    [
        ("wheel-scale", GNSS),
        ("gnss-clock", GNSS.model_copy(update={"lever_arm_m": (8.0, 0.0, 3.0)})),
        ("gnss-clock", None),
    ],
)
def test_no_other_hint_does(code: str, gnss: Gnss | None) -> None:
    said = [Finding("warning", code, "is off", hint="add 0.4")]
    assert with_antenna_named(said, gnss) == tuple(said)
