"""Factors are found by type: nobody outside trackfg.factors names one by its label."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import Kind

ROOT = Path(__file__).parents[2]
LABELS = {kind.value for kind in FactorType if " " in kind.value}
"""Single words, such as a path or a landmark, mean other things elsewhere."""


@pytest.mark.parametrize("package", ["trackfg", "datasets", "tools"])
def test_no_label_stands_outside_the_factors(package: str) -> None:
    modules = sorted((ROOT / package).rglob("*.py"))
    assert modules
    for module in modules:
        literals = {node.value for node in ast.walk(ast.parse(module.read_text())) if isinstance(node, ast.Constant)}
        assert not literals & LABELS, module


def test_each_kind_of_variable_has_a_prior() -> None:
    assert {FactorType[f"PRIOR_{kind.name}"].value for kind in Kind} == {f"prior on {kind.attribute}" for kind in Kind}
