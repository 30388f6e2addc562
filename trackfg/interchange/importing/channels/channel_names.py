"""What the channels of a recording car mean, from their names and units.

Understood are the columns of trackfg itself, and names in English, German, French, Italian, Spanish, Portuguese, Dutch,
Swedish, Norwegian, Danish, Finnish, Czech, Slovak, Polish, Hungarian and Chinese: the quantity, the rail, the band
(``D1``) and the unit in brackets; and abbreviations of EN 13848 (``LL``, ``AL``, ``CL``, ``TW3``), of German (``LH``,
``Ri``, ``Üh``, ``SpW``, ``Vw``) and of French (``NL G``, ``D D``, ``G3``). A channel that is a statistic of another one
(``standard deviation``) or a difference from the design is none of the track's geometry.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from trackfg.interchange.importing.columns.written_units import factor_of
from trackfg.interchange.importing.geometry_reading import KNOWN_COLUMNS
from trackfg.numerics.units import KMH, MPH

_STATISTIC = r"keskihajonta|standard.?dev|\bstd\b|\brms\b|\bsd\b|muutos|change|limit|class|grade|event|flag|标准差"
_SIGMA = r"\bsigma\b|uncertainty"
_CHORD = r"(prof|align|surf|run)\w* ?(31|62|124)( ?ft)?\b"
"""An offset from a chord of so many feet, as of the FRA (49 CFR 213.55 and 213.63): neither level nor alignment."""
_DEVIATION = r"deviation|poikkeama|poikkema|abweichung|偏差"
_LEFT = (
    r"\bleft|\blinks|\blinke|\bli\b|(?<=\w )gauche|vasen|左|_l\b|\bl\b|\bg$|\bsx\b|sinistr|\bizq|\besq|vänster|venstre|"
    r"\blev[áýéoaiy]|\blew[ay]|\bbal\b"
)
_RIGHT = (
    r"\bright|\brecht|\bre\b|droite?\b|oikea|右|_r\b|\br\b|\bd$|\bdx\b|destr|\bder(ech)?|\bdireit|höger|høyre|højre|"
    r"\bprav[áýéoaiy]|\bpraw[ay]|\bjobb\b"
)
_SIDE = r" ?(l|r|li|re|left|right|links|rechts)?( d[0-3])?$"
"""What may stand behind an abbreviation."""
_BAND = re.compile(r"\bd([0-3])\b", re.IGNORECASE)

_QUANTITIES = {
    "cross_level": (
        r"(cross|\bx).?level|\bcant\b|super.?eleva|sopraeleva|kallistu|(ü|ue)berh(ö|oe)hung|d[eé]vers|水平|超高|peralte|verkanting|"
        r"rälsförhöjning|overhø[yj]de|p[rř]evý[sš]en|przechyłk|túlemelés|^cl$|^(ü|ue)h$"
    ),
    "twist": (
        r"twist|\bwarp\b|^gauche\b|kierou|kierous|verwindung|三角坑|扭曲|sghembo|alabeo|\bempeno|scheluwte|skevning|"
        r"vindsk[jæ]|zborcen|wichrowato|síktorzulás|^(tw|vw) ?\d*( ?m)?$"
    ),
    "gauge": (
        r"gau?ge|[eé]cartement|^[eé]cart\.?$|raidelevey|spurweite|轨距|scartamento|\bancho\b|bitola|spoorwijdte|sp[åo]rvidde?|"
        r"rozchod|szeroko[sś][cć]|nyomtáv|^spw$"
    ),
    "curvature": r"curvature|courbure|kaarevuu|kr(ü|ue)mmung|曲率",
    "gradient": r"gradient|neigung|坡度",
    "speed": r"speed|vitesse|nopeu|geschw|速度",
    "versine": r"versine|nuolikorkeu|pfeilh(ö|oe)he|正矢|mid.?chord",
    "alignment": (
        rf"align|dressage|\blateral|richtung|轨向|allineament|alineaci|alinhament|\bschift\b|sidoläge|\bsm[eě]r\b|"
        rf"nierówno\w* poziom|^(al|ri){_SIDE}"
    ),
    "level": (
        rf"level|nivellement|longitudinal|\bprofile|\bsurface\b|\bvertical|korkeu|l(ä|ae)ngsh(ö|oe)he|高低|高程|hoogteligging|"
        rf"höjdläge|\bvýška\b|nierówno\w* pionow|^(ll|lh){_SIDE}|^nl ?[gd]?( d[0-3])?$"
    ),
}
"""In the order in which they are tried: ``cross-level`` before ``level``."""
_LETTERS = {"twist": r"^g ?3$", "gauge": r"^g$", "alignment": r"^d ?[gd]$"}
"""Letters that are channels beside a longitudinal level alone: gauge, and in French ``D G`` (dressage) and ``G3``."""

_LENGTHS = {"": 1.0, "mm": 1.0, "毫米": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
"""Millimetres in a unit of length; what states none is in millimetres."""
_UNITS = {
    "curvature": {"": 1.0, "1/m": 1.0, "1pm": 1.0, "m^-1": 1.0, "1/km": 1e-3, "rad/km": 1e-3, "10000/m": 1e-4},
    "gradient": {"": 1.0, "permille": 1.0, "‰": 1.0, "mm/m": 1.0, "%": 10.0, "m/m": 1000.0, "1": 1000.0},
    "speed": {"": KMH, "km/h": KMH, "kmh": KMH, "kph": KMH, "m/s": 1.0, "mps": 1.0, "mph": MPH},
}
"""Of what is no length: the columns' unit in a unit. ``10000/m`` is 10000 over the radius."""


