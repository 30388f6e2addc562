"""XML of strangers is parsed without what a document could reach or grow by: entities, other files, the network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from trackfg.errors import BadInputError
from trackfg.files.libraries import library


def xml_root(content: bytes, path: Path, expected: str) -> Any:
    """Return the root of a document, without comments and processing instructions.

    Raises :class:`BadInputError`, with ``path`` and what was ``expected``, for what is not well-formed and for a
    document type; :class:`MissingLibraryError` without lxml.
    """
    etree = library("lxml.etree", "xml")
    parser = etree.XMLParser(
        resolve_entities=False, load_dtd=False, no_network=True, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise BadInputError(f"{path}: not well-formed XML: {error.msg}: expected {expected}") from error
    if root.getroottree().docinfo.doctype:
        raise BadInputError(f"{path}: has a document type (DOCTYPE), which may define entities: remove it")
    return root
