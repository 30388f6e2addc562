"""A verdict says, per quantity of a result, whether its sigmas can be trusted.

Whatever finds that the model's sigmas of some quantities are too small states a :class:`Doubt`. Doubts of one quantity
are combined to a :class:`Verdict`: *trusted*, *widened* by a factor, or *not_trusted*.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from pydantic import Field

from trackfg.recording.findings import Finding
from trackfg.recording.strict_model import Model

Quantity = Literal[
    "chainage",
    "position",
    "height",
    "speed",
    "roll",
    "pitch",
    "yaw",
    "cross_level",
    "twist",
    "level",
    "alignment",
    "curvature",
    "gradient",
]
"""Position is that in plan, height its own; versines are those of ``level`` and ``alignment``."""

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

Status = Literal["trusted", "widened", "not_trusted"]

NOT_TRUSTED = "not to be trusted"
"""A status as people read it."""


@dataclass(frozen=True)
class Doubt:
    """A reason why the sigmas of some quantities are too small.

    ``factor`` >= 1 is what they should be multiplied by; infinity where no finite sigma can be given. ``reason`` says
    what was seen, ``hint`` what the user can do. Raises ``ValueError`` for a factor below 1 and for no quantity.
    """

    quantities: tuple[Quantity, ...]
    factor: float
    reason: str
    hint: str

    def __post_init__(self) -> None:
        """Reject a factor that would narrow sigmas."""
        if not self.factor >= 1.0:
            raise ValueError(f"factor {self.factor}: expected at least 1")
        if not self.quantities:
            raise ValueError("a doubt names at least one quantity")


class Verdict(Model):
    """A verdict says how far the sigmas of one quantity can be trusted.

    ``factor`` is what the model's sigmas were multiplied by in the tables: 1 where trusted, null where not to be
    trusted (sigmas there are those of :data:`trackfg.results.widening.UNKNOWN_SD`). ``reasons`` and ``hints`` say why
    and what to do, in the same order. ``checked_by`` lists what in the recording tests the quantity; where it is
    empty, a wrong model would not show.
    """

    quantity: Quantity
    status: Status
    factor: float | None = Field(ge=1.0)
    reasons: tuple[str, ...] = ()
    hints: tuple[str, ...] = ()
    checked_by: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The quantity as people read it: ``cross-level``."""
        return self.quantity.replace("_", "-")

    @property
    def widening(self) -> float:
        """The factor on the model's sigmas; infinity where the quantity is not to be trusted."""
        return math.inf if self.factor is None else self.factor


def verdicts(
    doubts: Iterable[Doubt], checked_by: Mapping[Quantity, tuple[str, ...]] | None = None
) -> tuple[Verdict, ...]:
    """Return a verdict for each of :data:`QUANTITIES`, in that order.

    A doubt of factor k says that the quantity has an error of variance ``(k^2 - 1) sigma^2`` that its sigma does not
    cover. Errors of different causes are independent, so their variances add: ``k^2 = 1 + sum (k_i^2 - 1)``. Two doubts
    that saw the same cause widen by up to sqrt(2) too much, where the larger of them would widen too little if there
    were two causes; too wide is the smaller harm.
    """
    doubts = tuple(doubts)
    return tuple(_verdict(quantity, doubts, (checked_by or {}).get(quantity, ())) for quantity in QUANTITIES)


def widening(verdicts: Iterable[Verdict], quantity: Quantity) -> float:
    """Return the factor on the sigmas of a quantity; 1 where no verdict names it."""
    return next((verdict.widening for verdict in verdicts if verdict.quantity == quantity), 1.0)


def untrusted(verdicts: Iterable[Verdict]) -> str:
    """Return in words which quantities are not to be trusted; nothing where all are."""
    return ", ".join(verdict.name for verdict in verdicts if verdict.status == "not_trusted")


@dataclass(frozen=True)
class Opinion:
    """Quantities that have the same verdict; "all" where there are no others."""

    verdict: str
    quantities: tuple[str, ...]


@dataclass(frozen=True)
class Cause:
    """Why quantities have the verdicts that they have, and what to do about it; an empty hint where nothing."""

    reason: str
    quantities: tuple[str, ...]
    hint: str


def opinions(verdicts: Iterable[Verdict]) -> list[Opinion]:
    """Return verdicts as people read them, the worst first, each with its quantities."""
    groups: dict[str, list[str]] = {}
    for verdict in _worst_first(verdicts):
        groups.setdefault(_in_words(verdict), []).append(verdict.name)
    return [Opinion(verdict, tuple(names) if len(groups) > 1 else ("all",)) for verdict, names in groups.items()]


def causes(verdicts: Iterable[Verdict], findings: Iterable[Finding] = ()) -> list[Cause]:
    """Return each reason once, in the order of the verdicts that it is for; ``findings`` are those of the result."""
    withheld = any(finding.code == "fixes-withheld" for finding in findings)
    listed = _worst_first(verdicts)
    groups: dict[tuple[str, str], list[str]] = {}
    for verdict in listed:
        pairs = zip(verdict.reasons, verdict.hints, strict=True)
        for pair in dict.fromkeys(pairs) if verdict.status != "trusted" else [(_tested(verdict, withheld), "")]:
            groups.setdefault(pair, []).append(verdict.name)
    return [
        Cause(reason, tuple(names) if len(names) < len(listed) else ("all",), hint)
        for (reason, hint), names in groups.items()
    ]


def _worst_first(verdicts: Iterable[Verdict]) -> list[Verdict]:
    return sorted(verdicts, key=lambda verdict: -verdict.widening)


def _in_words(verdict: Verdict) -> str:
    if verdict.status == "widened":
        return f"sigmas widened by {verdict.widening:.2g}"
    return "trusted" if verdict.status == "trusted" else NOT_TRUSTED


def _tested(verdict: Verdict, withheld: bool) -> str:
    if not verdict.checked_by:
        return "nothing in the recording tests it: the sigma is the model's"
    agrees = "what is measured more than once agrees within its sigmas"
    return f"{agrees}, but for fixes that were withheld" if withheld and verdict.quantity == "chainage" else agrees


def _verdict(quantity: Quantity, doubts: tuple[Doubt, ...], checked_by: tuple[str, ...]) -> Verdict:
    named = sorted((doubt for doubt in doubts if quantity in doubt.quantities), key=lambda doubt: -doubt.factor)
    factor = math.sqrt(1.0 + sum(doubt.factor**2 - 1.0 for doubt in named))
    status: Status = "trusted" if factor == 1.0 else "widened" if math.isfinite(factor) else "not_trusted"
    return Verdict(
        quantity=quantity,
        status=status,
        factor=factor if math.isfinite(factor) else None,
        reasons=tuple(doubt.reason for doubt in named),
        hints=tuple(doubt.hint for doubt in named),
        checked_by=checked_by,
    )
