"""``CoordGeom`` of LandXML: lines, curves and spirals, and what the coordinates in the file say against them.

The elements' types, lengths and radii make the alignment; of the coordinates only the first point and the direction of
the first element are used. Where the others disagree with the elements by more than 1 cm, a remark says so. A centre
counts by what it does to the arc: that of a flat one is far away, and a file gives it to few digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.datasets.line.alignment import LONGEST_M, SMALLEST_RADIUS_M, Element, Law, piecewise
from trackfg.datasets.line.landxml_file import Node
from trackfg.datasets.line.line import Line, piecewise_linear
from trackfg.numerics.arrays import Array

SPIRALS: dict[str, Law] = {
    "clothoid": "linear",
    "bloss": "bloss",
    "cosine": "half-sine",
    "sineHalfWave": "half-sine",
    "sinusoid": "sine",
    "biquadratic": "helmert",
    "biquadraticParabola": "helmert",
    "cubicParabola": "cubic-parabola",
    "japaneseCubic": "cubic-parabola",
}
_NEAR = {"sineHalfWave": "half-sine", "biquadraticParabola": "Helmert"}
"""Types whose law holds over the tangent; here it is taken over the arc."""

_ELEMENTS = ("Line", "Curve", "Spiral")
_OFF_M = 0.01
"""By how much points of the file may be off the elements before that is remarked on, m."""


@dataclass(frozen=True)
class CoordGeom:
    """Elements (curvature over plan, m), the start (north, east, m), the heading there (counter-clockwise from east)
    and remarks."""

    elements: tuple[Element, ...]
    start_m: Array
    start_yaw_rad: float
    remarks: tuple[str, ...]

    def points(self, step_m: float) -> Array:
        """Return east and north (n, 2), m, of points along the plan that are at most ``step_m`` apart."""
        line = _flat(self.elements, self.start_yaw_rad)
        steps = max(int(np.ceil(line.length_m / step_m)), 1)
        return np.asarray(self.start_m[::-1] + line.position(np.linspace(0.0, line.length_m, steps + 1))[:, :2])


@dataclass(frozen=True)
class _Points:
    """Complex east + i north of an element, as far as the file has them, m."""

    start: complex | None
    end: complex | None
    centre: complex | None
    pi: complex | None


def read_coord_geom(node: Node, scale: float) -> CoordGeom:
    """``node`` is the ``CoordGeom``; ``scale`` is metres per unit. Raises :class:`trackfg.errors.BadInputError`."""
    elements: list[Element] = []
    points: list[_Points] = []
    names: list[str] = []
    remarks: list[str] = []
    near: dict[str, list[str]] = {}
    named = _named_points(node)
    for number, child in enumerate(node.children(), start=1):
        if child.tag == "Feature":
            continue
        place = child.named(f"{node.what} element {number} ({child.tag})")
        at = _Points(*(_point(place, tag, scale, named) for tag in ("Start", "End", "Center", "PI")))
        if child.tag in _ELEMENTS and place.is_zero("length"):
            remarks.append(f"element {number} ({child.tag}): its length is 0: it is left out")
            continue
        elements.append(_element(place, at, scale))
        points.append(at)
        names.append(f"element {number} ({child.tag})")
        if (kind := child.text("spiType")) in _NEAR:
            near.setdefault(kind, []).append(names[-1])
    for kind, those in near.items():
        more = f", here and {len(those) - 1} times more" if len(those) > 1 else ""
        remarks.append(f"{those[0]}: {kind} is read as the {_NEAR[kind]} curve: its law over the arc{more}")
    if not elements:
        raise node.error("has no elements: expected Line, Curve or Spiral with a length")
    total = sum(element.length_m for element in elements)
    if total > LONGEST_M:
        raise node.error(f"its elements are {1e-3 * total:g} km long: expected at most {1e-3 * LONGEST_M:g} km")
    first = points[0]
    direction = _direction(elements[0], first)
    if first.start is None or direction is None:
        raise node.error(f"{names[0]} has no direction: expected coordinates of its Start and End")
    yaw = float(np.angle(direction))
    remarks += _disagreements(elements, points, names, yaw)
    return CoordGeom(tuple(elements), np.array([first.start.imag, first.start.real]), yaw, tuple(remarks))


def _element(node: Node, at: _Points, scale: float) -> Element:
    length = node.optional_number("length", above=0.0)
    if node.tag == "Line":
        if length is None and at.start is not None and at.end is not None:
            length = abs(at.end - at.start) / scale
        return _checked(node, "constant", length, 0.0, 0.0, scale)
    if node.tag not in _ELEMENTS:
        raise node.error("cannot be read: expected Line, Curve or Spiral")
    side = 1.0 if node.choice("rot", ("cw", "ccw")) == "ccw" else -1.0
    if node.tag == "Spiral":
        law = SPIRALS[node.choice("spiType", tuple(SPIRALS))]
        ends = [side * node.curvature(name) / scale for name in ("radiusStart", "radiusEnd")]
        return _checked(node, law, length, ends[0], ends[1], scale)
    radius = node.optional_number("radius", above=0.0)
    if radius is None and at.start is not None and at.centre is not None:
        radius = abs(at.start - at.centre) / scale
    if radius is None or radius == 0.0:
        raise node.error("radius is missing: expected it, or coordinates of Start and Center")
    if length is None and at.start is not None and at.centre is not None and at.end is not None:
        turn = side * np.angle((at.end - at.centre) / (at.start - at.centre))
        length = radius * float(turn % (2 * np.pi))
    elif length is None and at.start is not None and at.end is not None:
        # Of the two arcs over a chord the shorter one: no element of a railway turns by half a circle.
        length = 2.0 * radius * float(np.arcsin(min(abs(at.end - at.start) / scale / (2.0 * radius), 1.0)))
    return _checked(node, "constant", length, side / radius / scale, side / radius / scale, scale)


def _checked(node: Node, law: Law, length: float | None, start: float, end: float, scale: float) -> Element:
    if length is None:
        raise node.error("length is missing: expected a number above 0")
    if max(abs(start), abs(end)) > 1.0 / SMALLEST_RADIUS_M:
        raise node.error(f"its radius is below {SMALLEST_RADIUS_M:g} m: expected a greater one, in the file's unit")
    try:
        return Element(law if start != end else "constant", length * scale, start, end)
    except ValueError as error:
        raise node.error(str(error)) from error


def _named_points(node: Node) -> dict[str, Node]:
    """Return the points of the whole file by name, where elements refer to some."""
    if not any("pntRef" in point.attrib for point in node.element.iter()):
        return {}
    return {point.text("name") or "": point for point in node.everywhere("CgPoint")}


def _point(node: Node, tag: str, scale: float, named: dict[str, Node]) -> complex | None:
    """LandXML writes northing before easting. None where the point is absent."""
    child = node.child(tag)
    reference = None if child is None else child.text("pntRef")
    if child is not None and reference is not None:
        child = named.get(reference)
        if child is None:
            raise node.error(f"{tag} is the point {reference!r}, which is none of the file: expected a CgPoint")
    if child is None or not (child.element.text or "").strip():
        return None
    north, east = child.numbers(2)
    return scale * complex(east, north)


def _direction(element: Element, at: _Points) -> complex | None:
    """Return the tangent at an element's start."""
    if at.start is None:
        return None
    if at.pi is not None and element.law != "constant":
        return complex(at.pi - at.start)
    if at.centre is not None and element.start != 0.0:
        return (at.centre - at.start) * (-1j if element.start > 0.0 else 1j)
    if at.end is None:
        return None
    chord = _walk([element], 0.0)[0][-1]
    return complex((at.end - at.start) / chord)


