# `make run` simulates the main scene; `make test` checks everything. Both build .venv where it is missing.
PYTHON ?= python3
SCENE ?= scenes/pipe.toml
VENV := .venv
BIN := $(VENV)/bin
NAME := $(basename $(notdir $(SCENE)))

.PHONY: run test lint docs benchmark keys clean

run: $(VENV)/.installed
	@mkdir -p output
	$(BIN)/kinetic-solver run $(SCENE) -o output/$(NAME).nc --overwrite
	$(BIN)/kinetic-solver plot output/$(NAME).nc -o output/$(NAME).png --overwrite

test: $(VENV)/.installed lint
	$(BIN)/python -m pytest -q -n 2

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site, in build/docs: its examples run, and warnings are errors.
docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

$(VENV)/.docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

benchmark: $(VENV)/.installed
	$(BIN)/python -m benchmarks

$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; set PYTHON=...")'
	@echo "installing into $(VENV), once: a minute or two"
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# The schema of scenes and the table of their keys, after a key has changed.
keys: $(VENV)/.installed
	$(BIN)/python -c 'from pathlib import Path; from kinetic_solver.scene.schema import write; write(Path("."))'

clean:
	rm -rf $(VENV) output build docs/examples docs/sg_execution_times.rst *.egg-info
