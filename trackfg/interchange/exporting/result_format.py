"""A format of results is a class that writes a result to a file; the registry has all formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from trackfg.interchange.exporting.channels import Channel
from trackfg.results.result import Result


@dataclass(frozen=True)
class ExportOptions:
    """``table`` is the one of the result that is wanted, where a format has only one; ``channels`` those of a template;
    ``step_m`` the spacing of drawn vertices; ``km``: official places are wanted beside the chainages; ``bands``: level
    and alignment in the bands D2 and D3, too.
    """

    table: str = "geometry"
    channels: tuple[Channel, ...] = ()
    step_m: float = 1.0
    km: bool = False
    bands: bool = False


ON_COMMAND_LINE = {"table": "--table", "channels": "--template", "step_m": "--step", "km": "--km", "bands": "--bands"}
"""What the options are called on the command line."""


class ResultFormat(ABC):
    """A format of results: ``key`` is its name on the command line, ``suffix`` that of its files, ``title`` what it is.

    A class with ``needs_place`` writes positions on the Earth, which a result has where GNSS gave them; one with
    ``needs_trajectory`` what a geometry that another system measured has not. ``takes`` are the names of the options
    that say something of what it writes: others are refused.
    """

    key: ClassVar[str]
    suffix: ClassVar[str]
    title: ClassVar[str]
    needs_place: ClassVar[bool] = False
    needs_trajectory: ClassVar[bool] = False
    takes: ClassVar[frozenset[str]] = frozenset(ON_COMMAND_LINE)

    def file_name(self, result_name: str, options: ExportOptions) -> str:
        """Return the file's name where the user gives none: no two exports of one result have the same."""
        return f"{result_name}{self.suffix}"

    @abstractmethod
    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write a result to a new file. Raises :class:`BadInputError` where the result lacks what the format needs."""
