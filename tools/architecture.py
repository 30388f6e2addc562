"""How the packages import each other, measured and drawn from the code.

A room is a package of ``trackfg`` or a module in its root; factors/ and datasets/ count as the packages that they are
once installed. An arrow says that some module of one room imports one of another, wherever in the file it does so,
except for type checkers alone. A room's floor is the number of rooms on the longest way down from it, itself included.

    python tools/architecture.py                  draw docs/images/architecture.svg, put the figures into its page
    python tools/architecture.py --check          fail where the committed picture or figures are not those of the code
    python tools/architecture.py --single         name the arrows that stand for one import only
    python tools/architecture.py --root FOLDER    the figures of another tree, such as an older commit's; draws nothing
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "images" / "architecture.svg"

PACKAGE = "trackfg"
_FOLDERS = {PACKAGE: PACKAGE, "factors": f"{PACKAGE}.factors", "datasets": f"{PACKAGE}.datasets"}
_INFRASTRUCTURE = ("",)
"""No rooms: the package itself, which imports late what it exports, and what starts it."""

Arrow = tuple[str, str]


class Import(NamedTuple):
    """One module imports another."""

    importer: str
    imported: str


@dataclass(frozen=True)
class House:
    """The rooms, and for each arrow between two the imports that it stands for."""

    rooms: tuple[str, ...]
    root_files: int
    """Python files in the root of the package."""
    arrows: dict[Arrow, tuple[Import, ...]]
    packages: frozenset[str]
    """Rooms that are packages; the others are modules."""
    with_gtsam: frozenset[str]
    """Rooms that import GTSAM themselves."""

    @cached_property
    def below(self) -> dict[str, set[str]]:
        """The rooms that each imports."""
        below: dict[str, set[str]] = {room: set() for room in self.rooms}
        for upper, lower in self.arrows:
            below[upper].add(lower)
        return below

    @cached_property
    def floor(self) -> dict[str, int]:
        """The floor of each room, 1 for those that import no other. Raises ``ValueError`` where there is a cycle."""
        floor: dict[str, int] = {}
        while len(floor) < len(self.rooms):
            ready = [room for room in self.rooms if room not in floor and self.below[room] <= floor.keys()]
            if not ready:
                raise ValueError(f"a cycle of imports among {', '.join(sorted(set(self.rooms) - floor.keys()))}")
            floor |= {room: 1 + max((floor[lower] for lower in self.below[room]), default=0) for room in ready}
        return floor

    @cached_property
    def direct(self) -> set[Arrow]:
        """Arrows that no way over other rooms goes along with: the transitive reduction."""
        reached: dict[str, set[str]] = {}
        for room in sorted(self.rooms, key=self.floor.__getitem__):
            reached[room] = set().union(*(reached[lower] | {lower} for lower in self.below[room]))
        return {
            (upper, lower)
            for upper, lower in self.arrows
            if not any(lower in reached[other] for other in self.below[upper])
        }

    @property
    def figures(self) -> str:
        """Return the figures in one line."""
        return (
            f"{self.root_files} modules in the root, {len(self.rooms)} rooms, {max(self.floor.values())} floors, "
            f"{len(self.arrows)} arrows"
        )


def read(root: Path) -> House:
    """Read the imports of a source tree."""
    files = {
        _module(prefix, path.relative_to(root / folder)): path
        for folder, prefix in _FOLDERS.items()
        for path in sorted((root / folder).rglob("*.py"))
    }
    arrows: dict[Arrow, list[Import]] = defaultdict(list)
    with_gtsam = set()
    for importer, path in files.items():
        for imported in _imported(ast.parse(path.read_text())):
            target = imported if imported in files else imported.rpartition(".")[0]
            ends = _room(importer), _room(target)
            if imported.split(".")[0] == "gtsam":
                with_gtsam.add(ends[0])
            elif target in files and ends[0] != ends[1] and not set(ends) & set(_INFRASTRUCTURE):
                arrows[ends].append(Import(importer, target))
    rooms = {_room(module) for module in files} - set(_INFRASTRUCTURE)
    packages = {
        room for room in rooms if f"{PACKAGE}.{room}" in files and files[f"{PACKAGE}.{room}"].stem == "__init__"
    }
    return House(
        rooms=tuple(sorted(rooms)),
        root_files=len(list((root / PACKAGE).glob("*.py"))),
        arrows={arrow: tuple(dict.fromkeys(arrows[arrow])) for arrow in sorted(arrows)},
        packages=frozenset(packages),
        with_gtsam=frozenset(with_gtsam),
    )


def _module(prefix: str, path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join([prefix, *(parts[:-1] if parts[-1] == "__init__" else parts)])


def _room(module: str) -> str:
    package, _, rest = module.partition(".")
    return rest.partition(".")[0] if package == PACKAGE else ""


def _imported(tree: ast.AST) -> Iterator[str]:
    """The full names that a file imports, of modules and of what is in them."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        else:
            yield from _imported(node)