@dataclass(frozen=True)
class Channel:
    """A channel: the geometry's column that it is, and what its numbers are multiplied by.

    ``deviation``: it counts from the nominal value, as a gauge does.
    """

    column: str
    factor: float
    deviation: bool = False


def channel_of(name: str, unit: str = "", *, beside_level: bool = False) -> Channel | None:
    """Return what a channel is by its name and unit; None where it is none of the geometry's.

    ``beside_level``: the table has a longitudinal level, so that letters alone are channels, too.
    """
    if name in KNOWN_COLUMNS:
        return Channel(name, 1.0)
    if name.casefold().endswith("_sd"):
        of = channel_of(name[:-3], unit)
        return None if of is None or f"{of.column}_sd" not in KNOWN_COLUMNS else Channel(f"{of.column}_sd", of.factor)
    folded = re.sub(r"\s*[\[(][^\[\]()]*[\])]$", "", name.casefold().replace("_", " ").strip())
    folded = re.sub(r"^(ll|lh|al|ri|nl)(?=[lrgd]$)", r"\1 ", folded)
    if re.search(_STATISTIC, folded) or re.search(_CHORD, folded):
        return None
    sigma = "_sd" if re.search(_SIGMA, folded) else ""
    side = _side(folded)
    quantity = next((key for key, pattern in _QUANTITIES.items() if re.search(pattern, folded)), None)
    if quantity is None and beside_level:
        quantity = next((key for key, pattern in _LETTERS.items() if re.search(pattern, folded)), None)
    if quantity is None and folded in ("left", "right", "l", "r", "左", "右"):
        quantity = "level"
    if quantity is None:
        return None
    deviation = re.search(_DEVIATION, folded) is not None
    unit = _unit(name, unit)
    factor = _UNITS.get(quantity, _LENGTHS).get(unit)
    if factor is None and quantity not in _UNITS and (metres := factor_of(unit, "length")) is not None:
        factor = 1000.0 * metres  # of a count: 0.1 mm
    if factor is None or (deviation and quantity in ("cross_level", "twist", "curvature", "gradient")):
        return None
    band = _BAND.search(folded)
    column = _column(quantity, side, None if band is None else f"d{band[1]}", folded)
    if column is None or column + sigma not in KNOWN_COLUMNS:
        return None
    return Channel(column + sigma, factor, deviation and quantity == "gauge")


def _column(quantity: str, side: str, band: str | None, folded: str) -> str | None:
    plain = {"curvature": "curvature_1pm", "gradient": "gradient_permille", "speed": "speed_mps"}
    if quantity in plain:
        return plain[quantity]
    if quantity in ("cross_level", "twist", "gauge"):
        return f"{quantity}_mm"
    if quantity == "versine":
        of = "level" if re.search(_QUANTITIES["level"], folded.replace("nuolikorkeu", "")) else "alignment"
        if band is None:
            return None if side else f"versine_{of}_mm"
        quantity = of  # Finnish files call the band-passed alignment a versine
    rail = f"_{side}" if side else ""
    return f"{quantity}{rail}_mm" if band in (None, "d1") else f"{quantity}{rail}_{band}_mm"


def _side(folded: str) -> Literal["", "left", "right"]:
    left, right = (re.search(pattern, folded) is not None for pattern in (_LEFT, _RIGHT))
    return "" if left == right else "left" if left else "right"


def _unit(name: str, unit: str) -> str:
    """Return the unit as stated, or as the name's last bracket has it."""
    match = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", name)
    return (unit or (match[1] if match else "")).casefold().strip(" []()")
