"""LandXML files, Inframodel among them: opened safely, and read attribute by attribute with messages that say where.

A file is data from anywhere: no document type, no entities, no network, and a limit on the size.
"""

from __future__ import annotations

import errno
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackfg.errors import BadInputError
from trackfg.files.small_file import read_small
from trackfg.files.xml_file import xml_root

NAMESPACES = {
    **{f"http://www.landxml.org/schema/LandXML-{version}": version for version in ("1.1", "1.2", "2.0")},
    "http://www.inframodel.fi/inframodel": "1.2",
    "http://buildingsmart.fi/inframodel/404": "1.2",
}
"""Namespaces that are read, and the version of LandXML that each is; Inframodel 4 is a subset of 1.2."""
_MOST_BYTES = 256 * 2**20
"""Largest file that is read, bytes. Chosen here, so that a wrong file does not fill the memory."""


def _name(element: Any) -> tuple[str | None, str]:
    """Return namespace (None without one) and local name of an element."""
    namespace, _, name = element.tag.rpartition("}")
    return namespace.removeprefix("{") or None, name


@dataclass(frozen=True)
class Node:
    """An element of the file; ``what`` names it as messages do."""

    element: Any
    file: str
    what: str

    @property
    def tag(self) -> str:
        """Return the element's name without the namespace."""
        return _name(self.element)[1]

    @property
    def namespace(self) -> str:
        """Return the element's namespace, empty where it has none."""
        return _name(self.element)[0] or ""

    def error(self, problem: str) -> BadInputError:
        """Return the error that names file, line, element and ``problem``."""
        return BadInputError(f"{self.file}, line {self.element.sourceline}: {self.what}: {problem}")

    def children(self, *tags: str) -> Iterator[Node]:
        """Return its child elements with one of these names; all of them where none is given."""
        for child in self.element.iterchildren(f"{{{self.namespace}}}*"):
            _, name = _name(child)
            if not tags or name in tags:
                yield Node(child, self.file, f"{self.what}, {name}")

    def child(self, tag: str) -> Node | None:
        """Return its first child of this name."""
        return next(self.children(tag), None)

    def everywhere(self, tag: str) -> Iterator[Node]:
        """Return all elements of the file with this name."""
        for element in self.element.getroottree().iter(f"{{{self.namespace}}}{tag}"):
            yield Node(element, self.file, tag)

    def named(self, what: str) -> Node:
        """Return the same element under another name in messages."""
        return Node(self.element, self.file, what)

    def text(self, attribute: str) -> str | None:
        """Return an attribute, or None where it is absent."""
        value = self.element.get(attribute)
        return None if value is None else str(value).strip()

    def choice(self, attribute: str, choices: tuple[str, ...]) -> str:
        """Return a required attribute that is one of ``choices``."""
        value = self.text(attribute)
        if value not in choices:
            problem = f"{attribute} is missing" if value is None else f"{attribute} is {value!r}"
            raise self.error(f"{problem}: expected one of {', '.join(choices)}")
        return value

    def number(self, attribute: str, *, above: float = -math.inf) -> float:
        """Return a required attribute that is a finite number above a bound."""
        value = self.optional_number(attribute, above=above)
        if value is None:
            raise self.error(f"{attribute} is missing: expected {_bounded(above)}")
        return value

    def optional_number(self, attribute: str, *, above: float = -math.inf) -> float | None:
        """Return a number as :meth:`number` does, or None where the attribute is absent."""
        text = self.text(attribute)
        if text is None:
            return None
        value = _finite(text)
        if value is None or value <= above:
            raise self.error(f"{attribute} is {text!r}: expected {_bounded(above)}")
        return value

    def is_zero(self, attribute: str) -> bool:
        """Return whether an attribute is there and is the number 0."""
        return _finite(self.text(attribute) or "") == 0.0

    def curvature(self, attribute: str) -> float:
        """Return a required attribute that is a radius above zero, or INF, as curvature in its own unit."""
        return 0.0 if (self.text(attribute) or "").upper() == "INF" else 1.0 / self.number(attribute, above=0.0)

    def numbers(self, count: int) -> list[float]:
        """Return the first ``count`` numbers of its text."""
        words = (self.element.text or "").split()
        values = [_finite(word) for word in words[:count]]
        if len(values) < count or None in values:
            raise self.error(f"its text is {' '.join(words)[:60]!r}: expected {count} numbers")
        return [value for value in values if value is not None]


def open_landxml(path: Path | str) -> Node:
    """Return the root of a file of one of the :data:`NAMESPACES`.

    Raises :class:`BadInputError` for a file that cannot be read, is larger than 256 MiB, is not well-formed XML, has a
    document type, or is of no such namespace.
    """
    path = Path(path)
    try:
        content = read_small(path, _MOST_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            wish = f"expected at most {_MOST_BYTES // 2**20} MiB: leave out surfaces and points"
            raise BadInputError(f"{path}: it has {path.stat().st_size / 2**20:.0f} MiB: {wish}") from error
        raise BadInputError(f"{path}: cannot be read: {error.strerror}: expected a LandXML file") from error
    root = xml_root(content, path, "a LandXML file")
    namespace, name = _name(root)
    if name != "LandXML" or namespace not in NAMESPACES:
        wish = f"expected LandXML of namespace {', '.join(NAMESPACES)}"
        if name.casefold() == "railml":
            wish += ". Hint: of railML write netElements and netRelations as GeoJSON (docs/known-line.md)"
        raise BadInputError(f"{path}: its root is {name} of namespace {namespace!r}: {wish}")
    return Node(root, str(path), "LandXML")


def version_remarks(root: Node) -> list[str]:
    """Return a remark where the file's version is not the one of its namespace."""
    declared, expected = root.text("version"), NAMESPACES[root.namespace]
    if declared == expected:
        return []
    return [f"its version is {declared!r}, its namespace that of {expected}: it is read as {expected}"]


def is_inframodel(root: Node) -> bool:
    """Return whether a file is Inframodel, whose station equations are kilometre posts."""
    return "inframodel" in root.namespace


@dataclass(frozen=True)
class Units:
    """Metres per unit of the file: of plan, heights and radii, and of cant."""

    length_m: float
    cant_m: float


def read_units(root: Node) -> Units:
    """Read ``Units``: lengths in the linear unit; cant in millimetres (Metric) or inches (Imperial)."""
    units = root.child("Units")
    system = None if units is None else next(units.children("Metric", "Imperial"), None)
    if system is None:
        raise (units or root).error("the units are missing: expected Units with Metric or Imperial")
    scales = _METRIC if system.tag == "Metric" else _IMPERIAL
    unit = system.choice("linearUnit", tuple(scales))
    return Units(scales[unit], 1e-3 if system.tag == "Metric" else 0.0254)


_METRIC = {"meter": 1.0, "millimeter": 1e-3, "centimeter": 1e-2, "kilometer": 1e3}
"""Metres per unit (LandXML 1.2, Metric)."""
_IMPERIAL = {"foot": 0.3048, "USSurveyFoot": 1200.0 / 3937.0, "inch": 0.0254, "mile": 1609.344}
"""Metres per unit (LandXML 1.2, Imperial); the US survey foot is 1200/3937 m by definition."""


def _finite(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _bounded(above: float) -> str:
    return "a number" if above == -math.inf else f"a number above {above:g}"
