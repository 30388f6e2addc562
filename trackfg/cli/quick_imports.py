"""Modules are imported without what takes time meanwhile, and no command needs.

scipy parses the docstrings of some 240 functions when it is imported, and writes them anew with a note of the arrays
that each works on. It also copies all names of numpy, by which numpy imports its compiler of Fortran and its tools for
tests. Together they are a seventh of what ``trackfg smooth`` takes to import.

OpenBLAS, of which numpy and scipy have one each, starts its threads when it is loaded, and these look for work for a
while: a tenth of a second of CPU time, for threads that nothing uses (:mod:`trackfg.numerics.blas_threads`).
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import LazyLoader, find_spec, module_from_spec

_UNUSED = ("numpy.f2py", "numpy.testing")

_THREADS = "OPENBLAS_NUM_THREADS"


@contextmanager
def quick_imports() -> Iterator[None]:
    """Import inside this: whoever asks for the docstring of a function meanwhile gets none, as under ``python -OO``.

    Linear algebra that is loaded has one thread, unless the environment says how many.
    """
    is_open = _THREADS not in os.environ
    if is_open:
        os.environ[_THREADS] = "1"
    for name in _UNUSED:
        _import_at_first_use(name)
    attributes = vars(inspect)
    getdoc = attributes["getdoc"]
    attributes["getdoc"] = _no_docstring
    try:
        yield
    finally:
        attributes["getdoc"] = getdoc
        if is_open:
            del os.environ[_THREADS]


def _no_docstring(_: object) -> None:
    """Stand for :func:`inspect.getdoc`."""


def _import_at_first_use(name: str) -> None:
    """Import a module of a package when the first of its attributes is used ("Implementing lazy imports" in Python's
    documentation of ``importlib``); one that is there already, or is not installed, is left alone.
    """
    spec = find_spec(name)
    if name in sys.modules or spec is None or spec.loader is None:
        return
    spec.loader = LazyLoader(spec.loader)
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    package, _, attribute = name.rpartition(".")
    setattr(sys.modules[package], attribute, module)
