"""Limit tables: the built-in law, the user's TOML, and every fault in it named."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.limits import Limit, at_level, cfr_213, read_limits

GOOD = {
    "standard": '"own"',
    "parameter": '"level"',
    "level": '"alert"',
    "kind": '"peak"',
    "value_mm": "12.0",
    "band": '"D1"',
}


def toml(**changes: str | None) -> str:
    """One good entry and one changed; None takes a key away."""
    entries = (GOOD, {**GOOD, **changes})
    return "".join(
        "[[limits]]\n" + "".join(f"{key} = {value}\n" for key, value in entry.items() if value is not None)
        for entry in entries
    )


def test_the_law_is_built_in_millimetres() -> None:
    limits = cfr_213()
    inches = {
        (limit.standard, limit.level, limit.parameter, limit.chord_m or limit.base_m, limit.track): limit.value_mm
        / 25.4
        for limit in limits
    }
    assert len(inches) == len(limits) == 25 + 13 + 24 + 10 + 13 + 8 + 12 + 12 + 1 + 5 + 12 + 4
    surface = "49 CFR 213.63(a)"
    for parameter, length, track, row in (
        ("runoff", 9.4488, "any", (3.5, 3, 2, 1.5, 1)),
        ("level", 18.8976, "any", (3, 2.75, 2.25, 2, 1.25)),
        ("cross_level", None, "tangent", (3, 2, 1.75, 1.25, 1)),
        ("reverse_cross_level", None, "curved", (3, 2, 1.75, 1.25, 1)),
        ("warp", 18.8976, "any", (3, 2.25, 2, 1.75, 1.5)),
    ):
        found = [inches[surface, f"class {k}", parameter, length, track] for k in range(1, 6)]
        assert found == pytest.approx(row)
    deficient = "class 3, cant deficiency above 5 in"
    assert inches["49 CFR 213.63(b)", deficient, "level", 9.4488, "curved"] == pytest.approx(1.0)
    assert inches["49 CFR 213.63(b)", deficient, "warp", 3.048, "curved"] == pytest.approx(1.75)
    alinement = "49 CFR 213.327"
    for level, track, row in (
        ("class 6", "tangent", (0.5, 0.75, 1.5)),
        ("class 6", "curved", (0.5, 0.625, 1.5)),
        ("class 7", "tangent", (0.5, 0.75, 1.25)),
        ("class 8", "curved", (0.5, 0.5, 0.75)),
        ("class 9", "tangent", (0.5, 0.5, 0.75)),
    ):
        chords = (9.4488, 18.8976, 37.7952)
        assert [inches[alinement, level, "alignment", chord, track] for chord in chords] == pytest.approx(row)
    for level, row in (("class 6", (0.5, 0.625, 1.25)), ("class 7", (0.5, 0.5, 1.0)), ("class 9", (0.5, 0.5, 0.75))):
        name = f"{level}, cant deficiency above 5 in"
        found = [inches["49 CFR 213.327(c)", name, "alignment", chord, "curved"] for chord in chords]
        assert found == pytest.approx(row)
    for k, wide in enumerate((1.5, 1.25, 1.25, 1.0, 1.0), start=1):
        gage = ("49 CFR 213.53(b)", f"class {k}")
        assert inches[*gage, "gauge_wide", None, "any"] == pytest.approx(wide)
        assert inches[*gage, "gauge_narrow", None, "any"] == pytest.approx(0.5)
    for k, (narrow, change) in enumerate(((0.5, 0.75), (0.5, 0.5), (0.5, 0.5), (0.25, 0.5)), start=6):
        gage = ("49 CFR 213.323(b)", f"class {k}")
        assert inches[*gage, "gauge_wide", None, "any"] == pytest.approx(0.75)
        assert inches[*gage, "gauge_narrow", None, "any"] == pytest.approx(narrow)
        assert inches[*gage, "gauge_change", 9.4488, "any"] == pytest.approx(change)
    assert inches["49 CFR 213.53(b)", "excepted track", "gauge_wide", None, "any"] == pytest.approx(1.75)
    for k, highest in enumerate((8, 8, 7, 7, 7, 7, 7, 7, 7), start=1):
        standard = "49 CFR 213.57(a)" if k <= 5 else "49 CFR 213.329(a)"
        assert inches[standard, f"class {k}", "elevation", None, "curved"] == pytest.approx(highest)
    for k, (tangent, short, long) in enumerate(
        ((5.0, None, 5.0), (3.0, None, 3.0), (1.75, 1.25, 1.75), (1.5, 1.0, 1.5), (0.75, 0.5, 0.625)), start=1
    ):
        place = ("49 CFR 213.55(a)", f"class {k}", "alignment")
        assert inches[*place, 18.8976, "tangent"] == pytest.approx(tangent)
        assert inches.get((*place, 9.4488, "curved")) == (None if short is None else pytest.approx(short))
        assert inches[*place, 18.8976, "curved"] == pytest.approx(long)
    deficient = "class 4, cant deficiency above 5 in"
    assert inches["49 CFR 213.55(b)", deficient, "alignment", 9.4488, "curved"] == pytest.approx(0.75)
    assert inches["49 CFR 213.55(b)", deficient, "alignment", 18.8976, "curved"] == pytest.approx(0.875)
    assert all(limit.uniformity == (limit.parameter == "alignment") for limit in limits)


def test_a_level_is_chosen_by_name() -> None:
    assert {limit.level for limit in at_level(cfr_213(), "class 4")} == {"class 4"}
    with pytest.raises(BadInputError, match=r"no limits of level 'class 10'; expected one of class 1, class 2"):
        at_level(cfr_213(), "class 10")
    with pytest.raises(BadInputError, match=r"class 5, 'class 1, cant deficiency above 5 in', 'class 2, "):
        at_level(cfr_213(), "class 11")


def test_a_users_table_is_read(tmp_path: Path) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(toml(kind='"sd"', speed_from_kmh="80", speed_to_kmh="120", section_m="100"))
    first, second = read_limits(file)
    assert first == Limit(standard="own", parameter="level", level="alert", kind="peak", value_mm=12.0, band="D1")
    assert (second.kind, second.speed_from_kmh, second.speed_to_kmh, second.section_m) == ("sd", 80.0, 120.0, 100.0)
    assert str(second) == "own, alert, level, D1, sd of 100 m"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"valu_mm": "3"}, "entry 2, key valu_mm: unknown key; expected one of .* Hint: did you mean 'value_mm'?"),
        ({"value_mm": None}, "entry 2, key value_mm: required key is missing"),
        ({"value_mm": "-1.0"}, "entry 2, key value_mm: is '-1.0'; expected greater than 0"),
        ({"value_mm": "inf"}, "entry 2, key value_mm: is 'inf'; expected a finite number"),
        ({"parameter": '"profile"'}, "entry 2, key parameter: is 'profile'; expected 'level', 'alignment'"),
        ({"kind": '"rms"'}, "entry 2, key kind: is 'rms'; expected 'peak', 'sd' or 'mean'"),
        ({"band": None}, "entry 2, band and chord_m: expected one of them with parameter 'level'"),
        ({"chord_m": "10"}, "entry 2, band and chord_m: expected one of them"),
        ({"parameter": '"twist"'}, "entry 2, band and chord_m: expected neither with parameter 'twist'"),
        ({"parameter": '"twist"', "band": None}, "entry 2, base_m: expected a length with parameter 'twist'"),
        ({"base_m": "3"}, "entry 2, base_m: expected none with parameter 'level'"),
        ({"uniformity": "true"}, "entry 2, uniformity: expected only with chord_m"),
        ({"speed_from_kmh": "90", "speed_to_kmh": "80"}, "entry 2, speed_from_kmh: expected below speed_to_kmh"),
    ],
)
def test_a_fault_is_named_by_file_entry_and_key(tmp_path: Path, changes: dict[str, str | None], message: str) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(toml(**changes))
    with pytest.raises(BadInputError, match=f"^{re.escape(str(file))}, {message}"):
        read_limits(file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("limits = [", "not valid TOML"),
        ("", "key limits: required key is missing"),
        ("limits = []", "key limits: "),
        ("limit = []", r"key limit: unknown key; expected one of limits\. Hint: did you mean 'limits'"),
        ("limits = [3]", "entry 1: is '3'; expected "),
    ],
)
def test_a_file_that_is_no_limit_table(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(text)
    with pytest.raises(BadInputError, match=message):
        read_limits(file)
    with pytest.raises(BadInputError, match="cannot be read"):
        read_limits(tmp_path / "none.toml")
