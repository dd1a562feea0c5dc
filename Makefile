# barchan: every target makes its own .venv and installs what it needs; running one again costs nothing.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# One stamp for what a user needs, one for what a developer needs; both grow stale with pyproject.toml.
USE    := $(VENV)/.installed-use
DEV    := $(VENV)/.installed-dev
DEMO   := runs/demo
PARALLEL = $(shell $(BIN)/python -c "import importlib.util as u; print('-n 2' if u.find_spec('xdist') else '')")

.PHONY: help demo test slow bench docs lint format clean clean-all

help:
	@echo "make demo   a gravel column collapses and comes to rest; pictures in $(DEMO)/pictures"
	@echo "make test   lint, format, types, import directions and the fast tests"
	@echo "make slow   the long tests"
	@echo "make bench  every script of benchmarks/"
	@echo "make docs   rewrite the table of scene keys in docs/scenes.md"
	@echo "make format let ruff rewrite the sources"
	@echo "make clean  remove caches and the demo run; clean-all removes $(VENV) too"

$(BIN)/python:
	$(PYTHON) -c "import sys; sys.exit('barchan needs Python 3.11 or newer') if sys.version_info < (3, 11) else None"
	$(PYTHON) -m venv $(VENV)

$(USE): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(DEV): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@ $(USE)

demo: $(USE)
	$(BIN)/barchan run collapse --out $(DEMO) $(if $(wildcard $(DEMO)),--resume)

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy src
	$(BIN)/python tools/check_rooms.py

test: lint
	$(BIN)/python -m pytest -m "not slow" $(PARALLEL)

slow: $(DEV)
	$(BIN)/python -m pytest -m slow

bench: $(DEV)
	@set -e; for script in $(wildcard benchmarks/bench_*.py); do echo "== $$script"; $(BIN)/python $$script; done

docs: $(DEV)
	$(BIN)/python tools/scene_table.py

format: $(DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(DEMO) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests tools benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

clean-all: clean
	rm -rf $(VENV)