_WIDTH, _MARGIN = 1180, 24
_FLOOR_HEIGHT, _ROOM_HEIGHT = 74, 30
_LETTER, _PADDING, _GAP = 7.6, 12, 18
"""Lengths in the picture, px."""

_SWEEPS = 12
"""Times that rooms are put in order, up and down, by the middle of those that they are tied to."""

_STYLE = """
    text { font: 13px 'DejaVu Sans', Verdana, sans-serif; text-anchor: middle; fill: #222 }
    .note { font-size: 11px; fill: #666; text-anchor: start }
    .number { fill: #aaa; text-anchor: start }
    rect { fill: #eef1f5; stroke: #7a8594; stroke-width: 1 }
    .module { fill: #fff; stroke-dasharray: 3 2 }
    .gtsam { fill: #d7e6f7; stroke: #2f6fb3 }
    .floor { stroke: #eee; stroke-width: 1 }
    path { fill: none; stroke: #c9ced6; stroke-width: 0.6 }
    .direct { stroke: #4c5a6d; stroke-width: 1.1; marker-end: url(#head) }
"""


class _Box(NamedTuple):
    """The middle of a room and its width, px."""

    x: float
    y: float
    width: float


def drawn(house: House) -> str:
    """Draw the house as SVG: a row for each floor, what imports most on top."""
    boxes = _placed(house)
    height = _MARGIN * 2 + _FLOOR_HEIGHT * max(house.floor.values()) + 34
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" width="{_WIDTH}" height="{height}">',
        f"<title>{house.figures}</title>",
        f"<style>{_STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" markerHeight="6" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" style="fill: #4c5a6d; stroke: none"/></marker></defs>',
        f'<rect width="{_WIDTH}" height="{height}" style="fill: #fff; stroke: none"/>',
    ]
    for floor in range(1, max(house.floor.values()) + 1):
        y = next(boxes[room].y for room in house.rooms if house.floor[room] == floor)
        lines.append(f'<line class="floor" x1="{_MARGIN}" y1="{y:g}" x2="{_WIDTH - _MARGIN}" y2="{y:g}"/>')
        lines.append(f'<text class="number" x="{_MARGIN / 4:g}" y="{y + 4.5:g}">{floor}</text>')
    ordered = sorted(house.arrows, key=lambda arrow: (arrow in house.direct, arrow))
    lines += [_curve(house, boxes, arrow) for arrow in ordered]
    for room in house.rooms:
        box = boxes[room]
        kind = "gtsam" if room in house.with_gtsam else "package" if room in house.packages else "module"
        lines.append(
            f'<rect class="{kind}" x="{box.x - box.width / 2:.1f}" y="{box.y - _ROOM_HEIGHT / 2:g}" '
            f'width="{box.width:.1f}" height="{_ROOM_HEIGHT}" rx="5"/>'
            f'<text x="{box.x:.1f}" y="{box.y + 4.5:g}">{room}</text>'
        )
    lines.append(
        f'<text class="note" x="{_MARGIN}" y="{height - 14}">An arrow: imports. Dark: no other way leads there; faint: '
        "another one does too. Blue: imports GTSAM itself. Dashed: a single module. "
        f"{house.figures[0].upper()}{house.figures[1:]}.</text>"
    )
    return "\n".join([*lines, "</svg>"]) + "\n"


