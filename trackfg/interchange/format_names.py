"""A format is chosen by its name on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from trackfg.errors import BadInputError, expected_one_of

Format = TypeVar("Format")


def by_name(known: Mapping[str, Format], name: str) -> Format:
    """Return the format of that name. Raises :class:`BadInputError` with the nearest one where there is none."""
    if name not in known:
        raise BadInputError(f"no format {name!r}; {expected_one_of(known, name)}")
    return known[name]
