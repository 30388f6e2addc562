"""A constant that a package exports has the docstring beneath its definition, wherever that is.

Sphinx looks for it in the package only, and would show what Python says of the constant's type.
"""

from __future__ import annotations

import inspect
import sys

from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer


def docstring_of(name: str) -> list[str]:
    """Return the docstring of ``package.CONSTANT``, line by line; none where it has none."""
    package, _, constant = name.rpartition(".")
    value = getattr(sys.modules[package], constant)
    holders = [
        module
        for module in list(sys.modules)
        if f"{module}.".startswith(f"{package}.") and getattr(sys.modules[module], constant, None) is value
    ]
    docstrings = (ModuleAnalyzer.for_module(module).find_attr_docs().get(("", constant)) for module in holders)
    return next(filter(None, docstrings), [])


def _replace(_app: Sphinx, what: str, name: str, value: object, _options: object, lines: list[str]) -> None:
    if what == "data" and "\n".join(lines).strip() == inspect.cleandoc(type(value).__doc__ or ""):
        lines[:] = docstring_of(name)


def setup(app: Sphinx) -> None:
    """Replace docstrings of types while constants are read."""
    app.connect("autodoc-process-docstring", _replace, priority=400)  # before numpydoc
