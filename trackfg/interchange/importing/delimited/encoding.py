"""The encoding of a text, guessed from its first bytes."""

from __future__ import annotations

import re
from pathlib import Path

from trackfg.errors import BadInputError

_SHORT_WORD = 3


def encoding_of(sample: bytes, path: Path) -> str:
    """Return the encoding of the first bytes of a file. Raises :class:`BadInputError` where they are no text."""
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if sample.startswith(mark):
            return name
    if b"\0" in sample:
        wide = _wide_encoding(sample)
        if wide is None:
            raise BadInputError(f"{path.name}: is not text (it has null bytes); expected delimited text")
        return wide
    whole = sample[: sample.rfind(b"\n") + 1 or len(sample)]
    if not _decodes(whole, "utf-8") and _is_chinese(sample):
        return "gb18030"
    encoding = next((name for name in ("utf-8", "cp1252", "cp932") if _decodes(whole, name)), "cp1252")
    is_cyrillic = encoding == "cp1252" and _is_cyrillic(whole) and _decodes(whole, "cp1251")
    return "cp1251" if is_cyrillic else encoding


def _decodes(sample: bytes, encoding: str) -> bool:
    try:
        sample.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _wide_encoding(sample: bytes) -> str | None:
    """Return UTF-16 without a mark, of which most characters of a table have one null byte; else None."""
    for name, nulls in (("utf-16-le", sample[1::2]), ("utf-16-be", sample[::2])):
        text = sample[: len(sample) // 2 * 2]
        if nulls.count(0) > 0.8 * len(nulls) and sample.count(0) < 1.1 * nulls.count(0) and _decodes(text, name):
            return name
    return None


def _is_chinese(sample: bytes) -> bool:
    """Return whether bytes above 127 come in pairs of GB 2312, as single letters with accents do not."""
    letters = re.findall(rb"[\x80-\xff]+", sample)
    return bool(letters) and all(re.fullmatch(rb"([\xa1-\xf7][\xa1-\xfe])+", run) for run in letters)


def _is_cyrillic(sample: bytes) -> bool:
    """Return whether most bytes above 127 are in words of them, as letters with accents are not."""
    letters = re.findall(rb"[\xc0-\xff\xa8\xb8]+", sample)
    in_words = sum(len(run) for run in letters if len(run) >= _SHORT_WORD)
    return 2 * in_words > sum(map(len, letters)) > 0


def decoded(sample: bytes, encoding: str, path: Path) -> str:
    """Return bytes as text. Raises :class:`BadInputError` for an encoding that is none."""
    try:
        return sample.decode(encoding, errors="replace")
    except LookupError:
        raise BadInputError(f"{path.name}: unknown encoding {encoding!r}; expected one such as utf-8, cp1252") from None
