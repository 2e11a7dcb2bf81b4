PYTHON ?= python3
VENV := .venv
EXTRAS := dev
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
BENCHMARKS := $(VENV)/.benchmarks
WORKERS ?= auto
PYTEST := $(BIN)/python -m pytest
# A test goes to the process that is free; tests of one xdist_group share a dear fixture and go to one process.
PARALLEL := -n $(WORKERS) --maxprocesses 8 --dist loadgroup --no-loadscope-reorder --durations=10
.PHONY: demo quick test test-all wheel check analysis benchmark benchmarked benchmark-short generated pictures site clean

$(STAMP): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Tendon needs Python 3.11 or newer; run make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[$(EXTRAS)]'
	touch $@

# What the benchmarks compare with, beside the tests' packages.
$(BENCHMARKS): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[$(EXTRAS),benchmark]'
	touch $@

demo: $(STAMP)
	$(BIN)/tendon demo

# What is wrong at a glance: style, rooms, settings, the guides' form.
quick: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) -m cheap tests/test_rooms.py tests/test_settings.py tests/test_effects_once.py tests/test_guides.py tests/test_size.py

# All but the long variants.
test: $(STAMP)
	$(PYTEST) $(PARALLEL) -m "not slow"

# The long variants, too, and random inputs that no run drew before.
test-all: $(STAMP)
	$(PYTEST) $(PARALLEL) --hypothesis-profile=new

# The wheel, built and installed into an empty environment.
wheel: $(STAMP)
	$(PYTEST) tests/test_wheel.py

check: quick analysis

analysis: $(STAMP)
	$(BIN)/mypy
	$(PYTEST) tests/codegen/c/test_misra.py

# In an environment of its own: one of the methods that are compared with asks for an older NumPy.
benchmark:
	$(MAKE) --no-print-directory benchmarked VENV=.venv/benchmark EXTRAS=dev,benchmark,compared

benchmarked: $(STAMP)
	$(PYTEST) tests/benchmarks --override-ini addopts= -s -q

# Each once with few samples: that it runs, and that equal results are equal.
benchmark-short: $(BENCHMARKS)
	TENDON_BENCH=short $(PYTEST) tests/benchmarks --override-ini addopts= -s -q

generated: $(STAMP)
	$(BIN)/tendon generate symbolic/arms/vishard4.toml
	$(BIN)/tendon firmware symbolic/arms/vishard4.toml
	$(BIN)/python -m runtime.cli.schema
	$(BIN)/python -m codegen.descriptions

# The figures of README.md and of the gallery.
pictures: $(STAMP)
	$(BIN)/python -m tests.pictures

# The guides and the references as a static site: .site/built/site/index.html.
site: $(STAMP)
	$(BIN)/python .site/maker/build.py

clean:
	rm -rf .site/built $(VENV) tests/.cache .pytest_cache .mypy_cache .ruff_cache .hypothesis
