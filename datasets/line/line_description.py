"""A line written by hand: TOML, format ``trackfg-line/1`` (docs/line-files.md).

Lengths and chainages are along the track. A transition takes curvature and cant from its neighbours, both by the same
law; where two transitions meet, the track is straight and without cant. The middle of a vertical curve is at the
chainage of its gradient point.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from trackfg.datasets.line.alignment import LONGEST_M, SMALLEST_RADIUS_M, Element, Law, piecewise, ramp_law
from trackfg.datasets.line.line import GivenLine, Line
from trackfg.datasets.line.vertical_profile import STEEPEST
from trackfg.errors import BadInputError
from trackfg.files.small_file import read_toml
from trackfg.numerics import units
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Angle, Length
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.recording.strict_model import Model

FORMAT = "trackfg-line/1"
_SMALLEST_VERTICAL_RADIUS_M = 100.0
"""A smaller radius of a vertical curve is taken for an error, m."""

TransitionLaw = Literal["clothoid", "half-sine", "sine", "bloss", "helmert", "cubic-parabola"]


Chainage = Annotated[float, Field(strict=True, ge=-1e7, le=1e7)]
"""m: longer than any railway."""
ElementLength = Annotated[float, Field(strict=True, gt=0)]
"""m."""


class Straight(Model):
    """A straight, without cant."""

    type: Literal["straight"]
    length_m: ElementLength


class CurveElement(Model):
    """A circle. Its side is the radius's sign (left positive) or ``turn``. ``cant_mm`` raises the outer rail."""

    type: Literal["curve"]
    length_m: ElementLength
    radius_m: float
    turn: Literal["left", "right"] | None = None
    cant_mm: Annotated[float, Field(strict=True, ge=-1000, le=1000)] = 0.0

    @model_validator(mode="after")
    def _radius_is_usable(self) -> CurveElement:
        if abs(self.radius_m) < SMALLEST_RADIUS_M:
            raise ValueError(f"radius_m is {self.radius_m:g}: expected at least {SMALLEST_RADIUS_M:g} m")
        if self.turn is not None and self.radius_m < 0:
            raise ValueError(f"radius_m is {self.radius_m:g} and turn is given: expected a sign or a turn, not both")
        return self

    @property
    def curvature(self) -> float:
        """Return the curvature, 1/m, left positive."""
        return -1.0 / self.radius_m if self.turn == "right" else 1.0 / self.radius_m

    @property
    def cant_m(self) -> float:
        """Return the cant, m, left rail higher positive."""
        return float(-np.sign(self.curvature)) * 1e-3 * self.cant_mm


class Transition(Model):
    """A transition leads between its neighbours' curvatures and cants."""

    type: Literal["transition"]
    length_m: ElementLength
    law: TransitionLaw = "clothoid"


class Gradient(Model):
    """The track climbs from ``chainage_m`` on, by ``permille``; a circle of ``vertical_radius_m`` leads to it."""

    chainage_m: Chainage
    permille: Annotated[float, Field(ge=-1e3 * STEEPEST, le=1e3 * STEEPEST)]
    vertical_radius_m: Annotated[float, Field(ge=_SMALLEST_VERTICAL_RADIUS_M)] | None = None


class SpeedLimit(Model):
    """The limit holds from ``chainage_m`` on."""

    chainage_m: Chainage
    kmh: Annotated[float, Field(strict=True, gt=0, le=1000)]


class Station(Model):
    """A stopping place."""

    name: str
    chainage_m: Chainage


class LineDescription(Model):
    """All of the file."""

    format: Literal["trackfg-line/1"]
    id: str
    gauge_m: Length = 1.435
    cross_level_base_m: Length = 1.5
    start_chainage_m: Chainage = 0.0
    heading_deg: Angle = 90.0
    speed_limit: Annotated[tuple[SpeedLimit, ...], Field(min_length=1)]
    station: tuple[Station, ...] = ()
    element: Annotated[
        tuple[Annotated[Straight | CurveElement | Transition, Field(discriminator="type")], ...], Field(min_length=1)
    ]
    gradient: tuple[Gradient, ...] = ()
    kilometrage: LineKilometrage | None = None


