"""Do all links within a site lead somewhere, and does no page need a network?

Every page that Sphinx wrote is read: a link to a page, a file or a heading of the same site has to find it, and
scripts, style sheets, pictures and fonts have to be part of the site. Exit status 1 and a line per fault if not.

    python tools/site_links.py build/docs
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import html

_LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "object": "data"}
"""Elements of a page with the attribute that says what a browser loads for them."""
_NOT_LOADED = {"canonical", "next", "prev", "author", "search", "index", "help", "top", "up", "license"}
"""Relations of a ``link`` that load nothing."""
_URL = re.compile(r"url\(['\"]?(?P<url>[^'\")]+)|@import ['\"](?P<import>[^'\"]+)")


def faults(site: Path) -> Iterator[str]:
    """List what is wrong with the pages and style sheets of a site, a line each."""
    site = site.resolve()
    for page in sorted(site.rglob("*.html")):
        name = page.relative_to(site)
        if name.parts[0] == "_static":  # templates of the theme, no pages
            continue
        for element in _parsed(page).iter("a", *_LOADED):
            attribute = _LOADED.get(element.tag, "href")
            link = element.get(attribute)
            if link is None or element.get("rel") in _NOT_LOADED:
                continue
            fault = _fault(site, page, link, loaded=element.tag in _LOADED)
            if fault:
                yield f"{name}: {link}: {fault}"
    for sheet in sorted(site.rglob("*.css")):
        for match in _URL.finditer(sheet.read_text(encoding="utf-8")):
            link = match["url"] or match["import"]
            fault = None if link.startswith("#") else _fault(site, sheet, link, loaded=True)
            if fault:
                yield f"{sheet.relative_to(site)}: {link}: {fault}"


def _fault(site: Path, page: Path, link: str, *, loaded: bool) -> str | None:
    parts = urlsplit(link)
    if parts.scheme == "data":
        return None
    if parts.scheme or parts.netloc:
        return "is loaded from a network" if loaded else None
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    if not target.is_relative_to(site):
        return "leaves the site"
    if not target.is_file():
        return "is not there"
    if parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in _ids(target):
        return "has no such heading"
    return None


@cache
def _parsed(page: Path) -> html.HtmlElement:
    return html.parse(page, html.HTMLParser(encoding="utf-8")).getroot()


@cache
def _ids(page: Path) -> frozenset[str]:
    return frozenset(map(str, _parsed(page).xpath("//@id | //a/@name")))


def main() -> int:
    """Print the faults of a site."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path)
    site = parser.parse_args().site
    pages = sum(1 for _ in site.rglob("*.html"))
    if not pages:
        parser.error(f"{site}: expected a folder with pages")
    problems = list(faults(site))
    print(*problems, f"{pages} pages, {len(problems)} faults", sep="\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
