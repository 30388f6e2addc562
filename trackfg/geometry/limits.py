"""Limit tables: what a standard, or a user, allows of which parameter at which speed. Read from TOML.

docs/geometry.md has an example and every key. :func:`cfr_213` gives the tables of 49 CFR 213 for gage, alinement,
elevation and surface (the law's inches as mm). Their levels are track classes; which class a line has follows from more
than its speed, so no speed stands in them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from trackfg.errors import BadInputError, expected_one_of
from trackfg.files.small_file import read_toml, toml_of

EN_13848_5 = "en-13848-5"
"""The name of the template whose numbers the user fills in."""

CFR_213 = "cfr-213"
"""The name of the built-in table of 49 CFR 213."""

_CFR_213_CLASS = f"{CFR_213}-class-"

_OF_CURVES = ("elevation", "reverse_cross_level")
"""Parameters that only curves have."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

Parameter = Literal[
    "level",
    "alignment",
    "cross_level",
    "reverse_cross_level",
    "elevation",
    "twist",
    "warp",
    "gauge_wide",
    "gauge_narrow",
    "gauge_change",
    "runoff",
]


class Limit(BaseModel):
    """One entry of a limit table: docs/geometry.md says what each key and each parameter means.

    The limit holds for ``speed_from_kmh < speed <= speed_to_kmh``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    standard: Annotated[str, Field(min_length=1)]
    parameter: Parameter
    level: Annotated[str, Field(min_length=1)]
    kind: Literal["peak", "sd", "mean"]
    value_mm: Positive
    band: Literal["D0", "D1", "D2", "D3"] | None = None
    chord_m: Positive | None = None
    uniformity: bool = False
    base_m: Positive | None = None
    speed_from_kmh: Annotated[float, Field(ge=0)] | None = None
    speed_to_kmh: Positive | None = None
    track: Literal["any", "tangent", "curved"] = "any"
    section_m: Positive = 200.0
    repeats: Annotated[int, Field(ge=1)] = 1
    within_m: Positive | None = None

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        by_wavelength = self.parameter in ("level", "alignment")
        given = (self.band is not None) + (self.chord_m is not None)
        if given != by_wavelength:
            wanted = "one of them" if by_wavelength else "neither"
            raise ValueError(f"band and chord_m: expected {wanted} with parameter {self.parameter!r}")
        over_base = self.parameter in ("twist", "warp", "gauge_change", "runoff")
        if over_base != (self.base_m is not None):
            raise ValueError(
                f"base_m: expected {'a length' if over_base else 'none'} with parameter {self.parameter!r}"
            )
        if self.uniformity and self.chord_m is None:
            raise ValueError("uniformity: expected only with chord_m")
        if (self.repeats > 1) != (self.within_m is not None) or (self.repeats > 1 and self.kind != "peak"):
            raise ValueError("repeats: expected above 1 with within_m and kind 'peak' only")
        if (
            self.speed_from_kmh is not None
            and self.speed_to_kmh is not None
            and self.speed_from_kmh >= self.speed_to_kmh
        ):
            raise ValueError("speed_from_kmh: expected below speed_to_kmh")
        return self

    @property
    def quantity(self) -> str:
        """Return the limited quantity in words: parameter, band, chord or base, and any kind but a peak."""
        over = "" if self.base_m is None else f" over {self.base_m:.3g} m"
        words = [self.parameter.replace("cross_level", "cross-level").replace("_", " ") + over]
        words += [] if self.band is None else [self.band]
        words += [] if self.chord_m is None else [f"{self.chord_m:.3g} m chord"]
        words += ["uniformity"] if self.uniformity else []
        words += [] if self.within_m is None else [f"{self.repeats} within {self.within_m:.3g} m"]
        words += [] if self.track == "any" or self.parameter in _OF_CURVES else [f"{self.track} track"]
        words += [] if self.kind == "peak" else [f"{self.kind} of {self.section_m:g} m"]
        return ", ".join(words)

    def __str__(self) -> str:
        return ", ".join([self.standard, self.level, self.quantity])


class _LimitFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    limits: Annotated[tuple[Limit, ...], Field(min_length=1)]


def read_limits(path: Path | str) -> tuple[Limit, ...]:
    """Read the limits of a TOML file, without the entries of a template whose ``value_mm`` is still nan.

    Raises ``BadInputError`` that names file, entry, key and what was expected.
    """
    path = Path(path)
    content = read_toml(path)
    listed = content.get("limits")
    if isinstance(listed, list):
        content["limits"] = [each for each in listed if not _is_open(each)]
        if listed and not content["limits"]:
            raise BadInputError(f"{path}: every value_mm is nan: expected numbers, mm, of a standard that you may use")
    return _validated(content, str(path))


def limit_template() -> str:
    """Return the template of EN 13848-5 as TOML: its quantities, levels and speeds, without its numbers."""
    return files("trackfg.geometry").joinpath("en_13848_5.toml").read_text(encoding="utf-8")


def _is_open(entry: object) -> bool:
    """Return whether an entry's number has not been filled in."""
    value = entry.get("value_mm") if isinstance(entry, dict) else None
    return isinstance(value, float) and math.isnan(value)