def read_line(path: Path | str) -> GivenLine:
    """Return the line that a TOML file describes.

    A jump of the curvature is in the remarks; a jump of the cant is an error. Raises :class:`BadInputError` naming
    the file, the element by its number, and what was expected.
    """
    path = Path(path)
    try:
        description = LineDescription.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInputError(f"{path}: " + "; ".join(_sentence(detail) for detail in error.errors())) from error
    try:
        return line_from(description)
    except ValueError as error:
        raise BadInputError(f"{path}: {error}") from error


def line_from(description: LineDescription) -> GivenLine:
    """Return the line of a description; its kilometrage ends with the line, and has its name where it has none.

    Raises ``ValueError`` naming the part and what was expected.
    """
    curvature, cant = _plan(description)
    edges = np.concatenate([[0.0], np.cumsum([element.length_m for element in curvature])])
    length = float(edges[-1])
    origin = description.start_chainage_m
    if length > LONGEST_M:
        raise ValueError(f"the elements are {1e-3 * length:g} km long: expected at most {1e-3 * LONGEST_M:g} km")

    limit_from = _places("speed_limit", [limit.chainage_m for limit in description.speed_limit], origin, length)
    if limit_from[0] != 0.0:
        raise ValueError(
            f"speed_limit 1: chainage_m is {limit_from[0] + origin:g}: expected the line's start, {origin:g}"
        )
    stations = _places("station", [station.chainage_m for station in description.station], origin, length)
    line = Line(
        curvature=piecewise(curvature),
        cant=piecewise(cant),
        grade=piecewise(_grade(description, length)),
        length_m=length,
        cross_level_base_m=description.cross_level_base_m,
        limit_from_m=limit_from,
        limit_mps=np.array([limit.kmh for limit in description.speed_limit]) * units.KMH,
        stations_m=stations,
        start_yaw_rad=float(np.radians(90.0 - description.heading_deg)),
    )
    remarks = tuple(
        f"the curvature jumps by {following.start - previous.end:+.3g} 1/m between elements {number} and {number + 1} "
        f"(chainage {origin + edge:.3f} m)"
        for number, (edge, (previous, following)) in enumerate(
            zip(edges[1:-1], itertools.pairwise(curvature), strict=True), start=1
        )
        if previous.end != following.start
    )
    kilometrage = _kilometrage(description, origin + length)
    return GivenLine(description.id, line, description.gauge_m, origin, remarks, kilometrage)


def _kilometrage(description: LineDescription, end: float) -> LineKilometrage | None:
    given = description.kilometrage
    if given is None:
        return None
    last = max((entry.chainage_m for entry in (*given.equation, *given.post)), default=-np.inf)
    if last >= end:
        raise ValueError(f"kilometrage: chainage_m is {last:g}: expected one before the line's end, {end:g}")
    end = end if given.end_chainage_m is None else given.end_chainage_m
    return given.model_copy(update={"line": given.line or description.id, "end_chainage_m": end})


def _plan(description: LineDescription) -> tuple[list[Element], list[Element]]:
    """Return elements of curvature and of cant."""
    parts = description.element
    highest = 0.5e3 * description.cross_level_base_m
    curvature: list[Element] = []
    cant: list[Element] = []
    for number, part in enumerate(parts, start=1):
        if isinstance(part, Transition):
            if number in (1, len(parts)):
                raise ValueError(
                    f"element {number}: a transition at an end of the line: expected a straight or a curve"
                )
            start, end = _own(parts[number - 2]), _own(parts[number])
            law: Law = "linear" if part.law == "clothoid" else part.law
            changes = law if start[0] != end[0] else "constant"
            ramps = ramp_law(law) if start[1] != end[1] else "constant"
        else:
            start = end = _own(part)
            changes = ramps = "constant"
            if abs(start[1]) * 1e3 >= highest:
                raise ValueError(f"element {number}: cant_mm is {1e3 * abs(start[1]):g}: expected below {highest:g}")
        try:
            curvature.append(Element(changes, part.length_m, start[0], end[0]))
        except ValueError as error:
            raise ValueError(f"element {number}: {error}") from error
        cant.append(Element(ramps, part.length_m, start[1], end[1]))
    for number, (left, right) in enumerate(itertools.pairwise(cant), start=1):
        if left.end != right.start:
            jump = 1e3 * abs(right.start - left.end)
            raise ValueError(
                f"elements {number} and {number + 1}: the cant jumps by {jump:g} mm: expected a transition"
            )
    return curvature, cant


