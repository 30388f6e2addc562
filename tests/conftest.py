"""What all tests share: numpy and the compiled kernels in turn, commands that Ctrl-C ends, no time limits, refusals,
and modules that are compiled once.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import trackfg
from trackfg.numerics.kernels import compiled_kernels

# A shell has what it starts in the background ignore Ctrl-C, and so does all that is started from there: tests that
# interrupt a command would wait for ever.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# To compile the loop of python-ins takes as long as to run it uncompiled over 300 s at 200 Hz; tests have less.
os.environ.setdefault("NUMBA_DISABLE_JIT", "1")

# How long an example takes says nothing on a machine that has other work.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

_FOLDER = "compiled_modules"
_COMPILED = pytest.StashKey[str]()


def pytest_configure(config: pytest.Config) -> None:
    """Give the interpreters that tests start one folder for compiled modules where the environment has Python write
    none, and has none yet: each would compile all that it imports anew, which takes a command longer than its work. The
    process of the tests, and its workers, use no such folder: libraries that are compiled in them would warn, which is
    an error.
    """
    if "PYTHONDONTWRITEBYTECODE" not in os.environ or all(map(_is_compiled, (np, trackfg))):
        return
    folder = getattr(config, "workerinput", {}).get(_FOLDER)
    if folder is None:
        made = tempfile.TemporaryDirectory(prefix="compiled-modules-", ignore_cleanup_errors=True)
        config.add_cleanup(made.cleanup)
        config.stash[_COMPILED] = folder = made.name
    if not config.getoption("numprocesses", None):
        del os.environ["PYTHONDONTWRITEBYTECODE"]
        os.environ["PYTHONPYCACHEPREFIX"] = folder


def _is_compiled(module: ModuleType) -> bool:
    """Return whether a module was compiled where it is installed, and with it the others there."""
    assert module.__file__ is not None
    return Path(importlib.util.cache_from_source(module.__file__)).exists()


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Give all workers the folder for compiled modules."""
    if _COMPILED in node.config.stash:
        node.workerinput[_FOLDER] = node.config.stash[_COMPILED]


@pytest.fixture(params=["numpy", "compiled"])
def kernels(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Every test that uses this runs with numpy, and with the compiled kernels where they are installed."""
    if request.param == "compiled" and not compiled_kernels():
        pytest.skip("trackfg is installed without compiled kernels")
    monkeypatch.setenv("TRACKFG_KERNELS", request.param)
    compiled_kernels.cache_clear()
    yield str(request.param)
    compiled_kernels.cache_clear()


@pytest.fixture
def with_both(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], tuple[Any, Any]]:
    """Return what a function returns with the compiled kernels, and what it returns with numpy."""
    if not compiled_kernels():
        pytest.skip("trackfg is installed without compiled kernels")

    def both(function: Callable[[], Any]) -> tuple[Any, Any]:
        compiled = function()
        monkeypatch.setenv("TRACKFG_KERNELS", "numpy")
        compiled_kernels.cache_clear()
        theirs = function()
        monkeypatch.delenv("TRACKFG_KERNELS")
        compiled_kernels.cache_clear()
        return compiled, theirs

    return both


@pytest.fixture
def refusal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return what the command of a tool says, in this process, of arguments that it refuses as such."""

    def refused(tool: str, *arguments: str) -> str:
        monkeypatch.syspath_prepend(Path(__file__).parents[1] / "tools")
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # tools set it when they are imported, for good
        monkeypatch.setattr(sys, "argv", [f"{tool}.py", *arguments])
        with pytest.raises(SystemExit) as end:
            importlib.import_module(f"{tool}.main").main()
        assert end.value.code == 2
        return capsys.readouterr().err

    return refused
