"""``StaEquation`` of LandXML: where stations do not go on, as kilometrage over the chainage.

A station, ``staStart`` plus the length along the plan, is the kilometrage until an equation: from ``staInternal``, a
station without equations, on it counts from ``staAhead``, up or, with ``staIncrement`` "decreasing", down. An
equation of Inframodel is a kilometre post instead: at ``staInternal`` stands the post of kilometre ``desc``.

Kilometrage is measured in plan, chainage along the track in space. On a gradient g there are ``cos(atan g)`` metres of
the one to one of the other; vertical curves are cut into pieces so short that this is right to 0.1 mm.
"""

from __future__ import annotations

import re

import numpy as np

from trackfg.datasets.line.landxml_file import Node, Units
from trackfg.datasets.line.plan_alignment import PlanAlignment
from trackfg.numerics.arrays import Array
from trackfg.recording.line_kilometrage import Direction, KmEquation, KmScale, LineKilometrage, PlacedKm

_PLAN_M = 1e-4
"""Largest error of kilometrage from vertical curves, m: a tenth of what files give."""
_SAME_STATION_M = 0.01
"""Stations that differ by less are one, m: files give centimetres."""
_LEVEL = 1e-9
"""A scale that differs from 1 by less makes 1 mm in 1000 km."""


def read_kilometrage(
    alignment: Node, units: Units, plan: PlanAlignment, station_start_m: float, *, inframodel: bool
) -> tuple[LineKilometrage, list[str]]:
    """Return the kilometrage of an ``Alignment`` over chainage, which is ``station_start_m`` plus the length in space,
    and remarks.

    Raises :class:`trackfg.errors.BadInputError`.
    """
    remarks: list[str] = []
    nodes = [
        node.named(f"{alignment.what}, StaEquation {number}")
        for number, node in enumerate(alignment.children("StaEquation"), start=1)
    ]
    internal = np.array([node.number("staInternal") * units.length_m for node in nodes])
    order = np.argsort(internal, kind="stable")
    if np.any(np.diff(order) < 0):
        remarks.append("the station equations (StaEquation) are not in order: they are taken in order of staInternal")
    within = [i for i in order.tolist() if internal[i] < station_start_m + plan.length_m]
    if len(within) < len(nodes):
        beyond = len(nodes) - len(within)
        remarks.append(f"{beyond} station equation(s) (StaEquation) beyond the end of the plan: not used")
    twice = [i for i, previous in zip(within[1:], within, strict=False) if internal[i] == internal[previous]]
    if twice:
        raise nodes[twice[0]].error("another one has the same staInternal: expected one equation at a place")
    chainage = station_start_m + _in_space(plan, internal - station_start_m)
    places = [(nodes[i], float(internal[i]), float(chainage[i])) for i in within]
    end = station_start_m + float(plan.space_at(np.array(plan.length_m)))
    posts = _posts(places, remarks) if inframodel else ()
    equations = () if posts else _equations([] if inframodel else places, station_start_m, units, remarks)
    name, group = alignment.text("name") or "", str(alignment.element.getparent().get("name") or "").strip()
    line = LineKilometrage(
        line=group if inframodel and group else name,
        track=name if inframodel and group else "",
        end_chainage_m=end,
        equation=equations,
        post=posts,
        scale=_scales(plan, station_start_m),
    )
    return line, remarks


def _equations(
    places: list[tuple[Node, float, float]], station_start_m: float, units: Units, remarks: list[str]
) -> tuple[KmEquation, ...]:
    equations = [KmEquation(chainage_m=station_start_m, km=_exact(station_start_m), direction="ascending")]
    station, official, rate = station_start_m, station_start_m, 1.0
    for node, internal, chainage in places:
        back, ahead = node.text("staBack"), node.number("staAhead") * units.length_m
        official += rate * (internal - station)
        if back is not None and abs(node.number("staBack") * units.length_m - official) > _SAME_STATION_M:
            remarks.append(f"{node.what}: staBack is {back}, the station there is {official:.3f} m: this is used")
        rate = -1.0 if node.text("staIncrement") == "decreasing" else 1.0
        station, official = internal, ahead
        direction: Direction = "ascending" if rate > 0.0 else "descending"
        if internal <= station_start_m:
            equations.clear()
        equations.append(KmEquation(chainage_m=chainage, km=_exact(ahead), direction=direction))
    return tuple(equations)


def _posts(places: list[tuple[Node, float, float]], remarks: list[str]) -> tuple[PlacedKm, ...]:
    posts: list[PlacedKm] = []
    for node, _, chainage in places:
        number = re.fullmatch(r"\s*(?:km\s*)?0*(\d+)\s*", node.text("desc") or "", re.IGNORECASE)
        if number is None:
            remarks.append(f"{node.what}: desc is {node.text('desc')!r}, no kilometre: this post is not used")
        elif posts and posts[-1].km == number[1]:
            remarks.append(f"{node.what}: the post before has kilometre {number[1]} too: this one is not used")
        else:
            posts.append(PlacedKm(chainage_m=chainage, km=number[1]))
    return tuple(posts)


def _in_space(plan: PlanAlignment, place: Array) -> Array:
    """Return the length in space at places of the plan, and as long beyond its ends as in plan."""
    inside = np.clip(place, 0.0, plan.length_m)
    return np.asarray(plan.space_at(inside) + place - inside) if len(place) else place


def _scales(plan: PlanAlignment, station_start_m: float) -> tuple[KmScale, ...]:
    edges = [np.zeros(1)]
    for piece in plan.profile:
        # Over a chord of length h the length in space is off by h^2/8 times the change of 1/cos, about |g dg/dp|.
        bend = max(abs(piece.start), abs(piece.end)) * abs(piece.end - piece.start) / piece.length_m
        cells = max(1, int(np.ceil(piece.length_m * np.sqrt(bend / (8.0 * _PLAN_M)))))
        edges.append(piece.plan_m + piece.length_m * np.arange(1, cells + 1) / cells)
    places = np.concatenate(edges)
    space = plan.space_at(places)
    scale = np.diff(places) / np.diff(space)
    if np.all(np.abs(scale - 1.0) < _LEVEL):
        return ()
    changes = np.flatnonzero(np.append(True, np.abs(np.diff(scale)) > _LEVEL))
    return tuple(KmScale(chainage_m=station_start_m + float(space[i]), scale=float(scale[i])) for i in changes)


def _exact(official_m: float) -> str:
    """Return an official place as text with all its digits."""
    return np.format_float_positional(official_m / 1000.0, trim="-")
