"""The navigation of the site follows from lists of links, which readers of the Markdown have as well.

On the pages that the setting ``navigation_pages`` names, an item of a list that begins with a link to a page, and a
row of a table that ends with one, puts that page below it. The documents in the root of the repository (CHANGELOG and
the like) have a page each in docs/project, which shows them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]

ROOT_DOCUMENTS = {
    "README.md": "index",
    "CHANGELOG.md": "project/changelog",
    "CONTRIBUTING.md": "project/contributing",
    "SECURITY.md": "project/security",
    "CODE_OF_CONDUCT.md": "project/conduct",
}
"""The page that stands for each document in the root."""

_ITEM = re.compile(r"^(?:- |\|.*\| )\[(?P<title>[^\]]+)\]\((?P<target>[^)#:\s]+\.(?:md|rst))\)", re.MULTILINE)
_LINK = re.compile(r"\]\((?P<path>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)")


def with_toctree(text: str) -> str:
    """Return a page with the pages that its lists begin with below it."""
    entries = [f"{match['title']} <{match['target'].rsplit('.', 1)[0]}>" for match in _ITEM.finditer(text)]
    return "\n".join([text, "", "```{toctree}", ":hidden:", "", *entries, "```", ""])


def of_root(text: str, page: str) -> str:
    """Return the text of a document in the root as it stands on ``page``: its relative links start there."""

    def moved(match: re.Match[str]) -> str:
        if match["path"] in ROOT_DOCUMENTS:
            target = f"{ROOT_DOCUMENTS[match['path']]}.md"
        else:
            target = os.path.relpath(match["path"], "docs")
        return f"]({_relative(target, page)}{match['anchor'] or ''})"

    return _LINK.sub(moved, text)


def with_root_documents(text: str, page: str) -> str:
    """Return a page whose links to documents in the root lead to the pages that stand for these."""
    up = os.path.relpath("..", PurePosixPath(page).parent)

    def shown(match: re.Match[str]) -> str:
        document = os.path.relpath(match["path"], up)
        if document not in ROOT_DOCUMENTS:
            return match[0]
        anchor = "" if document == "README.md" else match["anchor"] or ""
        return f"]({_relative(f'{ROOT_DOCUMENTS[document]}.md', page)}{anchor})"

    return _LINK.sub(shown, text)


def _relative(target: str, page: str) -> str:
    return os.path.relpath(target, PurePosixPath(page).parent)


def _navigate(app: Sphinx, page: str, source: list[str]) -> None:
    documents = {stands_for: document for document, stands_for in ROOT_DOCUMENTS.items() if stands_for != "index"}
    if page in documents:
        document = ROOT / documents[page]
        app.env.note_dependency(str(document))
        source[0] = of_root(document.read_text(encoding="utf-8"), page)
    else:
        source[0] = with_root_documents(source[0], page)
    if page in app.config.navigation_pages:
        source[0] = with_toctree(source[0])


def setup(app: Sphinx) -> None:
    """Add the navigation while pages are read."""
    app.add_config_value("navigation_pages", [], "env")
    app.connect("source-read", _navigate)
