# `make demo` and `make test` do everything on a fresh machine: they make their own environment in .venv first.

SHELL := /bin/bash
.DELETE_ON_ERROR:
.PHONY: help demo test pages docs test-fast check bench lint installed types layers release clean

PYTHON ?= $(shell for python in python3 python3.14 python3.13 python3.12 python3.11; do \
	if $$python -c 'import sys; sys.exit(not (3, 11) <= sys.version_info)' 2>/dev/null; \
	then echo $$python; break; fi; done)
READY := .venv/.ready
BIN := .venv/bin

help:
	@echo "make demo       simulate, smooth and compare a measuring car's run; pages and results into demo/"
	@echo "make test       run every test but those of pages"
	@echo "make pages      run every block of docs as printed"
	@echo "make docs       make a site of docs in build/docs: tutorials carried out, links checked"
	@echo "make test-fast  run the tests that take no more than a few seconds each"
	@echo "make check      lint, format, types and layers"
	@echo "make bench      measure whether smoothing has become slower or larger than at the last commit (BASE=commit)"
	@echo "make release    build the distributions into dist/, twice, and try them in an empty environment"
	@echo "make clean      remove the environment and everything that was built"

demo: $(READY)
	$(BIN)/trackfg demo -o demo

# Two workers take two cores: threads of linear algebra beside them would only wait for each other.
test test-fast: export OPENBLAS_NUM_THREADS = 1

test: $(READY)
	$(BIN)/python -m compileall -q trackfg factors datasets tools
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not pages"

pages: $(READY)
	$(BIN)/python -m pytest -m pages

docs: $(READY)
	rm -rf build/docs docs/api/generated
	$(BIN)/python -m sphinx -W --keep-going -q -d build/doctrees docs build/docs
	$(BIN)/python tools/site_links.py build/docs

test-fast: $(READY)
	$(BIN)/python -m compileall -q trackfg factors datasets tools
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow and not pages"

check: lint types layers

BASE ?= HEAD
bench: $(READY)
	$(BIN)/python tools/paired_speed.py --against $(BASE)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# Types and layers are checked on what is installed: only there are factors/ and datasets/ at trackfg.factors and
# trackfg.datasets.
installed: $(READY)
	rm -rf build
	$(BIN)/python -m pip install --quiet --no-deps --target build/installed .

types: installed
	cd build/installed && ../../$(BIN)/mypy --config-file ../../pyproject.toml -p trackfg

layers: installed
	cd build/installed && ../../$(BIN)/lint-imports ../../pyproject.toml --no-logo

release: $(READY)
	$(BIN)/python -m pip install --quiet --editable ".[release]"
	$(BIN)/python tools/release.py

# In Python that runs beside it a folder named trackfg, as a clone is, takes the place of a package that is installed
# editable, unless that is on the path.
define ON_PATH
import os, pathlib, sysconfig
pathlib.Path(sysconfig.get_path("purelib"), "trackfg_checkout.pth").write_text(os.getcwd() + os.linesep)
endef
export ON_PATH

# pip compiles what it installs, but nothing editable: where the environment has Python write no bytecode, every command
# would compile it anew.
$(READY): pyproject.toml setup.py $(wildcard kernels/*)
	@if [ -z "$(PYTHON)" ]; then \
		echo "trackfg needs Python 3.11 or later, and none was found; name yours: make PYTHON=/path/to/python3" >&2; exit 1; fi
	$(PYTHON) -m venv .venv || { echo "this Python cannot make virtual environments (Debian, Ubuntu: apt install python3-venv)" >&2; exit 1; }
	$(BIN)/python -m pip install --upgrade pip
	$(BIN)/python -m pip install --editable ".[dev]"
	$(BIN)/python -m compileall -q trackfg factors datasets tools
	$(BIN)/python -c "$$ON_PATH"
	touch $@

clean:
	rm -rf .venv build dist demo
