"""What the importer must know of one format of recordings (:mod:`trackfg.interchange.importing.registry` has all)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.interchange.importing.delimited.dialect import DialectOptions
from trackfg.interchange.importing.source_table import SourceTable

DialectFor = Callable[[str], DialectOptions | None]
"""What a mapping states of the dialect of a text file, by the file's name."""


class SourceFormat(ABC):
    """A format of recordings: ``key`` is its name on the command line, ``title`` what it is in a line."""

    key: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Return whether a file or folder is of this format, from its name and its first bytes. Never raises."""

    @abstractmethod
    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the tables. Raises :class:`BadInputError` that names file, place and reason where that fails."""

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any] | None:
        """Return the sections of a mapping where the format says itself which column is what; else None."""
        return None


def starts_with(path: Path, *beginnings: bytes) -> bool:
    """Return whether a file begins with one of these bytes. Never raises, and does not wait for a pipe."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            return stream.read(max(map(len, beginnings))).startswith(beginnings)
    except OSError:
        return False


@contextmanager
def readable(path: Path, expected: str, faults: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Raise :class:`BadInputError` with what was ``expected`` where reading a file in the block raises ``faults``.

    These are by default all, since libraries raise errors of many kinds for damaged files.
    """
    try:
        yield
    except TrackfgError:
        raise
    except faults as error:
        raise BadInputError(f"{path.name}: cannot be read ({first_line(error)}); expected {expected}") from error


def refuse_empty(tables: Sequence[SourceTable], path: Path, what: str) -> Sequence[SourceTable]:
    """Return the tables. Raises :class:`BadInputError` where there is none."""
    if not tables:
        shapes = ". Hint: a table is a list of records, or an object with a list of numbers for each column"
        hint = shapes if path.suffix.casefold().startswith(".json") else ""
        raise BadInputError(f"{path.name}: holds no {what}; expected at least one{hint}")
    return tables
