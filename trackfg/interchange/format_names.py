"""A format is chosen by its name on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from trackfg.errors import BadInputError, did_you_mean

Format = TypeVar("Format")


def by_name(known: Mapping[str, Format], name: str) -> Format:
    """Return the format of that name. Raises :class:`BadInputError` with the nearest one where there is none."""
    if name not in known:
        near = did_you_mean(name, known)
        raise BadInputError(
            f"no format {name!r}; expected one of {', '.join(known)}" + (f". Hint: {near}" if near else "")
        )
    return known[name]
