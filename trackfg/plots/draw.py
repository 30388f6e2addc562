"""A sheet becomes a file, of the kind that its suffix names."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from trackfg.errors import BadInputError
from trackfg.files.atomic_file import replaced_file
from trackfg.files.libraries import library
from trackfg.plots.sheet import Sheet


def picture_path(path: str | os.PathLike[str]) -> Path:
    """Return ``path``, if its suffix names a kind of picture that can be drawn; else raise :class:`BadInputError`.

    Raises :class:`~trackfg.errors.MissingLibraryError` without the library that draws this kind.
    """
    path = Path(path)
    if path.suffix not in (".png", ".svg", ".html"):
        raise BadInputError(f"{path}: expected a file that ends in .png, .svg or .html")
    library("plotly" if path.suffix == ".html" else "matplotlib", "charts")
    return path


def drawn(sheet: Sheet, path: str | os.PathLike[str] | None) -> Any:
    """Draw ``sheet`` into ``path`` and return that; without a path return a figure of plotly, which a notebook shows.

    The same sheet gives the same file, which is there whole or as it was before. Raises what :func:`picture_path`
    raises, and :class:`OutputError` where the file cannot be written.
    """
    if path is None:
        library("plotly", "charts")
        from trackfg.plots.plotly_page import notebook_figure

        return notebook_figure(sheet)
    path = picture_path(path)
    if path.suffix == ".html":
        from trackfg.plots.plotly_page import write
    else:
        from trackfg.plots.matplotlib_picture import write
    with replaced_file(path) as new:
        write(sheet, new)
    return path
