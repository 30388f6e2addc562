"""What the names of columns say: the quantity, the axis and the unit, in whatever order and spelling."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from trackfg.interchange.importing.columns.written_units import QUANTITIES, factor_of

_AXIS = re.compile(
    r"(?:^|[\s_.\-/(:])([xyzXYZ])(?:$|[\s_.\-/\[():])|([xz]|(?<!it)y)(?=$|_|\d|\s)|(?<=[a-z])([XYZ])(?![a-z])|"
    r"(?<=^[AGWF])([XYZ])$|^([XYZ])(?=[A-Z][a-z]|\d$)|^([xyzXYZ])(?=_?(?i:gyro|acc|rate|ang))|"
    r"(?<=[\u3040-\u9fff])([XYZ])$|(?<=[\s_])([XYZ])(?=[bsv]$)"
)
_NAMED_AXIS = {
    "x": re.compile(r"roll|wank|longitudinal|\blong?(?=acc)|\blong\b|l(ä|ae)ngs|in.?line|right/left|\bforward(?!/)"),
    "y": re.compile(r"pitch|nick|lateral|\blat(?=acc)|\blat\b|quer|forward/back"),
    "z": re.compile(r"yaw|gier|vertical|vertikal|\bvert(?=acc)|\bvert\b|hoch|up/down|\bdown$"),
}
"""Axes of a vehicle in words, English and German: of rotation rates, and of forces along the same axes. A GoPro calls
the axes x, y and z of its gyro so for its accelerometer: ``right/left``, ``forward/back``, ``up/down``."""
_BODY_RATES = {"p": "x", "q": "y", "r": "z"}
"""Letters of aircraft for the rates about x, y, z; without the unit of a rate they are no rates."""

_OTHER = re.compile(
    r"\bmag|magn(?!itude)|\bhoriz(?=.?acc)|\bmx\b|temp(?!o|s\b)|press|baro|quat|euler|humid|volt|batt|\bbias|\bstd\b|\bvar\b|\brms\b|cov|"
    r"\b(min|max|mean|avg)\b|^(motion )?(gravity|schwerkraft)\b(?! ?free)|^motiongravity"
)
"""Quantities beside a gyro and an accelerometer that have axes too, and statistics of theirs."""
_COVARIANCE = "covar"
"""What is in the names of an array that holds no measurement, as beside each vector of a ROS message."""
_NO_RATE = r"^(?!.*\b(vel|acc|std|sd|sigma|err|var))"
_GRID = "(utm|etrs|epsg|lv)"
"""Easting and northing are those of no velocity and no sigma; they may stand beside the name of a reference system."""
_PATTERNS = {
    "free_accel": r"linear.?acc|user.?acc|without.?g|ohne.?g|free.?acc|(?<!in)lin.?acc|gravity.?free|线性加速度",
    "gyro": (
        r"gyr|\bgiro|\bpqr\b|omega|ang(ular)?[\s_]*(vel|rate|speed)|vitesse.(ang|de.rot)|veloc\w*.ang|углов\w* скорост|"
        r"drehrate|rot(ation)?.?rate|"
        r"turn.?rate|^rate\b|\brates?$|(roll|pitch|yaw).?(rate|vel)|(wank|nick|gier).?(rate|geschw)|dtheta|"
        r"delta.?(theta|ang)|\binc\w*.?ang|ang\w*.?inc(?!l)|角速度|陀螺"
    ),
    "accel": (
        r"acc(?!ur)|g.?force|beschl|acel|specific.?force|dvel|delta.?v|\bdv\b|\binc\w*.?vel|"
        r"vel\w*.?inc(?!l)|加速度|ускорен|^load.?factor"
    ),
    "speed": (
        r"speed|\bspd\b|geschw|veloc|vitesse|twist.*linear\.x|^v$|^v[\s_\[(](?!.*(acc|std|sigma|err))|kmh|km/h|nopeus|скорост|速度|车速|^vel$|"
        r"hastighe[td]|snelheid|rychlost|pr[eę]dko[sś][cć]"
    ),
    "count": (
        r"pulse|impuls|^(?!.*(packet|sample|frame|sat|error|message|msg|seq|imu|calib|clip)).*count|"
        r"ticks|in[ck]rement|\benc(oder)?\b|encoder|drehgeber|tacho|zähl"
    ),
    "distance": r"odo|dist|^weg|wegstrecke|mileage|走行距離|пробег",
    "balise": r"(balisen?|rfid|transponder|beacon|tag|epc)[\s_.-]?(id|nr|no|number|nummer|code)?\.?$",
    "station": (
        r"chain|kilom|station(?!ary|.?(id|name|code|no|nr))|^km\b|^[pm][kp]$|^kp$|^miles?$|post|position_km|里程"
    ),
    "latitude": r"^lat|latitude|breite|緯度|纬度|широт|(?<=gps )lat(?!.?acc)|(?<=gnss )lat(?!.?acc)",
    "longitude": (
        r"^lon(?!g.?acc)|^lng|longitude|länge|laenge|経度|经度|долгот|"
        r"(?<=gps )(lon(?!g?.?acc)|lng)|(?<=gnss )(lon(?!g?.?acc)|lng)"
    ),
    "easting": rf"{_NO_RATE}.*(\beast(ing)?\b|rechtswert|ostwert)|^e$|^[ex]\W*{_GRID}|{_GRID}[\w ]* ?[ex]$",
    "northing": rf"{_NO_RATE}.*(\bnorth(ing)?\b|hochwert|nordwert)|^n$|^[ny]\W*{_GRID}|{_GRID}[\w ]* ?[ny]$",
    "height": (
        r"^alt|^elev|^up$|altitude|height|höhe|hoehe|высот|^h$|ellh|\bh(gt|t)\b|^h ell|(?<=gps )alt|(?<=gnss )alt"
    ),
    "down": r"^(pos(ition)? )?down$",
    "sd_horizontal": r"h(or\w*)?[ _]?acc|horizontal.?accuracy|^((gps|gnss|location)[ _])?accuracy|sd[ _]?[neh]\b",
    "sd_vertical": r"v(er\w*)?[ _]?acc(uracy)?\b|vertical.?accuracy|altitude.?accuracy|sd[ _]?[uv]\b",
    "time": (
        r"^t$|^[mu]s(ec)?$|^t (imu|gyro?|acc\w*|wheel|rad|tach\w*|odo\w*|enc\w*|speed|gps|gnss|pos\w*)$|"
        r"time|zeit|uhr|datum|(?<!up)date|horodat|врем|utc|stamp|elapsed|epoch?\b|heure|se[ck](ond|unde)?[sn]?$|^ts$|^gpst$|\btow\b|\bso[wd]$|"
        r"seconds? of (the )?(day|week)$|"
        r"時刻|時間|时间|tiempo|^temps|hora|^aika|^tid$|^tijd|^czas|^clock$|^millis|^micros"
    ),
}
"""In the order in which they are tried. English, German, some other languages; anything else has to be stated."""
_INERTIAL = ("gyro", "accel", "free_accel")
_LEVELS, _LEVEL = re.compile(r"\('.*'\)"), re.compile(r"'([^']*)'")
"""A name of several levels, ``('gyro', 'x')``, as pandas writes it, and one of them."""
_COMPACT = {"gyro": re.compile(r"\b[gw] ?[xyz]\b"), "accel": re.compile(r"\b(gf|[abf]) ?[xyz]\b")}
"""Letters with an axis that stand for a quantity where no word does."""

_INDEX = re.compile(r"\[([012])\]$")
_VECTOR = re.compile(r"gyr|acc(?!ur)|ang(ular)?[\s_]*vel|mag|\bpqr\b|delta[\s_]*(ang|vel|theta)")
"""Arrays of three columns, ``gyro_rad[0]``, whose indices are the axes x, y and z."""
_SUFFIX = re.compile(r"^(.*[^\s_])[\s_]*[\s_(\[]([^\s_()\[\]]+)[)\]]?$")
_RATIO = re.compile(r"^(.*[^\s_])_([^\s_]+_s2?)$")
"""A name that ends in a unit over a time, ``vel_m_s``."""
_NO_SUFFIX = ("min", "in", "h")
"""Units that end a name for another reason: a smallest value, an input, a height."""


class ColumnName(NamedTuple):
    """The parts of a name: its ``words``, in lower case with blanks between, its ``axis`` and its ``unit``."""

    words: str
    axis: str | None
    unit: str


def in_one_level(name: str) -> str:
    """Return a name of several levels as words, another one as it is."""
    return " ".join(_LEVEL.findall(name)).strip() if _LEVELS.fullmatch(name) else name


@lru_cache(maxsize=4096)
def parts_of(name: str) -> ColumnName:
    """Return the parts of a column's name; the unit is empty and the axis None where it has none.

    The axis, ``"x"``, ``"y"`` or ``"z"``, is at the end of the name, apart in it, or a word for it.
    """
    axis, _ = axis_and_rest(name)
    rest, unit = _without_unit(_INDEX.sub("", name.strip()))
    return ColumnName(re.sub(r"[\s_.\-/()]+", " ", rest.casefold()).strip(), axis, unit)


@lru_cache(maxsize=4096)
def _without_unit(name: str) -> tuple[str, str]:
    match = _RATIO.match(name)
    if match is not None and any(factor_of(match[2], quantity) is not None for quantity in QUANTITIES):
        return match[1], match[2]
    match = _SUFFIX.match(name)
    if match is None:
        return name, ""
    suffix = match[2]
    is_unit = suffix.casefold() not in _NO_SUFFIX and any(factor_of(suffix, q) is not None for q in QUANTITIES)
    return (match[1], suffix) if is_unit else (name, "")


@lru_cache(maxsize=4096)
def meaning(name: str) -> str | None:
    """Return the kind of quantity that a column's name means; None where it means none that is known."""
    parts, folded = parts_of(name), name.casefold().strip()
    if _COVARIANCE in folded:
        return None
    kinds = [kind for kind in _PATTERNS if parts.axis is not None or kind not in _INERTIAL]
    if parts.axis is not None and _OTHER.search(parts.words):
        kinds = [kind for kind in kinds if kind not in _INERTIAL]
    texts = (parts.words, folded)
    by_word = next((kind for kind in kinds if any(re.search(_PATTERNS[kind], text) for text in texts)), None)
    if by_word is not None or parts.axis is None or "gyro" not in kinds:
        return by_word
    return next((kind for kind, pattern in _COMPACT.items() if pattern.search(parts.words)), None)


