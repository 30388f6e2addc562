"""A format is chosen by its name on the command line; other packages register theirs."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from trackfg.errors import BadInputError, expected_one_of

Format = TypeVar("Format")


def by_name(known: Mapping[str, Format], name: str) -> Format:
    """Return the format of that name. Raises :class:`BadInputError` with the nearest one where there is none."""
    if name not in known:
        raise BadInputError(f"no format {name!r}; {expected_one_of(known, name)}")
    return known[name]


def registered(group: str) -> list[Any]:
    """Return what other packages register under this group of entry points."""
    return [point.load() for point in _points(group, tuple(sys.path))]


@lru_cache(maxsize=8)
def _points(group: str, folders: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of all packages in these folders, read once: each has a file of them."""
    return tuple(entry_points(group=group))
