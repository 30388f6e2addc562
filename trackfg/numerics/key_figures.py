"""Holders of large tables and arrays show key figures or shapes: one line in Python, a small table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sized
from dataclasses import Field, fields
from enum import Enum
from html import escape
from typing import Any, ClassVar


class KeyFigures:
    """A base of classes that name their key figures; a dataclass of it is made with ``repr=False``."""

    def key_figures(self) -> Mapping[str, str]:
        """Return texts by name, the first of which is the object's own name. Units stand in the texts."""
        raise NotImplementedError

    def __repr__(self) -> str:
        name, *others = self.key_figures().values()
        text = f"<{type(self).__name__} {name}: {', '.join(others)}>"
        return text if text.isprintable() else ascii(text)[1:-1]  # names come from files

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><th scope="row" style="text-align:left">{escape(name)}</th>'
            f'<td style="text-align:left">{escape(text)}</td></tr>'
            for name, text in self.key_figures().items()
        )
        return f"<table><caption>{type(self).__name__}</caption><tbody>{rows}</tbody></table>"


_LONGEST_TEXT = 100
"""Characters of a text that an outline shows whole."""


def outline(owner: Any, names: Iterable[str]) -> str:
    """Return one line: the owner's class, its scalars, and the shapes or lengths of all else."""
    return f"{type(owner).__name__}({', '.join(f'{name}={_brief(getattr(owner, name))}' for name in names)})"


def _brief(value: object) -> str:
    if value is None or isinstance(value, (bool, int, float, str, Enum)):
        text = str(value) if isinstance(value, Enum) else repr(value)
        return text if len(text) <= _LONGEST_TEXT else f"str of {len(text)}"
    name = type(value).__name__
    if shape := getattr(value, "shape", None):
        return f"{name} {shape}"
    return f"{name} of {len(value)}" if isinstance(value, Sized) else name


class Outlined:
    """A base of dataclasses that hold arrays, which show shapes in place of numbers; made with ``repr=False``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __repr__(self) -> str:
        return outline(self, (field.name for field in fields(self)))
