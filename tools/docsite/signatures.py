"""A signature with a parameter on each line is a list of its page.

Sphinx writes it as a definition list without terms, which readers of the screen cannot announce.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_PARAMETERS = re.compile(r"<dl>\n(?P<items>(?:<dd>.*?</dd>\n)+)</dl>\n", re.DOTALL)


def with_lists(body: str) -> str:
    """Return the HTML of a page whose signatures are lists."""

    def as_list(match: re.Match[str]) -> str:
        items = match["items"].replace("<dd>", "<li>").replace("</dd>", "</li>")
        return f'<ul class="parameters">\n{items}</ul>\n'

    return _PARAMETERS.sub(as_list, body)


def _rewrite(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _tree: object) -> None:
    if "body" in context:
        context["body"] = with_lists(context["body"])


def setup(app: Sphinx) -> None:
    """Rewrite signatures where pages are written as HTML."""
    app.connect("html-page-context", _rewrite)