def _flat(elements: Sequence[Element], yaw: float) -> Line:
    """Return a level line without cant of these elements."""
    length = float(np.sum([element.length_m for element in elements]))
    zero = piecewise_linear(np.array([0.0, length]), np.zeros(2))
    return Line(piecewise(elements), zero, zero, length, 1.0, np.zeros(1), np.ones(1), np.zeros(0), yaw)


def _walk(elements: Sequence[Element], yaw: float) -> tuple[Array, Array]:
    """Return complex places (n + 1,) and headings (n + 1,) of the ends of the elements."""
    edges = np.concatenate([[0.0], np.cumsum([element.length_m for element in elements])])
    line = _flat(elements, yaw)
    return line.position(edges)[:, :2] @ np.array([1.0, 1j]), line.yaw(edges)


def _disagreements(
    elements: Sequence[Element], points: Sequence[_Points], names: Sequence[str], yaw: float
) -> list[str]:
    remarks: list[str] = []
    places, headings = _walk(elements, yaw)
    origin = points[0].start or 0j
    previous: complex | None = None
    worst, first_off = 0.0, ""
    for i, (element, at, name) in enumerate(zip(elements, points, names, strict=True)):
        if previous is not None and at.start is not None and abs(at.start - previous) > _OFF_M:
            remarks.append(f"{name}: starts {abs(at.start - previous):.3f} m from the end of the element before it")
        previous = at.end
        if at.start is not None and at.end is not None:
            chord = abs(at.end - at.start) - abs(places[i + 1] - places[i])
            if abs(chord) > _OFF_M:
                remarks.append(f"{name}: its Start and End are {chord:+.3f} m further apart than its length says")
        expected = [(at.start, places[i]), (at.end, places[i + 1])]
        off = max([abs(point - origin - place) for point, place in expected if point is not None], default=0.0)
        if element.law == "constant" and element.start != 0.0 and at.centre is not None and at.start is not None:
            centre = (at.centre - at.start) * np.exp(-1j * headings[i]) * element.start
            turn = abs(element.start) * element.length_m
            radius = (abs(centre) - 1.0) / abs(element.start)
            # A longer radius flattens the arc, a turned one turns it: what either moves at its end.
            if abs(radius) * 0.5 * turn**2 > _OFF_M:
                remarks.append(f"{name}: its Start is {radius:+.3f} m further from its Center than its radius says")
            off = max(off, float(abs(np.angle(centre / 1j))) * element.length_m)
        if off > _OFF_M and not first_off:
            first_off = name
        worst = max(worst, float(off))
    if first_off:
        remarks.append(
            f"from {first_off} on, the file's coordinates are off the elements laid end to end, by up to {worst:.3f} m"
        )
    return remarks
