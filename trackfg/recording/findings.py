"""Findings say what is wrong, or worth knowing, about a recording; reading and checking give the same."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Literal, NamedTuple

from pydantic import AliasChoices, Field

from trackfg.errors import BadInputError, printable

Level = Literal["error", "warning", "info"]


class Section(NamedTuple):
    """A table of the description: the ``file`` it is in and its ``name`` there, ``"tach"`` or ``"laser[1]"``."""

    file: str
    name: str


@dataclass(frozen=True)
class Finding:
    """A fact about the input. ``code`` is stable and kebab-case; ``str()`` gives the one-line message.

    ``column`` is a table's column, or a key of ``recording.toml`` (``"imu.gyro_unit"``). ``row`` counts data rows from
    1 (the header of a CSV file is not one); ``time_s`` is the time in that row. ``hint`` is what to do; results of
    trackfg 0.1 have it under the key ``mend``, which is still read.
    """

    level: Level
    code: str
    message: str
    _: KW_ONLY
    file: str | None = None
    column: str | None = None
    row: int | None = None
    time_s: float | None = None
    expected: str | None = None
    hint: Annotated[str | None, Field(validation_alias=AliasChoices("hint", "mend"))] = None

    def __post_init__(self) -> None:
        """Names and cells come from the input: control characters in them must not reach a terminal."""
        for name in ("message", "file", "column", "expected", "hint"):
            text = getattr(self, name)
            if text is not None and not text.isprintable():
                object.__setattr__(self, name, printable(text))

    @property
    def place(self) -> str:
        """File, column or key, data row and time, as far as they are known; empty where the finding has no place."""
        parts = [] if self.file is None else [self.file]
        if self.column is not None:
            parts.append(f"key {self.column}" if (self.file or "").endswith(".toml") else f"column {self.column!r}")
        if self.row is not None:
            parts.append(f"data row {self.row}" + ("" if self.time_s is None else f" (t = {self.time_s:.9g} s)"))
        return ", ".join(parts)

    @property
    def sentence(self) -> str:
        """Place, message and what was expected, without the hint."""
        text = f"{self.place}: {self.message}" if self.place else self.message
        return text if self.expected is None else f"{text}; expected {self.expected}"

    def __str__(self) -> str:
        return self.sentence if self.hint is None else f"{self.sentence}. Hint: {self.hint}"


def errors(findings: Iterable[Finding]) -> list[Finding]:
    """Return those that make a recording unusable, in their order."""
    return [finding for finding in findings if finding.level == "error"]


def raise_first(findings: Sequence[Finding]) -> None:
    """Raise :class:`BadInputError` with the first error among the findings, if there is one."""
    if faults := errors(findings):
        raise BadInputError(str(faults[0]))
