# Two commands: `make run` sets up and runs the demo; `make test` sets up and passes the tests.
PYTHON ?= python3.11
PREFIX ?= /opt/hil
VENV   := .venv
BIN    := $(VENV)/bin

.DEFAULT_GOAL := help
.PHONY: help run test test-whole test-benchmarks test-vcan lint types imports check install bench clean

help: ## what can be made
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-15s %s\n", $$1, $$2}'

# Not compiled ahead: most of what libraries hold is never imported, and half of the set-up's time would go there.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e .
	@touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) -e '.[dev]'
	@touch $(VENV)/run.stamp $@

run: $(VENV)/run.stamp ## the simulated motorcycle rig, the daemon and a riding client, for a minute
	$(BIN)/hil demo

PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test: $(VENV)/dev.stamp ## all tests of hil that need no root and no SocketCAN
	$(PYTEST) -m "not realtime" --ignore=tests/benchmarks --ignore=tests/whole
	$(PYTEST) -m realtime

test-whole: $(VENV)/dev.stamp ## whole diagnoses, rides, measures and pages, some seconds each
	$(PYTEST) tests/whole

test-benchmarks: $(VENV)/dev.stamp ## tests of the benchmarks and of the worlds of others
	$(PYTEST) tests/benchmarks

test-vcan: $(VENV)/dev.stamp ## the tests over real SocketCAN, in a guest where this kernel has none
	tests/vcan/run

lint: $(VENV)/dev.stamp ## style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/dev.stamp ## static types
	$(BIN)/mypy

imports: $(VENV)/dev.stamp ## imports go down only
	$(BIN)/lint-imports

check: lint types imports test test-whole test-benchmarks ## all of the above

install: ## into PREFIX (/opt/hil) as a service: make install RIG=motorcycle, or RIG=/path/to/rig.toml
	$(PYTHON) -m venv $(PREFIX)
	$(PREFIX)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt .
	$(PREFIX)/bin/hil service install $(if $(RIG),--rig $(RIG))

bench: $(VENV)/dev.stamp ## the measured figures, as tables
	$(BIN)/python -m benchmarks

clean: ## forget the environment and caches
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
