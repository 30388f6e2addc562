"""The alignment of one track from LandXML: plan, cant, profile and kilometrage.

* Plan: ``CoordGeom`` (:mod:`trackfg.datasets.line.landxml_plan`). Stations are lengths along the plan from
  ``staStart``.
* Kilometrage: ``StaEquation`` (:mod:`trackfg.datasets.line.landxml_kilometrage`).
* Cant: ``Cant`` (:mod:`trackfg.datasets.line.landxml_cant`).
* Profile: the first ``ProfAlign``: gradients between its points; ``CircCurve`` by its radius, ``ParaCurve`` by its
  length. Heights are taken for the centre line's, whatever the point that cant turns about.

``remarks`` lists where the file contradicts itself, and what was not used.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackfg.datasets.line.alignment import piecewise
from trackfg.datasets.line.landxml_cant import SAME_PLACE_M, read_cant
from trackfg.datasets.line.landxml_file import Node, Units, is_inframodel, open_landxml, read_units, version_remarks
from trackfg.datasets.line.landxml_kilometrage import read_kilometrage
from trackfg.datasets.line.landxml_plan import CoordGeom, read_coord_geom
from trackfg.datasets.line.line import Line
from trackfg.datasets.line.plan_alignment import PlanAlignment
from trackfg.datasets.line.vertical_profile import ProfilePiece, Vertex, profile
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.recording.line_kilometrage import LineKilometrage

_LENGTH_OFF_M = 1e-3
"""A header's length that differs by more from the elements' sum is remarked on, m."""
_DEFAULT_BASE_M = 1.5
"""Base of the cross-level where neither file nor caller gives one, m: standard gauge."""


@dataclass(frozen=True)
class LandXmlLine:
    """``line`` begins at its own origin, which is ``start_m`` (east, north, up) in the file's coordinates.

    ``plan`` has the same over the length in plan; the station of a place ``p`` of it is ``station_start_m + p``.
    ``gauge_m`` is that of the file's ``Cant``. Chainage is ``station_start_m`` plus the length along the line;
    ``kilometrage`` leads from it to the stations with the file's equations.
    """

    name: str
    line: Line
    plan: PlanAlignment
    station_start_m: float
    start_m: Array
    gauge_m: float | None
    remarks: tuple[str, ...]
    kilometrage: LineKilometrage


def read_landxml(
    path: Path | str, *, name: str | None = None, speed_limit_mps: float, cross_level_base_m: float | None = None
) -> LandXmlLine:
    """Return the alignment ``name``, or the only one, of a LandXML file.

    The file says nothing reliable about speed limits; ``speed_limit_mps`` holds for the whole line. Cant refers to
    ``cross_level_base_m``, or else to the gauge that the file's ``Cant`` names (1.5 m where it has none). Raises
    :class:`BadInputError` with file, line, element and what was expected.
    """
    root = open_landxml(path)
    units = read_units(root)
    node = _chosen(root, name)
    geometry = _plan_of(node, units)
    length = float(np.sum([element.length_m for element in geometry.elements]))
    remarks = [*version_remarks(root), *geometry.remarks]
    station = (node.optional_number("staStart") or 0.0) * units.length_m
    header = node.optional_number("length")
    if header is not None and abs(header * units.length_m - length) > _LENGTH_OFF_M:
        given = header * units.length_m
        remarks.insert(0, f"the header's length is {given:.3f} m, that of its elements {length:.3f} m: these are used")
    cant = read_cant(node, units, geometry.elements, station)
    remarks += cant.remarks
    pieces = _read_profile(node, units, station, length, remarks)
    plan = PlanAlignment(piecewise(geometry.elements), cant.over_plan(), pieces, length)
    kilometrage, of_stations = read_kilometrage(node, units, plan, station, inframodel=is_inframodel(root))
    remarks += of_stations
    base = cross_level_base_m or cant.gauge_m or _DEFAULT_BASE_M
    highest = max(max(abs(element.start), abs(element.end)) for element in cant.elements)
    if highest >= 0.5 * base:
        raise node.error(f"a cant of {1e3 * highest:g} mm over {base:g} m: expected it in millimetres or inches")
    line = plan.line(cross_level_base_m=base, start_yaw_rad=geometry.start_yaw_rad, speed_limit_mps=speed_limit_mps)
    start = np.array([geometry.start_m[1], geometry.start_m[0], pieces[0].height_m])
    return LandXmlLine(node.text("name") or "", line, plan, station, start, cant.gauge_m, tuple(remarks), kilometrage)


def read_plans(path: Path | str, *, name: str | None = None, step_m: float) -> tuple[dict[str, Array], str | None]:
    """Return the tracks of a LandXML file by name, and the EPSG code of its coordinates, None where it has none.

    A track is an alignment with a plan, of all or of one ``name``: east and north (n, 2), m, of points that are at most
    ``step_m`` apart. Raises :class:`BadInputError` with file, line, element and what was expected.
    """
    root = open_landxml(path)
    units = read_units(root)
    nodes = [_chosen(root, name)] if name is not None else [a for a in _alignments(root) if a.child("CoordGeom")]
    tracks: dict[str, Array] = {}
    for number, node in enumerate(nodes or [_chosen(root, None)], start=1):
        its_name = node.text("name") or str(number)
        if its_name in tracks:
            raise node.error(f"another one is named {its_name!r}: expected different names")
        tracks[its_name] = _plan_of(node.named(f"Alignment {its_name!r}"), units).points(step_m)
    system = root.child("CoordinateSystem")
    return tracks, None if system is None else system.text("epsgCode") or None


def _plan_of(node: Node, units: Units) -> CoordGeom:
    geometry = node.child("CoordGeom")
    if geometry is None:
        raise node.error("has no CoordGeom: expected the elements of the plan")
    return read_coord_geom(geometry.named(f"{node.what}, CoordGeom"), units.length_m)


def _alignments(root: Node) -> list[Node]:
    return [node for group in root.children("Alignments") for node in group.children("Alignment")]


def _chosen(root: Node, name: str | None) -> Node:
    nodes = _alignments(root)
    names = [node.text("name") or "" for node in nodes]
    chosen = [node for node, its in zip(nodes, names, strict=True) if name is None or its == name.strip()]
    if len(chosen) != 1:
        what = "has no Alignment" if not nodes else f"has {len(nodes)} alignments: " + ", ".join(map(repr, names))
        wish = "exactly one, or a choice by name" if name is None else f"exactly one named {name!r}"
        raise BadInputError(f"{root.file}: {what}: expected {wish}")
    return chosen[0].named(f"Alignment {chosen[0].text('name')!r}")


def _read_profile(
    node: Node, units: Units, station: float, length: float, remarks: list[str]
) -> tuple[ProfilePiece, ...]:
    profiles = [align for holder in node.children("Profile") for align in holder.children("ProfAlign")]
    if not profiles:
        remarks.append("there is no profile (ProfAlign): the line is level, at height 0")
        return (ProfilePiece(0.0, length, 0.0, 0.0, 0.0),)
    chosen = profiles[0].named(f"{node.what}, ProfAlign {profiles[0].text('name')!r}")
    if len(profiles) > 1:
        remarks.append(f"there are {len(profiles)} profiles: the first, {chosen.text('name')!r}, is used")
    vertices = [
        _vertex(child.named(f"point {number} ({child.tag})"), chosen, units, station)
        for number, child in enumerate(chosen.children(), start=1)
        if child.tag != "Feature"
    ]
    try:
        pieces = profile(vertices, length)
    except ValueError as error:
        raise chosen.error(str(error)) from error
    short = vertices[0].plan_m > SAME_PLACE_M or vertices[-1].plan_m < length - SAME_PLACE_M
    if short:
        remarks.append("the profile does not span the plan: its first and last gradients go on to the ends")
    corners = [b.plan_m for a, b in itertools.pairwise(pieces) if abs(a.end - b.start) > 1e-6]
    if corners:
        where = f"first at station {corners[0] + station:.3f} m"
        remarks.append(f"the gradient jumps at {len(corners)} point(s) without a vertical curve, {where}")
    return pieces


def _vertex(node: Node, parent: Node, units: Units, station: float) -> Vertex:
    at = node.named(f"{parent.what}, {node.what}")
    if node.tag not in ("PVI", "CircCurve", "ParaCurve"):
        raise at.error("cannot be read: expected PVI, CircCurve or ParaCurve")
    plan, height = (units.length_m * value for value in at.numbers(2))
    radius = length = None
    if node.tag == "CircCurve":
        radius = abs(at.number("radius")) * units.length_m
        if radius == 0.0:
            raise at.error("radius is 0: expected another number")
    elif node.tag == "ParaCurve":
        length = at.number("length", above=0.0) * units.length_m
    return Vertex(plan - station, height, node.what, radius, length)
