"""The glossary is made of the tables of words in docs/concepts.md: a term is explained there, and nowhere else."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

_TABLE = re.compile(r"^\| word \|.*\n\|[-| ]+\|\n(?P<rows>(?:\|.*\n)+)", re.MULTILINE)
_PAGE = "glossary"


def terms(concepts: str) -> list[tuple[str, str]]:
    """Return the words of the tables and meanings (the last column) by the alphabet."""
    rows = [row for table in _TABLE.finditer(concepts) for row in table["rows"].splitlines()]
    cells = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows]
    return sorted(((row[0], row[-1]) for row in cells), key=lambda term: term[0].casefold())


def as_glossary(concepts: str) -> str:
    """Return the directive that lists the terms of docs/concepts.md."""
    lines = [line for word, meaning in terms(concepts) for line in (word.replace("*", ""), f"    {meaning}", "")]
    return "\n".join(["```{glossary}", "", *lines, "```", ""])


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    if page == _PAGE:
        concepts = Path(app.srcdir) / "concepts.md"
        app.env.note_dependency(str(concepts))
        source[0] += "\n" + as_glossary(concepts.read_text(encoding="utf-8"))


def setup(app: Sphinx) -> None:
    """Fill the glossary while its page is read."""
    app.connect("source-read", _fill)
