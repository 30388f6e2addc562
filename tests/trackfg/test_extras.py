"""Without the extras the core works, and what needs one names it before it computes anything."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from trackfg.files.libraries import MissingLibraryError, library

PROGRAM = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"plotly", "matplotlib", "sqlalchemy", "lxml"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from trackfg.cli.main import app
from trackfg.errors import TrackfgError

for line in sys.stdin.read().splitlines():
    try:
        app(line.split(), standalone_mode=False, prog_name="trackfg")
        print("done")
    except TrackfgError as error:
        print(error)
"""

CORE = (
    "simulate no-stop -o run1 --duration 40 -q",
    "smooth run1 -o out1 -q",
    "export out1 --to csv -q",
    "statistics out1 -o s.csv -q",
)
LINE_XML = '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2"/>'
NEEDS = {
    "demo -o demo": "matplotlib charts",
    "plot out1": "matplotlib charts",
    "plot out1 -o out1.html": "plotly charts",
    "report out1": "plotly charts",
    "noise run1 -o allan.png": "matplotlib charts",
    "overlay out1 out1 -o overlay": "plotly charts",
    "simulate mainline -o run2 --line line.xml": "lxml xml",
    "map show line.gpkg": "sqlalchemy maps",
    "map build out1 -o line.gpkg": "sqlalchemy maps",
    "smooth run1 -o out2 --map line.gpkg": "sqlalchemy maps",
    "stream run1 -o live --map line.gpkg": "sqlalchemy maps",
}


@pytest.mark.slow
def test_the_core_works_and_every_command_names_the_extra_that_it_needs(tmp_path: Path) -> None:
    (tmp_path / "line.xml").write_text(LINE_XML)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input="\n".join([*CORE, *NEEDS]), cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    said = done.stdout.splitlines()
    expected = [
        f"{name} is not installed. Hint: pip install 'trackfg[{extra}]'"
        for name, extra in map(str.split, NEEDS.values())
    ]
    assert said == ["done"] * len(CORE) + expected
    assert {path.name for path in tmp_path.iterdir()} == {"run1", "out1", "out1.csv", "s.csv", "line.xml"}


def test_a_library_that_is_there_is_imported() -> None:
    assert library("json.decoder", "full").JSONDecoder
    with pytest.raises(MissingLibraryError, match=r"^no_such is not installed.*trackfg\[full\]"):
        library("no_such.part", "full")
