"""A drawing becomes a part of the page, so that its lines and letters have the colours of the page, light or dark.

Elsewhere, as on GitHub, the same file is an image that follows the reader's system.
"""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

_FOLDER = "images/drawings/"


def inlined(svg: str, alternative: str) -> str:
    """Return a drawing as a part of a page, with its text alternative; where it is too wide it can be moved by keys."""
    title = svg.split("<title>")[1].split("</title>")[0]
    body = re.sub(r"<title>.*?</title>", "", svg, flags=re.DOTALL).strip()
    image = body.replace("<svg ", f'<svg role="img" aria-label="{escape(alternative)}" ', 1)
    return f'<div class="scrolled" role="group" tabindex="0" aria-label="{title}">{image}</div>'


def _inline(app: Sphinx, tree: nodes.document, _page: str) -> None:
    if app.builder.format != "html":
        return
    for image in list(tree.findall(nodes.image)):
        if image["uri"].startswith(_FOLDER):
            svg = (Path(app.srcdir) / image["uri"]).read_text(encoding="utf-8")
            image.replace_self(nodes.raw("", inlined(svg, image["alt"]), format="html"))


def setup(app: Sphinx) -> None:
    """Inline drawings where pages are written as HTML."""
    app.connect("doctree-resolved", _inline)
