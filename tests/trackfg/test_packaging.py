"""Wheel, source distribution and editable install hold the same package, under one top-level name."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import trackfg

ROOT = Path(__file__).parents[2]
PARTS = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "kernels", "trackfg", "factors", "datasets")

IMPORTS = """
import importlib.util, json, trackfg, trackfg.factors, trackfg.datasets, trackfg.factors.family
import trackfg.datasets.real.kitti
from importlib.metadata import version
from trackfg.numerics.kernels import kernels_in_use
from importlib.resources import files

def home(name):
    spec = importlib.util.find_spec(name)
    return spec.origin if spec else None

print(json.dumps({
    "version": version("trackfg"),
    "typed": files("trackfg").joinpath("py.typed").is_file(),
    "kernels": kernels_in_use(),
    "homes": [module.__file__ for module in (trackfg, trackfg.factors, trackfg.datasets)],
    "strangers": [home("factors"), home("datasets")],
}))
"""


COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
COMPILED = "compiled" if COMPILER else "numpy"
WITHOUT_OPTIMISING = f"""#!/bin/sh
for word; do case $word in kernels/*.cpp) kept=$0.${{word#kernels/}} ;; *.o) object=$word ;; esac; done
[ "$kept" ] || exec {COMPILER} "$@"
[ -e "$kept" ] && exec cp "$kept" "$object"
{COMPILER} "$@" -O0 && cp "$object" "$kept"
"""
"""A compiler that compiles every kernel once: the distributions and the editable install have the same."""


def run(*command: object, cwd: Path, **variables: str) -> str:
    words, environment = [str(part) for part in command], {**os.environ, **variables}
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def copied(folder: Path) -> Path:
    """What is packaged, apart from the checkout, so that building leaves nothing there."""
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        else:
            shutil.copy(ROOT / part, folder / part)
    return folder


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copied(tmp_path_factory.mktemp("source"))


@pytest.fixture(scope="module")
def compiler(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment variables that name the compiler; none without one, or where there is no shell to run it."""
    if COMPILER is None or os.name != "posix":
        return {}
    program = tmp_path_factory.mktemp("compiler") / "c++"
    program.write_text(WITHOUT_OPTIMISING)
    program.chmod(0o755)
    return {"CC": str(program), "CXX": str(program)}


@pytest.fixture(scope="module")
def tools(compiler: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment variables with what a build needs and nothing else, installed once, and with the compiler."""
    folder = tmp_path_factory.mktemp("tools")
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", "--target", folder, *needed, cwd=folder)
    return {**compiler, "PYTHONPATH": str(folder)}


@pytest.fixture(scope="module")
def distributions(source: Path, tools: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(source distribution, wheel built from it)."""
    out = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, source, cwd=out, **tools)
    (sdist,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    return sdist, wheel


def new_environment(folder: Path) -> Path:
    """An environment of its own with the dependencies, but not the trackfg, of the present one. Its Python."""
    run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip()
    (Path(site) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def install(python: Path, *what: object, cwd: Path, **variables: str) -> None:
    """Install, with environment variables beside those there are."""
    pip = [sys.executable, "-m", "pip", "--python", python, "install"]
    command = [*pip, "--quiet", "--no-deps", "--no-compile", *what]
    run(*command, cwd=cwd, **variables)


def assert_installed(python: Path, below: Path, cwd: Path, kernels: str = COMPILED) -> None:
    report = json.loads(run(python, "-c", IMPORTS, cwd=cwd))
    assert report["version"] == trackfg.__version__
    assert report["typed"]
    assert report["kernels"] == kernels
    assert all(Path(home).resolve().is_relative_to(below.resolve()) for home in report["homes"])
    assert not any(home and Path(home).resolve().is_relative_to(below.resolve()) for home in report["strangers"])
    assert run(python.parent / "trackfg", "--version", cwd=cwd) == f"trackfg {trackfg.__version__}\n"
    assert "mainline" in run(python, "-m", "trackfg", "scenarios", cwd=cwd)


def test_what_is_published_names_one_version() -> None:
    assert f"\nversion: {trackfg.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {trackfg.__version__}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.slow
def test_wheel(distributions: tuple[Path, Path], tmp_path: Path) -> None:
    _, wheel = distributions
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert tops == {"trackfg", f"trackfg-{trackfg.__version__}.dist-info"}
    python = new_environment(tmp_path / "env")
    install(python, "--no-index", wheel, cwd=tmp_path)
    assert_installed(python, tmp_path / "env", tmp_path)


@pytest.mark.slow
def test_source_distribution(distributions: tuple[Path, Path]) -> None:
    sdist, _ = distributions
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {*PARTS, "trackfg/py.typed", "factors/family.py", "datasets/real/kitti.py"} <= names
    assert {f"kernels/{path.name}" for path in (ROOT / "kernels").iterdir()} <= names


@pytest.mark.slow
def test_editable_install(source: Path, tools: dict[str, str], tmp_path: Path) -> None:
    python = new_environment(tmp_path / "env")
    install(python, "--no-build-isolation", "--editable", source, cwd=tmp_path, **tools)
    assert_installed(python, source, tmp_path)


@pytest.mark.slow
def test_without_a_compiler_numpy_computes_and_one_line_says_so(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    python, missing = new_environment(tmp_path / "env"), "/no/compiler"
    install(python, "--log", tmp_path / "log", copied(source), cwd=tmp_path, CC=missing, CXX=missing)
    said = [line for line in (tmp_path / "log").read_text().splitlines() if "without compiled kernels" in line]
    assert len(said) == 1
    assert "trackfg is installed without compiled kernels and computes with numpy, slower" in said[0]
    assert_installed(python, tmp_path / "env", tmp_path, kernels="numpy")


def test_public_names_are_imported_when_first_used() -> None:
    program = (
        "import sys, trackfg; print(sorted({'numpy', 'pandas', 'gtsam', 'pydantic'} & set(sys.modules)))\n"
        "public = trackfg.__all__\n"
        "print([name for name in public if not hasattr(trackfg, name)], set(dir(trackfg)) >= set(public))"
    )
    assert run(sys.executable, "-c", program, cwd=ROOT) == "[]\n[] True\n"


def test_unknown_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="no attribute 'smoothe'"):
        trackfg.smoothe  # noqa: B018


@pytest.mark.skipif(
    not Path(sysconfig.get_path("purelib"), "trackfg_checkout.pth").exists(),
    reason="`make` did not make the environment",
)
def test_a_clone_beside_python_does_not_hide_the_package(tmp_path: Path) -> None:
    (tmp_path / "trackfg" / "trackfg").mkdir(parents=True)
    (tmp_path / "trackfg" / "trackfg" / "__init__.py").touch()
    code = "import trackfg, trackfg.factors, trackfg.datasets; trackfg.smooth"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
