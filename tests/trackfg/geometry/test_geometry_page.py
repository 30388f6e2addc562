"""docs/geometry.md is true: the example is read, its table of keys is the schema's, its numbers are the functions'."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trackfg.geometry.bands import BANDS, D1, band_response, end_margin_m
from trackfg.geometry.limits import Limit, read_limits
from trackfg.geometry.moving_average import ALIGNMENT_WINDOWS_M, baseline_removed_response
from trackfg.geometry.versines import versine_response

PAGE = (Path(__file__).parents[3] / "docs" / "geometry.md").read_text(encoding="utf-8")


def row(first: str) -> list[str]:
    """The cells of the table row that begins with ``first``."""
    (line,) = (line for line in PAGE.splitlines() if line.startswith(f"| {first} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_the_example_of_limits_is_read(tmp_path: Path) -> None:
    (block,) = re.findall(r"^```toml rule.toml\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    file = tmp_path / "limits.toml"
    file.write_text(block)
    assert [limit.parameter for limit in read_limits(file)] == ["level", "alignment", "twist"]


def test_every_key_is_in_the_table() -> None:
    table = PAGE.split("| key |")[1].split("\n\n")[0]
    listed = [
        key for cell in re.findall(r"^\| ([^|]*) \|", table, flags=re.MULTILINE) for key in re.findall(r"`(\w+)`", cell)
    ]
    assert sorted(listed) == sorted(Limit.model_fields)


def test_the_operators_are_where_the_page_says() -> None:
    table = PAGE.split("## Operators and responses")[1].split("\n\n")[2]
    names = re.findall(r"^\| `(\w+)\.(\w+)`", table, flags=re.MULTILINE)
    assert len(names) == 11
    for module, function in names:
        assert callable(getattr(importlib.import_module(f"trackfg.geometry.{module}"), function))


def test_the_gains_are_the_responses() -> None:
    wavelengths = np.array([float(cell) for cell in row("wavelength, m")])
    for name, response in {
        "10 m chord": versine_response(wavelengths).real,
        "40 m chord": versine_response(wavelengths, 20.0, 20.0).real,
        "less 24 m average": baseline_removed_response(wavelengths),
        "less 24 m-18 m average": baseline_removed_response(wavelengths, ALIGNMENT_WINDOWS_M),
        "D1": band_response(wavelengths, D1),
    }.items():
        assert [float(cell) for cell in row(name)] == pytest.approx(response, abs=0.0051), name


def test_the_margins_are_the_bands() -> None:
    assert [float(cell) for cell in row("margin at a step of 0.25 m, m")] == [
        end_margin_m(0.25, BANDS[name]) for name in row("band")
    ]


def test_importing_the_operators_is_cheap() -> None:
    modules = ("versines", "moving_average", "bands", "twist", "cross_level", "gradient", "curvature", "resampling")
    program = f"import sys\nfor name in {modules}: __import__('trackfg.geometry.' + name)\n"
    program += (
        "print([name for name in ('scipy', 'pandas', 'gtsam', 'trackfg.recording.model') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
