"""``Cant`` of LandXML: the cant over the plan, and the gauge.

``appliedCant`` (millimetres, or inches in Imperial files) raises the outer rail of the ``curvature`` that the station
names; with ``adverse`` the inner one. Between stations cant follows the ``transitionType`` of the first; without one,
the law of the spiral that spans the same stretch; else it is linear. Beyond the stations it stays as it is at the
nearest; stations beyond the plan count for what lies on it. ``equilibriumCant``, deficiencies, rates and speeds are not
used.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from trackfg.datasets.line.alignment import Element, Law, piecewise, ramp_law
from trackfg.datasets.line.landxml_file import Node, Units
from trackfg.datasets.line.landxml_plan import SPIRALS
from trackfg.numerics.arrays import Array

SAME_PLACE_M = 0.01
"""Places of a file that differ by less are one, m: files give centimetres."""
_SAME_CANT_M = 1e-6
"""Cants at one place that differ by less are one, m."""
_WIDEST_GAUGE_M = 10.0
"""A gauge that would be wider is in the unit of the cant, m."""


@dataclass(frozen=True)
class Cant:
    """``elements`` (m over plan, left rail higher positive) span the plan from ``from_m`` on, which is 0 unless
    stations lie before the plan; ``gauge_m`` is None without ``Cant``.
    """

    elements: tuple[Element, ...]
    gauge_m: float | None
    remarks: tuple[str, ...]
    from_m: float = 0.0

    def over_plan(self) -> PPoly:
        """Return the cant as a function of the length along the plan."""
        function = piecewise(self.elements)
        return PPoly(function.c, function.x + self.from_m, extrapolate=True)


@dataclass(frozen=True)
class _Station:
    node: Node
    plan_m: float
    cant_m: float


def read_cant(alignment: Node, units: Units, plan: tuple[Element, ...], station_start_m: float) -> Cant:
    """Return the cant of an ``Alignment`` whose plan has these elements. Raises
    :class:`trackfg.errors.BadInputError`.
    """
    edges = np.concatenate([[0.0], np.cumsum([element.length_m for element in plan])])
    length = float(edges[-1])
    node = alignment.child("Cant")
    if node is None:
        return Cant((Element("constant", length, 0.0, 0.0),), None, ())
    gauge = node.number("gauge", above=0.0)
    # In the linear unit by the schema, but many a file has it in the unit of cant.
    gauge *= units.cant_m if gauge * units.length_m > _WIDEST_GAUGE_M else units.length_m
    stations = _stations(node, alignment.what, units, station_start_m, length)
    if not stations:
        return Cant((Element("constant", length, 0.0, 0.0),), gauge, ())

    elements: list[Element] = []
    first, last = stations[0], stations[-1]
    if first.plan_m > 0.0:
        elements.append(Element("constant", first.plan_m, first.cant_m, first.cant_m))
    for station, next_station in itertools.pairwise(stations):
        law = (
            "constant"
            if station.cant_m == next_station.cant_m
            else _ramp(station.node, edges, plan, station, next_station)
        )
        elements.append(Element(law, next_station.plan_m - station.plan_m, station.cant_m, next_station.cant_m))
    if last.plan_m < length:
        elements.append(Element("constant", length - last.plan_m, last.cant_m, last.cant_m))

    remarks = _beyond(stations, length)
    if (first.plan_m > SAME_PLACE_M and first.cant_m) or (last.plan_m < length - SAME_PLACE_M and last.cant_m):
        remarks.append("cant is not zero at the first or last CantStation: it is kept to the end of the alignment")
    if node.text("rotationPoint") not in (None, "center"):
        point = node.text("rotationPoint")
        remarks.append(f"cant turns about {point}: heights of the profile are taken for the centre line's all the same")
    return Cant(tuple(elements), gauge, tuple(remarks), min(first.plan_m, 0.0))


def _beyond(stations: list[_Station], length: float) -> list[str]:
    """Return the remark on stations beyond the plan.

    Raises :class:`trackfg.errors.BadInputError` where all are and yet say that the plan has cant.
    """
    off = [max(-station.plan_m, station.plan_m - length, 0.0) for station in stations]
    number = sum(distance > 0.0 for distance in off)
    if number == 0:
        return []
    if number == len(stations) and any(station.cant_m for station in stations):
        wish = f"expected some on the plan, 0 to {length:.3f} m"
        raise stations[0].node.error(f"its station is {stations[0].plan_m:.3f} m from the start of the plan: {wish}")
    return [f"{number} CantStation(s) beyond the plan, by up to {max(off):.3f} m: the cant on the plan is used"]


def _stations(node: Node, alignment: str, units: Units, station_start_m: float, length: float) -> list[_Station]:
    """Return stations at increasing places; of two at one place, which must agree, the first."""
    stations: list[_Station] = []
    for number, child in enumerate(node.children("CantStation"), start=1):
        at = child.named(f"{alignment}, CantStation {number}")
        place = at.number("station") * units.length_m - station_start_m
        for edge in (0.0, length):
            place = edge if abs(place - edge) <= SAME_PLACE_M else place
        cant = _signed_cant(at, units)
        ahead = place - stations[-1].plan_m if stations else np.inf
        if ahead < -SAME_PLACE_M:
            raise at.error("its station is before that of the one before it: expected increasing stations")
        if ahead >= SAME_PLACE_M:
            stations.append(_Station(at, place, cant))
        elif abs(cant - stations[-1].cant_m) > _SAME_CANT_M:
            jump = 1e3 * (cant - stations[-1].cant_m)
            raise at.error(f"the height of the left rail over the right one jumps by {jump:+.1f} mm: expected a ramp")
    return stations


def _signed_cant(node: Node, units: Units) -> float:
    applied = node.number("appliedCant") * units.cant_m
    if applied == 0.0:
        return 0.0
    outer_is_left = node.choice("curvature", ("cw", "ccw")) == "cw"
    adverse = node.text("adverse") in ("true", "1")
    return applied if outer_is_left != adverse else -applied


def _ramp(node: Node, edges: Array, plan: tuple[Element, ...], start: _Station, end: _Station) -> Law:
    if node.text("transitionType") is not None:
        kind = node.choice("transitionType", ("linear", *SPIRALS))
        return "linear" if kind == "linear" else ramp_law(SPIRALS[kind])
    i = int(np.argmin(np.abs(edges[:-1] - start.plan_m)))
    off = abs(edges[i] - start.plan_m), abs(edges[i + 1] - end.plan_m)
    return ramp_law(plan[i].law) if max(off) < SAME_PLACE_M and plan[i].law != "constant" else "linear"