def _own(part: Straight | CurveElement | Transition) -> tuple[float, float]:
    """Return curvature and cant that an element has by itself; those between two transitions are zero."""
    return (part.curvature, part.cant_m) if isinstance(part, CurveElement) else (0.0, 0.0)


def _grade(description: LineDescription, length: float) -> list[Element]:
    """Return elements of the gradient's angle."""
    points = description.gradient
    if not points:
        return [Element("constant", length, 0.0, 0.0)]
    places = _places("gradient", [point.chainage_m for point in points], description.start_chainage_m, length)
    if places[0] != 0.0 or points[0].vertical_radius_m is not None:
        start = description.start_chainage_m
        raise ValueError(f"gradient 1: expected it at the line's start, {start:g}, and without vertical_radius_m")
    gamma = np.arctan([1e-3 * point.permille for point in points])
    elements: list[Element] = []
    place = 0.0
    for number, (point, middle) in enumerate(zip(points[1:], places[1:], strict=True), start=2):
        angle, next_angle = float(gamma[number - 2]), float(gamma[number - 1])
        if angle == next_angle:
            continue
        if point.vertical_radius_m is None:
            raise ValueError(f"gradient {number}: vertical_radius_m is missing: expected it where the gradient changes")
        half = 0.5 * point.vertical_radius_m * abs(next_angle - angle)
        if middle - half < place:
            what = "the vertical curve before it ends" if elements else "the line begins"
            problem = f"gradient {number}: its vertical curve begins {place - middle + half:.3f} m before {what}"
            raise ValueError(f"{problem}: expected vertical curves that do not overlap")
        if middle + half > length:
            raise ValueError(
                f"gradient {number}: its vertical curve ends {middle + half - length:.3f} m after the line"
            )
        if middle - half > place:
            elements.append(Element("constant", middle - half - place, angle, angle))
        elements.append(Element("linear", 2.0 * half, angle, next_angle))
        place = middle + half
    if place < length:
        elements.append(Element("constant", length - place, float(gamma[-1]), float(gamma[-1])))
    return elements


def _places(what: str, chainages: list[float], origin: float, length: float) -> Array:
    """Return arc lengths of places that must increase and lie on the line. Shape (n,)."""
    places = np.array(chainages, dtype=np.float64) - origin
    for number, (chainage, place) in enumerate(zip(chainages, places, strict=True), start=1):
        if not 0.0 <= place <= length:
            wish = f"expected one on the line, {origin:g} to {origin + length:g}"
            raise ValueError(f"{what} {number}: chainage_m is {chainage:g}: {wish}")
        if number > 1 and place <= places[number - 2]:
            raise ValueError(f"{what} {number}: chainage_m is {chainage:g}: expected more than the one before it")
    return places


def _sentence(detail: ErrorDetails) -> str:
    """Return what pydantic found, as ``element 3, radius_m: ...``."""
    words: list[str] = []
    location = [step for step in detail["loc"] if step not in ("straight", "curve", "transition")]
    for step in location:
        if isinstance(step, int) and words:
            words[-1] += f" {step + 1}"
        else:
            words.append(str(step))
    kind, given = detail["type"], detail.get("input")
    message = detail["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    if kind == "extra_forbidden":
        message = "unknown key: remove it or correct it"
    elif kind == "missing":
        message = "required key is missing"
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        message = "type: expected 'straight', 'curve' or 'transition'"
    elif not isinstance(given, dict | list | tuple):
        message = f"is {given!r}: {message[:1].lower()}{message[1:]}"
    return ", ".join(words) + f": {message}"
