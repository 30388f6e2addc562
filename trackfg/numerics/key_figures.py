"""What holds large tables shows its key figures: one line in Python, a small table in a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


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
