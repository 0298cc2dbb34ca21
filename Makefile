# Everything from nothing: `make report` shows shadows of a mesh, `make test` runs the tests. Only Python ≥ 3.11 needed.
.DEFAULT_GOAL := help
SHELL := /bin/bash
# A Python of 3.11 or later on the path; override with `make PYTHON=… …`.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3 python; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && { echo "$$p"; break; }; done)
BIN := .venv/bin
REPORT_ARGS ?=
BENCH_ARGS ?=

.PHONY: help install peers lowest report test test-long lint docs bench experiments clean

help: ## list what can be made
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 22

.venv/.installed: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "no Python 3.11 or later found; install one or say make PYTHON=/path/to/python"; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,docs,dev,meshes]'
	@touch $@

install: .venv/.installed ## local environment in .venv

peers: .venv/.installed ## the other ray casters that `make bench` compares with
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[peers]'

.venv-lowest/.installed: pyproject.toml tests/lowest_versions.py
	$(PYTHON) -m venv --clear .venv-lowest
	$(PYTHON) tests/lowest_versions.py > .venv-lowest/constraints.txt
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check -c .venv-lowest/constraints.txt -e '.[meshes]'
	@touch $@

lowest: .venv-lowest/.installed ## a walk through the package with the lowest versions that pyproject.toml allows
	.venv-lowest/bin/python -m tests.smoke

report: .venv/.installed ## shadows of the default scene, compared with the exact answer → out/index.html
	$(BIN)/shadowjax report $(REPORT_ARGS)

test: .venv/.installed ## the whole suite
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-long: .venv/.installed ## the suite with its long tests: large fuzzing, random scenes
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --long

lint: .venv/.installed ## ruff, pyright, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python tests/type_completeness.py

docs: .venv/.installed ## the documentation site → docs/_build/html
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

bench: .venv/.installed ## this machine: the package and whatever peers are installed → benchmarks/results.json
	$(BIN)/python -m tests.benchmarks --page docs/_measured/benchmarks.md $(BENCH_ARGS)
	$(BIN)/python -m pytest tests/benchmarks --benchmark-enable --benchmark-only -p no:xdist

experiments: .venv/.installed ## every figure and table with its claims
	$(BIN)/python -m experiments all

clean: ## remove what make has made
	rm -rf .venv .venv-lowest docs/_build out .jax_cache .pytest_cache .ruff_cache
