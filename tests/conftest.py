"""Tests that run with numpy and with the compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from trackfg.numerics.kernels import compiled_kernels


@pytest.fixture(params=["numpy", "compiled"])
def kernels(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every test that uses this runs with numpy, and with the compiled kernels where they are installed."""
    if request.param == "compiled" and not compiled_kernels():
        pytest.skip("trackfg is installed without compiled kernels")
    monkeypatch.setenv("TRACKFG_KERNELS", request.param)
    return str(request.param)


@pytest.fixture
def with_both(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], tuple[Any, Any]]:
    """Return what a function returns with the compiled kernels, and what it returns with numpy."""
    if not compiled_kernels():
        pytest.skip("trackfg is installed without compiled kernels")

    def both(function: Callable[[], Any]) -> tuple[Any, Any]:
        compiled = function()
        monkeypatch.setenv("TRACKFG_KERNELS", "numpy")
        theirs = function()
        monkeypatch.delenv("TRACKFG_KERNELS")
        return compiled, theirs

    return both
