"""Quick imports give the same modules, without what is not used."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys

import pytest

from trackfg.cli.quick_imports import quick_imports


def printed(program: str) -> list[str]:
    """What a program in a process of its own prints after quick imports of scipy."""
    begin = "from trackfg.cli.quick_imports import quick_imports\nimport sys\nwith quick_imports():\n"
    imports = "".join(f"    import scipy.{name}\n" for name in ("linalg", "ndimage", "special"))
    command = [sys.executable, "-c", begin + imports + program]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()


def test_nobody_gets_a_docstring_while_modules_are_imported() -> None:
    with quick_imports():
        assert inspect.getdoc(quick_imports) is None
    assert inspect.getdoc(quick_imports)


def test_docstrings_are_there_again_after_an_import_that_fails() -> None:
    with pytest.raises(ImportError), quick_imports():
        raise ImportError
    assert inspect.getdoc(quick_imports)


def test_scipy_computes_as_ever() -> None:
    assert printed("print(scipy.special.ndtr(0.0), *scipy.ndimage.uniform_filter1d([0.0, 3.0, 0.0], 3))") == [
        "0.5",
        "1.0",
        "1.0",
        "1.0",
    ]


def test_what_is_not_used_is_imported_when_it_is() -> None:
    used = "import numpy.testing; numpy.testing.assert_allclose(1.0, 1.0); import numpy.f2py; numpy.f2py.get_include()"
    there = "print('unittest' in sys.modules, 'numpy.f2py.crackfortran' in sys.modules)\n"
    assert printed(there + used + "\n" + there) == ["False", "False", "True", "True"]


@pytest.mark.parametrize("declared", [None, "2"])
def test_linear_algebra_has_one_thread_unless_the_environment_says_how_many(
    declared: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if declared is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", declared)
    pools = "from threadpoolctl import threadpool_info; print(*{pool['num_threads'] for pool in threadpool_info()})\n"
    there = "import os; print('OPENBLAS_NUM_THREADS' in os.environ)"
    threads, is_declared = printed(pools + there)
    assert threads == str(min(int(declared or 1), os.cpu_count() or 1))
    assert is_declared == str(declared is not None)
