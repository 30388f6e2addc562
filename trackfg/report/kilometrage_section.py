"""The section of a page about the official kilometrage: the line, from where to where, and its jumps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trackfg.numerics.chainage.kilometrage import Jump
from trackfg.numerics.chainage.km_notation import written_places
from trackfg.report.page import Block, Facts, PageSection, PageTable, TableRow, Text
from trackfg.results.result import Result

if TYPE_CHECKING:
    from trackfg.recording.line_kilometrage import LineKilometrage


def kilometrage_sections(result: Result, line: LineKilometrage | None) -> Iterator[PageSection]:
    """Yield the section of a result on a line; nothing where no official places are wanted."""
    if line is None or (result.trajectory.empty and result.geometry.empty):
        return
    kilometrage = line.kilometrage()
    chainages = (result.geometry if result.trajectory.empty else result.trajectory)["chainage_m"].to_numpy()
    ends = np.array([chainages.min(), chainages.max()])
    first, last = kilometrage.written(ends)
    jumps = [jump for jump in kilometrage.jumps if ends[0] <= jump.chainage_m <= ends[1]]
    facts = (
        ("line", line.line),
        ("track", line.track),
        ("from", f"km {first} (chainage {ends[0]:.2f} m)"),
        ("to", f"km {last} (chainage {ends[1]:.2f} m)"),
    )
    blocks: list[Block] = [Facts(tuple((name, text) for name, text in facts if text))]
    if jumps:
        sides = [written_places(np.array([jump.back_m, jump.ahead_m]), kilometrage.notation) for jump in jumps]
        rows = TableRow.plain(
            (f"{jump.chainage_m:.2f}", *both, jump_text(jump)) for jump, both in zip(jumps, sides, strict=True)
        )
        headings = ("chainage, m", "km before", "km after", "what")
        blocks.append(PageTable(headings, rows, numbers=frozenset((0, 1, 2)), caption="Jumps of the kilometrage"))
    else:
        blocks.append(Text("Kilometrage goes on without a jump."))
    yield PageSection("kilometrage", "Kilometrage", tuple(blocks))


def jump_text(jump: Jump) -> str:
    """Return in words what a jump is."""
    length = abs(jump.ahead_m - jump.back_m)
    match jump.kind:
        case "gap":
            return f"{length:.2f} m are missing"
        case "overlap":
            return f"{length:.2f} m are there twice"
    return "kilometrage turns back" if length < 1e-3 else f"kilometrage turns, {length:.2f} m away"
