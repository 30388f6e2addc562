"""README and the pages of docs hold blocks: commands, Python, files to write, and text that is only shown.

A block is fenced and names its language. ``sh`` and ``python`` are run; a block of another language that has a name
after it (```` ```toml rule.toml ````) is a file that the steps after it read. Where a newcomer's machine may lack
something, the block's first line says so: ``# needs a network``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

_FENCED = re.compile(r"^```(?P<language>\w*) *(?P<name>\S*)\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?<=\n\n)(?: {4}[^\n]*\n|\n)+")
_NEEDS = re.compile(r"^(?:#|--) needs (?P<what>[^\n]+)\n")
_COMMAND = re.compile(r"^ *(?:\$ )?(?:trackfg|python|pip|make) ", re.MULTILINE)
_SPAN = re.compile(r"`(trackfg [a-z][^`]*)`")


@dataclass(frozen=True)
class Block:
    """``text`` stands on a page from ``line`` on; ``name`` is that of the file it is, or empty."""

    page: str
    line: int
    language: str
    name: str
    text: str

    @property
    def needs(self) -> str | None:
        """What a machine may lack, as the block's first line says."""
        match = _NEEDS.match(self.text)
        return match["what"] if match else None

    @property
    def commands(self) -> list[str]:
        """The lines of a block of commands; one that ends in a backslash goes on with the next."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line for line in lines if line.strip() and not line.startswith("#")]


def pages() -> list[Path]:
    """README, the pages in the order in which it lists them, then those that it does not list."""
    readme = ROOT / "README.md"
    linked = re.findall(r"\]\((docs/[^)#\s]+\.md)", readme.read_text(encoding="utf-8").split("## Documents")[1])
    every = [readme, *(ROOT / link for link in linked), *sorted((ROOT / "docs").rglob("*.md"))]
    return list(dict.fromkeys(every))


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(_short(page), 1 + text.count("\n", 0, match.start()), match["language"], match["name"], match["text"])
        for match in _FENCED.finditer(text)
    ]


def unfenced_commands(page: Path) -> Iterator[str]:
    """Commands in indented blocks, which nothing would run."""
    text = _FENCED.sub(lambda match: "\n" * match[0].count("\n"), page.read_text(encoding="utf-8"))
    for match in _INDENTED.finditer(text):
        if _COMMAND.search(match[0]):
            line = 1 + text.count("\n", 0, match.start())
            yield f"{_short(page)}:{line}: commands stand in a block fenced by ```sh, to be run"


def spans(page: Path) -> list[str]:
    """Command lines of trackfg within sentences."""
    return _SPAN.findall(_FENCED.sub("", page.read_text(encoding="utf-8")))


def _short(page: Path) -> str:
    return str(page.relative_to(ROOT))
