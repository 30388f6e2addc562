"""Formats of other packages are found by their entry points, and take precedence."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from trackfg.interchange.exporting.registry import result_formats
from trackfg.interchange.importing.registry import source_format, source_formats

MODULE = """
from trackfg.interchange.exporting.result_format import ResultFormat
from trackfg.interchange.importing.source_format import SourceFormat

class Ours(SourceFormat):
    key, title = "ours", "our logger"
    def recognises(self, path):
        return path.suffix == ".csv" and path.read_text().startswith("OURS")
    def tables(self, path, dialect_for):
        return []

class OurResult(ResultFormat):
    key, suffix, title = "ours", ".ours", "our format"
    def write(self, result, path, options):
        path.write_text("ours")
"""


def test_formats_of_another_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "our_formats.py").write_text(MODULE)
    (about := tmp_path / "our_formats-1.0.dist-info").mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: our-formats\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[trackfg.source_formats]\nours = our_formats:Ours\n[trackfg.result_formats]\nours = our_formats:OurResult\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    (log := tmp_path / "log.csv").write_text("OURS\n")
    try:
        assert source_format(log).key == "ours"
        assert {"ours", "text"} <= set(source_formats())
        assert {"ours", "csv"} <= set(result_formats())
    finally:
        sys.modules.pop("our_formats", None)
