"""The site of the docs: the extension of Sphinx that docs/conf.py loads.

Pages stay Markdown that GitHub shows as well. What only the site has is added while Sphinx reads them: the navigation
(:mod:`.navigation`), the glossary (:mod:`.glossary`), and on tutorials the output and the pictures of their commands
(:mod:`.tutorials`). :mod:`.drawings` puts the drawings into the pages, so that they follow the page's colours, and
:mod:`.signatures` makes lists of parameters, and :mod:`.constants` finds the docstrings of constants.
"""

from __future__ import annotations

from typing import Any

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from docsite import constants, drawings, glossary, navigation, signatures, tutorials


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the parts with Sphinx."""
    app.add_lexer("csv", TextLexer)
    for part in (tutorials, glossary, navigation, drawings, signatures, constants):
        part.setup(app)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
