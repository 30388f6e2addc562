"""An antenna whose place was never declared looks like late clocks and wrong fixes: findings that it causes name it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackfg.recording.description import Gnss
from trackfg.recording.findings import Finding

_CODES = {"gnss-clock", "gnss-delay", "gnss-level", "gnss-speed-clock", "fixes-withheld"}
_CLOCK_OF_A_TACH = ("tach-", "-clock")

_HINT = "declare gnss.lever_arm_m if the antenna is not at the reference point"


def is_declared(gnss: Gnss) -> bool:
    """Return whether a recording says where the antenna is, be it at the reference point."""
    return "lever_arm_m" in gnss.model_fields_set


def with_antenna_named(findings: Iterable[Finding], gnss: Gnss | None) -> tuple[Finding, ...]:
    """Return findings of which those that an antenna elsewhere causes name its lever arm, where none is declared.

    An antenna l ahead is where the vehicle is l / v later: at one speed it cannot be separated from a clock.
    """
    if gnss is None or is_declared(gnss):
        return tuple(findings)
    return tuple(
        replace(finding, hint=_named(finding.hint)) if _may_be_its(finding.code) else finding for finding in findings
    )


def _may_be_its(code: str) -> bool:
    begin, end = _CLOCK_OF_A_TACH
    return code in _CODES or (code.startswith(begin) and code.endswith(end))


def _named(hint: str | None) -> str:
    return _HINT if hint is None else f"{hint}; or {_HINT}"
