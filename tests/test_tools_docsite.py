"""What the site has beside the pages: navigation, glossary, outputs of tutorials; and the check of its links."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
TOOLS = ROOT / "tools"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> ModuleType:
    pytest.importorskip("sphinx")
    pytest.importorskip("pyte")
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module(request.param)


def of(name: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("module", [name], indirect=True, ids=[name])


@of("docsite.navigation")
def test_lists_become_the_navigation(module: ModuleType) -> None:
    lists = "- [One](a/one.md): text\n- no [link](two.md) first\n- [Out](https://x.org/y.md)\n"
    text = f"{lists}| a | b | [Three](three.md) |\n"
    lines = module.with_toctree(text).split("```{toctree}")[1].splitlines()
    assert [line for line in lines if "<" in line] == ["One <a/one>", "Three <three>"]


@of("docsite.navigation")
def test_links_to_the_root_lead_to_the_pages_that_stand_for_it(module: ModuleType) -> None:
    text = "[a](../README.md#use-it) [b](../CHANGELOG.md#020) [c](../factors/path.py) [d](maps.md)"
    expected = "[a](index.md) [b](project/changelog.md#020) [c](../factors/path.py) [d](maps.md)"
    assert module.with_root_documents(text, "maps") == expected
    shown = module.of_root("[a](docs/maps.md#grid) [b](SECURITY.md) [c](https://x.org)", "project/changelog")
    assert shown == "[a](../maps.md#grid) [b](security.md) [c](https://x.org)"


@of("docsite.glossary")
def test_the_glossary_has_the_terms_of_concepts(module: ModuleType) -> None:
    terms = dict(module.terms((ROOT / "docs" / "concepts.md").read_text(encoding="utf-8")))
    assert len(terms) >= 50
    assert terms["fix"] == "an absolute chainage: balise, RFID tag, mile post"
    assert terms["hole"].startswith("samples are missing")
    assert list(terms) == sorted(terms, key=str.casefold)


@of("docsite.signatures")
def test_signatures_are_lists_and_other_definition_lists_stay(module: ModuleType) -> None:
    signature = "(\n\n<dl>\n<dd><em>a</em>,</dd>\n<dd><em>b</em>,</dd>\n</dl>\n\n)"
    terms = "<dl>\n<dt>a</dt>\n<dd>b</dd>\n</dl>\n"
    listed = '(\n\n<ul class="parameters">\n<li><em>a</em>,</li>\n<li><em>b</em>,</li>\n</ul>\n\n)'
    assert module.with_lists(signature + terms) == listed + terms


@of("docsite.constants")
def test_an_exported_constant_has_the_docstring_of_its_definition(module: ModuleType) -> None:
    importlib.import_module("trackfg.curves")
    assert module.docstring_of("trackfg.curves.CURVE_COLUMNS")[0] == "Columns of :func:`curve_table`."


@of("docsite.tutorials")
def test_outputs_stand_beneath_their_blocks(
    module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("first_hour.pages.ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text("a\n\n```sh\none\ntwo\n```\n\nb\n\n```python\n3\n```\n\n<!-- figure: x.png | A\npicture. -->\n")
    text = module.with_outputs(page, page.read_text(), {3: "first", 10: "second"}, "made")
    order = [
        text.index(part)
        for part in ("two\n```", "first", "\nb\n", "3\n```", "second", "made/x.png", ":alt: A picture.")
    ]
    assert order == sorted(order)


@of("docsite.tutorials")
def test_progress_is_gone_from_what_is_shown(module: ModuleType) -> None:
    assert module.on_screen("10 %\r100 %\r\x1b[2Kdone\r\n\x1b[1mresult\x1b[0m: out\r\n") == "done\nresult: out"


@of("site_links")
@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<a href="other.html#there">x</a> <a href="https://x.org">x</a>', None),
        ('<a href="missing.html">x</a>', "is not there"),
        ('<a href="other.html#nowhere">x</a>', "has no such heading"),
        ('<a href="../outside.html">x</a>', "leaves the site"),
        ('<script src="https://cdn.x.org/a.js"></script>', "is loaded from a network"),
        ('<link rel="stylesheet" href="s.css">', "is loaded from a network"),
    ],
)
def test_links_that_lead_nowhere_are_faults(module: ModuleType, tmp_path: Path, body: str, fault: str | None) -> None:
    (tmp_path / "other.html").write_text('<h1 id="there">there</h1>')
    (tmp_path / "page.html").write_text(f"<html><body>{body}</body></html>")
    if "s.css" in body:
        (tmp_path / "s.css").write_text("@font-face { src: url(https://fonts.x.org/a.woff2) }")
    faults = list(module.faults(tmp_path))
    assert [each.rsplit(": ", 1)[1] for each in faults] == ([] if fault is None else [fault])
