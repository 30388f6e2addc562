"""What lines above a table say of the wheel: its diameter and its pulses per turn."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.source_table import SourceTable

_N = r"(\d+(?:[.,]\d+)?)"
_PULSE = r"(?:pulses?|impulse?|imp\.?|inkremente|increments|ticks|edges|teeth)"
_TURN = r"(?:rev(?:olution)?|turn|rotation|umdrehung|u|tour)\b"
_PER = r"\s*(?:/|per|pro|par)\s*(?:wheel\s*)?"
_PULSES = (
    re.compile(rf"{_PULSE}{_PER}{_TURN}[^\d\n]{{0,16}}{_N}(?![\d.,]*[ \t]*(?:mm|m|Hz))", re.IGNORECASE),
    re.compile(rf"(?<![\d.,]){_N}[ \t]*{_PULSE}{_PER}{_TURN}", re.IGNORECASE),
)
_DIAMETER = re.compile(
    rf"(?:wheel|rad)[\s_-]*(?:diameter|durchmesser)(?:[\s:=]*[\[(](?P<before>\w+)[\])])?[^\d\n]{{0,16}}{_N}"
    r"[ \t]*(?P<unit>mm|cm|m|in)?\b",
    re.IGNORECASE,
)
_LARGEST_M = 2.5
"""A number without a unit above this is in millimetres: no wheel of a rail vehicle is larger."""


def stated_pulses(tables: Sequence[SourceTable]) -> str:
    """Return the pulses per turn that lines above the tables state; empty without any, or with several."""
    numbers = (match[1] for table in tables for pattern in _PULSES for match in pattern.finditer(table.remarks))
    return _only(float(number.replace(",", ".")) for number in numbers)


def stated_diameter(tables: Sequence[SourceTable]) -> str:
    """Return the diameter, m, that lines above the tables state; empty without any, or with several."""
    return _only(_metres(match) for table in tables for match in _DIAMETER.finditer(table.remarks))


def _metres(match: re.Match[str]) -> float:
    number = float(match[2].replace(",", "."))
    unit = match["unit"] or match["before"]
    factor = None if unit is None else factor_of(unit, "length")
    return number * (factor or (1.0 if number <= _LARGEST_M else 1e-3))


def _only(numbers: Iterable[float]) -> str:
    """Return the one number among these as text; empty where there is none, or where they differ."""
    different = {round(number, 6) for number in numbers} - {0.0}
    return f"{different.pop():.6g}" if len(different) == 1 else ""
