"""LandXML 1.2: one alignment of the curves that are found in the geometry, with cant.

The plan is straights, transitions and circles laid end to end; coordinates are the integral of that from where the
geometry begins. LandXML's spirals are named by their law. The profile is not written: a geometry table has gradients,
not the design's vertical curves.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.curves import find_curves
from trackfg.curves.transition_laws import TransitionLaw
from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.exporting.alignment_elements import AlignmentElement, alignment_elements
from trackfg.interchange.exporting.located_tables import located_geometry, origin_of, start_of
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.results.official_places import line_kilometrage
from trackfg.results.result import Result

_NAMESPACE = "http://www.landxml.org/schema/LandXML-1.2"

_SPIRALS: dict[TransitionLaw, str] = {
    "clothoid": "clothoid",
    "half-sine": "cosine",
    "sine": "sinusoid",
    "bloss": "bloss",
    "helmert": "biquadratic",
}
"""LandXML's names of the laws."""

_STEP_M = 0.05
"""Step of the integration of headings to coordinates, m: Simpson's rule errs by 1e-12 m in a circle of 100 m."""


class LandXml(ResultFormat):
    """The alignment of the run: chainage is the station."""

    key = "landxml"
    suffix = ".xml"
    title = "LandXML 1.2: the alignment of the curves found, with cant"
    takes = frozenset({"km"})
    needs_trajectory = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the alignment. Raises :class:`BadInputError` where the result has no geometry, or no places of it."""
        measured = result.geometry_for("landxml")
        geometry = located_geometry(result).dropna(subset=["east_m", "north_m"])
        if len(geometry) < 2:
            raise BadInputError(
                f"{result.summary.recording_id}: its trajectory and its geometry have no two places in common; "
                f"expected them for {self.key}. Hint: csv, channels and xlsx need none"
            )
        conventions = result.summary.geometry
        curves = find_curves(measured, base_m=conventions.curvature_base_m)
        start, end = float(geometry["chainage_m"].iloc[0]), float(geometry["chainage_m"].iloc[-1])
        elements = alignment_elements(curves, start, end)
        first = geometry[["north_m", "east_m"]].to_numpy()
        ahead = first[min(len(first) - 1, round(2.0 / conventions.step_m))] - first[0]
        heading = float(np.arctan2(ahead[0], ahead[1]))
        root = _document(result)
        extent = {"staStart": f"{start:.6f}", "length": f"{sum(element.length_m for element in elements):.6f}"}
        alignment = _child(_child(root, "Alignments"), "Alignment", name=result.summary.recording_id, **extent)
        _plan(_child(alignment, "CoordGeom"), elements, complex(first[0, 1], first[0, 0]), heading)
        if options.km:
            _equations(alignment, line_kilometrage(result).kilometrage(), start, end)
        _cant(alignment, elements, start, conventions.gauge_m)
        library("lxml.etree", "xml").ElementTree(root).write(
            str(path), xml_declaration=True, encoding="utf-8", pretty_print=True
        )


def _document(result: Result) -> Any:
    """Return the root of a document with its date, units and coordinate system."""
    root = library("lxml.etree", "xml").Element(f"{{{_NAMESPACE}}}LandXML", nsmap={None: _NAMESPACE}, version="1.2")
    date = start_of(result) or pd.Timestamp(0)  # the schema wants one
    root.set("date", f"{date:%Y-%m-%d}")
    root.set("time", f"{date:%H:%M:%S}")
    metric = {"linearUnit": "meter", "areaUnit": "squareMeter", "volumeUnit": "cubicMeter"}
    metric |= {"angularUnit": "radians", "temperatureUnit": "celsius", "pressureUnit": "HPA"}
    _child(_child(root, "Units"), "Metric", **metric)
    if (origin := origin_of(result)) is not None:
        where = "{:.9f}, longitude {:.9f} (WGS 84)".format(*origin[:2])
        _child(root, "CoordinateSystem", name="local", desc=f"north and east, m, from latitude {where}")
    return root


def _equations(alignment: Any, kilometrage: Kilometrage, start: float, end: float) -> None:
    """Write a station equation where the alignment begins and where kilometrage jumps on it."""
    jumps = [jump.chainage_m for jump in kilometrage.jumps if start < jump.chainage_m < end]
    places = np.array([start, *jumps])
    for place, official, up in zip(places, kilometrage.official_m(places), kilometrage.ascends(places), strict=True):
        ways = {"staIncrement": "increasing" if up else "decreasing"}
        _child(alignment, "StaEquation", staInternal=f"{place:.6f}", staAhead=f"{official:.6f}", **ways)


def _child(parent: Any, tag: str, text: str | None = None, **attributes: str) -> Any:
    child = library("lxml.etree", "xml").SubElement(parent, f"{{{_NAMESPACE}}}{tag}", **attributes)
    child.text = text
    return child


def _plan(node: Any, elements: list[AlignmentElement], place: complex, heading: float) -> None:
    """Write the elements with their ends; LandXML has northing before easting."""
    from scipy.integrate import simpson  # late: other formats need none of what it imports

    for element in elements:
        count = 2 * max(1, int(np.ceil(element.length_m / (2 * _STEP_M)))) + 1
        x = np.linspace(0.0, element.length_m, count)
        headings = heading + element.headings(x)
        end = place + complex(simpson(np.exp(1j * headings), x=x))
        length = f"{element.length_m:.6f}"
        rot = "ccw" if element.start + element.end > 0.0 else "cw"
        if element.start == element.end == 0.0:
            child = _child(node, "Line", length=length)
        elif element.start == element.end:
            child = _child(node, "Curve", rot=rot, length=length, radius=f"{1.0 / abs(element.start):.6f}")
        else:
            ends = {"radiusStart": element.start, "radiusEnd": element.end}
            radii = {name: "INF" if k == 0.0 else f"{1.0 / abs(k):.6f}" for name, k in ends.items()}
            child = _child(node, "Spiral", spiType=_SPIRALS[element.law], rot=rot, length=length, **radii)
        _child(child, "Start", _point(place))
        if child.tag.endswith("Curve"):
            _child(child, "Center", _point(place + 1j * np.exp(1j * heading) / element.start))
        elif child.tag.endswith("Spiral"):
            _child(child, "PI", _point(_intersection(place, heading, end, float(headings[-1]))))
        _child(child, "End", _point(end))
        place, heading = end, float(headings[-1])


def _intersection(start: complex, heading: float, end: complex, end_heading: float) -> complex:
    """Return where the tangents at two places meet."""
    turn = np.sin(end_heading - heading)
    along = ((end - start) * np.exp(-1j * end_heading)).imag / -turn if abs(turn) > 1e-12 else abs(end - start) / 2
    return complex(start + along * np.exp(1j * heading))


def _point(place: complex) -> str:
    return f"{place.imag:.6f} {place.real:.6f}"


def _cant(alignment: Any, elements: list[AlignmentElement], start: float, gauge_m: float) -> None:
    """Write a station where an element with cant begins or ends."""
    edges = np.concatenate([[0.0], np.cumsum([element.length_m for element in elements])])
    node = _child(alignment, "Cant", name="cant", gauge=f"{gauge_m:.4f}", rotationPoint="center")
    cants = [elements[0].start_cant_mm, *(element.end_cant_mm for element in elements)]
    for i, (place, cant) in enumerate(zip(edges, cants, strict=True)):
        attributes = {"station": f"{start + place:.6f}", "appliedCant": f"{abs(cant):.3f}"}
        if cant != 0.0:
            attributes["curvature"] = "ccw" if cant < 0.0 else "cw"
        if i < len(elements) and elements[i].start_cant_mm != elements[i].end_cant_mm:
            attributes["transitionType"] = _SPIRALS[elements[i].law]
        _child(node, "CantStation", **attributes)