def is_other(name: str) -> bool:
    """Return whether a name is that of a quantity with axes that is neither a gyro's nor an accelerometer's."""
    return _OTHER.search(parts_of(name).words) is not None


def axis_and_rest(name: str, unit: str = "") -> tuple[str | None, str]:
    """Return the axis in a name, None where there is none, and the name's other letters in alphabetical order.

    Letters p, q, r are axes where the ``unit`` is that of a rate.
    """
    index = _INDEX.search(name.strip())
    if index and _VECTOR.search(name.casefold()):
        return "xyz"[int(index[1])], "".join(sorted(_INDEX.sub("", name.strip().casefold())))
    rest, in_name = _without_unit(name.strip())
    axis, letters = _axis_and_rest(rest)
    if axis is None and rest.casefold() in _BODY_RATES and factor_of(unit or in_name, "angular rate") is not None:
        return _BODY_RATES[rest.casefold()], ""
    return axis, letters


def complete_vectors(groups: Mapping[Any, Mapping[str, str]]) -> list[tuple[str, str, str]]:
    """Return the columns x, y, z of the groups, names by axis, that have all three axes."""
    return [(axes["x"], axes["y"], axes["z"]) for axes in groups.values() if len(axes) == len("xyz")]


def names_axis_in_words(name: str) -> bool:
    """Return whether a name has its axis in a word, ``lateral``, and not in a letter."""
    return not (_INDEX.search(name.strip()) or _AXIS.search(_without_unit(name.strip())[0]))


def _axis_and_rest(name: str) -> tuple[str | None, str]:
    folded = name.casefold()
    axes = [next(filter(None, match)) for match in _AXIS.findall(name)]
    if axes:
        axis = axes[-1].casefold()
        return axis, "".join(sorted(folded.replace(axis, "", 1)))
    for axis, words in _NAMED_AXIS.items():
        if words.search(folded):
            return axis, "".join(sorted(words.sub("", folded, count=1)))
    return None, folded
