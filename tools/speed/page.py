"""A page has its prose, and between remarks what is measured: ``<!-- speed: NAME -->`` to ``<!-- speed end -->``."""

from __future__ import annotations

import re

_PART = re.compile(r"(?P<begin><!-- speed: (?P<name>\S+) -->\n).*?(?P<end><!-- speed end -->)", re.DOTALL)


def filled(page: str, parts: dict[str, str]) -> str:
    """Return the page with these parts anew; what was not measured stays.

    Raises ``ValueError`` where the page has no place for a part.
    """
    missing = parts.keys() - {part["name"] for part in _PART.finditer(page)}
    if missing:
        raise ValueError(f"no place on the page for {', '.join(sorted(missing))}")

    def anew(part: re.Match[str]) -> str:
        if part["name"] not in parts:
            return part[0]
        return f"{part['begin']}\n{parts[part['name']].strip()}\n\n{part['end']}"

    return _PART.sub(anew, page)
