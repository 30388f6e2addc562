"""Compile the kernels where there is a C++ compiler; without them trackfg computes the same with numpy, slower."""

from __future__ import annotations

from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

SOURCES = sorted(Path("kernels").glob("*.cpp"))


class BuildKernels(build_ext):
    """The extension is optional, and its absence is one line."""

    def warn(self, msg: str) -> None:
        """Say what is missing in one line (setuptools calls this where an optional extension cannot be built)."""
        reason = str(msg).splitlines()[0]
        super().warn(f"trackfg is installed without compiled kernels and computes with numpy, slower ({reason})")


kernels = Extension(
    "trackfg.numerics.compiled",
    [str(path) for path in SOURCES],
    depends=[str(path) for path in sorted(Path("kernels").glob("*.h"))],
    # -g0: no paths of the build in it
    extra_compile_args=["-std=c++17", "-O3", "-g0", "-fvisibility=hidden", "-pthread"],
    extra_link_args=["-pthread"],
    language="c++",
    optional=True,
    py_limited_api=True,
)

setup(
    ext_modules=[kernels] if SOURCES else [],
    cmdclass={"build_ext": BuildKernels},
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