def _placed(house: House) -> dict[str, _Box]:
    """Put the rooms of each floor in a row, near what they are tied to, so that few arrows cross."""
    floors: dict[int, list[str]] = defaultdict(list)
    for room in house.rooms:
        floors[house.floor[room]].append(room)
    tied: dict[str, list[str]] = defaultdict(list)
    for upper, lower in sorted(house.direct):
        tied[upper].append(lower)
        tied[lower].append(upper)
    boxes: dict[str, _Box] = {}
    for floor, row in floors.items():
        boxes |= _row(house, floor, row)
    for sweep in range(_SWEEPS):
        for floor in sorted(floors, reverse=sweep % 2 == 0):
            middle = {
                room: sum(boxes[other].x for other in tied[room]) / len(tied[room]) if tied[room] else boxes[room].x
                for room in floors[floor]
            }
            floors[floor].sort(key=lambda room: (middle[room], room))
            boxes |= _row(house, floor, floors[floor])
    return boxes


def _row(house: House, floor: int, row: list[str]) -> dict[str, _Box]:
    widths = [_LETTER * len(room) + 2 * _PADDING for room in row]
    space = (_WIDTH - 2 * _MARGIN - sum(widths)) / (len(row) + 1)
    y = _MARGIN + _FLOOR_HEIGHT * (max(house.floor.values()) - floor + 0.5)
    x, boxes = float(_MARGIN), {}
    for room, width in zip(row, widths, strict=True):
        x += max(space, _GAP)
        boxes[room] = _Box(x + width / 2, y, width)
        x += width
    return boxes


def _curve(house: House, boxes: dict[str, _Box], arrow: Arrow) -> str:
    upper, lower = (boxes[room] for room in arrow)
    lean = max(-0.4, min(0.4, (lower.x - upper.x) / _WIDTH))
    x0, x1 = upper.x + lean * upper.width, lower.x - lean * lower.width
    y0, y1 = upper.y + _ROOM_HEIGHT / 2, lower.y - _ROOM_HEIGHT / 2 - 1
    bend = 0.45 * (y1 - y0)
    kind = ' class="direct"' if arrow in house.direct else ""
    return f'<path{kind} d="M{x0:.1f} {y0:g} C{x0:.1f} {y0 + bend:.1f} {x1:.1f} {y1 - bend:.1f} {x1:.1f} {y1:g}"/>'


def main() -> int:
    """Draw, check or measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; 1 where picture or page is stale")
    parser.add_argument("--single", action="store_true", help="name the arrows that are a single import; draw nothing")
    parser.add_argument("--root", type=Path, metavar="FOLDER", help="measure the source tree in this folder")
    given = parser.parse_args()
    house = read(given.root or ROOT)
    print(house.figures)
    if given.single:
        for (upper, lower), imports in house.arrows.items():
            if len(imports) == 1:
                direct = "" if (upper, lower) in house.direct else "   (there is another way)"
                print(f"{upper} -> {lower}: {imports[0].importer} imports {imports[0].imported}{direct}")
    if given.single or given.root:
        return 0
    made = {PICTURE: drawn(house), PAGE: _with_figures(PAGE.read_text(), house)}
    stale = [path for path, text in made.items() if not (path.exists() and path.read_text() == text)]
    if given.check:
        for path in stale:
            print(
                f"{path.relative_to(ROOT)} is not that of the code. Hint: python tools/architecture.py", file=sys.stderr
            )
        return 1 if stale else 0
    for path in stale:
        path.write_text(made[path])
    return 0


def _with_figures(page: str, house: House) -> str:
    """Put today's figures into the page's table."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    figures = (house.root_files, len(house.rooms), max(house.floor.values()), len(house.arrows), len(contracts))
    return re.sub(r"^\| today \|.*$", " | ".join(["| today", *map(str, figures)]) + " |", page, flags=re.MULTILINE)


if __name__ == "__main__":
    sys.exit(main())