def cfr_213() -> tuple[Limit, ...]:
    """Return the limits of gage, alinement, elevation and surface of classes 1 to 5 (49 CFR 213.53, 55, 57, 63), and
    those of gage, alinement and elevation of 6 to 9 (213.323, 327, 329).
    """
    resource = files("trackfg.geometry").joinpath("cfr_213.toml")
    return _validated(toml_of(resource.read_bytes()), resource.name)


def at_level(limits: Iterable[Limit], level: str) -> tuple[Limit, ...]:
    """Return the limits of one level, such as ``"class 4"``. Raises ``BadInputError`` where there are none."""
    limits = tuple(limits)
    chosen = tuple(limit for limit in limits if limit.level == level)
    if not chosen:
        levels = listed_levels(limit.level for limit in limits)
        raise BadInputError(f"no limits of level {level!r}; expected one of {levels}")
    return chosen


def listed_levels(levels: Iterable[str]) -> str:
    """Return each level once, in their order, as one text; a name that has a comma stands in quotes."""
    return ", ".join(repr(level) if "," in level else level for level in dict.fromkeys(levels))


def at_line_speed(limits: Iterable[Limit], line_speed_kmh: float | None) -> tuple[Limit, ...]:
    """Return the limits that hold at the speed that the line is limited for.

    Raises ``BadInputError`` where limits depend on that speed and it is None.
    """
    chosen = []
    for limit in limits:
        low, high = limit.speed_from_kmh, limit.speed_to_kmh
        if low is not None or high is not None:
            if line_speed_kmh is None:
                raise BadInputError(
                    f"the limit {limit} holds at some speeds only: give the line's speed (--line-speed)"
                )
            if (low is not None and line_speed_kmh <= low) or (high is not None and line_speed_kmh > high):
                continue
        chosen.append(limit)
    return tuple(chosen)


@dataclass(frozen=True)
class LimitChoice:
    """The limits that a user asks for: a source, one level of it, and the speed that the line is limited for, km/h.

    ``source`` is the path of a TOML file, or the name of a built-in table: ``cfr-213``, or one class of it,
    ``cfr-213-class-4``.
    """

    source: str
    level: str | None = None
    line_speed_kmh: float | None = None

    def table(self) -> tuple[Limit, ...]:
        """Return the limits of the source and level, at every speed.

        Raises ``BadInputError`` for a source that cannot be read and a level that it does not have.
        """
        if self.source == CFR_213:
            limits = cfr_213()
        elif self.source.startswith(_CFR_213_CLASS):
            limits = at_level(cfr_213(), f"class {self.source.removeprefix(_CFR_213_CLASS)}")
        elif not Path(self.source).exists() and "." not in Path(self.source).name:
            raise BadInputError(_unknown_name(self.source))
        else:
            limits = read_limits(self.source)
        return limits if self.level is None else at_level(limits, self.level)

    def options(self) -> tuple[str, ...]:
        """Return the options of a command that ask for these limits."""
        level = () if self.level is None else ("--level", self.level)
        speed = () if self.line_speed_kmh is None else ("--line-speed", f"{self.line_speed_kmh:g}")
        return ("--limits", self.source, *level, *speed)


def _unknown_name(name: str) -> str:
    """Return the message about a name that is neither a file's nor that of a built-in table."""
    if name.startswith("en-13848"):
        template = f"`trackfg config --limits {EN_13848_5} -o limits.toml`"
        return f"no limits {name!r}: its numbers are not free to copy. Hint: {template} writes a template to fill in"
    return f"no limits {name!r}: expected a file (.toml), or one of {CFR_213}, {_CFR_213_CLASS}1 to {_CFR_213_CLASS}9"


def _validated(content: Mapping[str, Any], file: str) -> tuple[Limit, ...]:
    try:
        return _LimitFile.model_validate(content).limits
    except ValidationError as error:
        raise BadInputError("; ".join(_sentence(detail, file) for detail in error.errors())) from error


def _sentence(detail: ErrorDetails, file: str) -> str:
    """Say what is wrong where, in the words of this format."""
    loc: tuple[Any, ...] = detail["loc"]
    place = [file]
    if len(loc) > 1:
        place.append(f"entry {int(loc[1]) + 1}")
    if loc and isinstance(loc[-1], str):
        place.append(f"key {loc[-1]}")
    where = ", ".join(place)
    if detail["type"] == "extra_forbidden":
        keys = list(Limit.model_fields) if len(loc) > 1 else ["limits"]
        return f"{where}: unknown key; {expected_one_of(keys, str(loc[-1]))}"
    if detail["type"] == "missing":
        return f"{where}: required key is missing"
    if detail["type"] == "value_error":
        return f"{where}, {detail['msg'].removeprefix('Value error, ')}"
    return f"{where}: is {str(detail.get('input'))[:60]!r}; expected {detail['msg'].removeprefix('Input should be ')}"
