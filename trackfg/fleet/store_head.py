"""The head of a store, a small file in it, says that a folder is one."""

from __future__ import annotations

from trackfg.files.small_file import json_of
from trackfg.fleet.places import exists, joined, read

FORMAT = "trackfg-store/1"
HEAD = "store.json"


def is_store(place: str) -> bool:
    """Return whether there is a store at a place."""
    head = joined(place, HEAD)
    return exists(head) and is_head(head)


def is_head(head: str) -> bool:
    """Return whether a file is the head of a store."""
    try:
        content = json_of(read(head))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT
