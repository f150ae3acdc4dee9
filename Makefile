# The verbs of the project. Everything lives in .venv; `make demo` and `make test` need nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Two test processes share the cores: more threads in their linear algebra only wait for each other.
# Each takes half of the files, so that what a file prepares is prepared once, and then helps the other.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal --durations 10
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
OUT ?= out
KERNELS := $(wildcard src/backsight/kernels/*.[ch] src/backsight/kernels/*/*.[ch])

# Random input; `--out` keeps what was found, tests/fuzz/kept what every run of the tests tries again.
FUZZ := OPENBLAS_NUM_THREADS=1 PYTHONPATH=.:tests $(BIN)/python -m tests.fuzz

.PHONY: setup demo live test test-all fast-tests all-tests fuzz fuzz-long coverage mutants lowest audit wheel-test lint bench long docs clean

setup: $(VENV)/.dev

demo: $(VENV)/.base
	$(BIN)/backsight run examples/stage/problem.toml --out $(OUT)/demo

live: $(VENV)/.live
	$(BIN)/python examples/live/run.py

# Types are checked on one core at most, which would leave the other idle: tests begin meanwhile.
test: $(VENV)/.dev
	@$(MAKE) --no-print-directory --jobs 2 lint fast-tests

test-all: $(VENV)/.dev
	@$(MAKE) --no-print-directory --jobs 2 lint all-tests

fast-tests: $(VENV)/.dev
	$(PYTEST) -m "not slow"

all-tests: $(VENV)/.dev
	$(PYTEST)

fuzz: $(VENV)/.dev
	$(FUZZ) --seconds 60
	$(MAKE) --no-print-directory $(OUT)/kernels-fuzz
	$(OUT)/kernels-fuzz $$(date +%s) 300000

fuzz-long: $(VENV)/.dev
	$(FUZZ) --seconds 3600 --record tests/measured/fuzz.json
	$(MAKE) --no-print-directory $(OUT)/kernels-fuzz
	$(OUT)/kernels-fuzz $$(date +%s) 10000000

# Without clang; with it, -fsanitize=fuzzer in place of -DMAIN makes a libFuzzer of the same file.
$(OUT)/kernels-fuzz: tests/fuzz/kernels.c $(KERNELS)
	@mkdir -p $(OUT)
	$(CC) -std=c99 -O1 -g -DMAIN -fsanitize=address,undefined -fno-sanitize-recover=all \
	  -Isrc/backsight/kernels -Isrc/backsight/kernels/matrix $< src/backsight/kernels/matrix/*.c -o $@ -lm

coverage: $(VENV)/.measure
	@mkdir -p $(OUT)/coverage
	COVERAGE_FILE=$(OUT)/coverage/all.coverage OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow" -q \
	  -p no:xdist --cov=backsight --cov-branch --cov-context=test --cov-report=
	$(BIN)/python tests/covered.py $(OUT)/coverage/all.coverage

# After `make coverage`, which says which tests get to a line. SECONDS=600 and more; it goes on where
# it has ended.
mutants: $(VENV)/.measure
	OPENBLAS_NUM_THREADS=1 PYTHONPATH=.:tests $(BIN)/python -m tests.mutation --seconds $(or $(SECONDS),3600)

lowest: $(VENV)/.lowest
	OPENBLAS_NUM_THREADS=1 $(VENV)-lowest/bin/python -m pytest -m "not slow" -q -p no:xdist

audit: $(VENV)/.measure
	$(BIN)/python -m pip_audit --skip-editable

wheel-test: $(VENV)/.wheel
	$(BIN)/python tests/wheels/build.py $(OUT)/wheels

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

long: $(VENV)/.base
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.long $(if $(SAMPLES),--samples $(SAMPLES))

bench: $(VENV)/.bench
	$(BIN)/python -m benchmarks

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs $(OUT)/docs

clean:
	rm -rf $(VENV) $(OUT)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.base: $(VENV)/bin/python pyproject.toml setup.py constraints.txt $(KERNELS)
	$(PIP) --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.base studies/pyproject.toml
	$(PIP) --editable '.[dev]' --editable ./studies
	@touch $@

$(VENV)/.live: $(VENV)/.base
	$(PIP) --editable '.[live]'
	@touch $@

$(VENV)/.wheel: $(VENV)/.base
	$(PIP) --editable '.[wheel]'
	@touch $@

$(VENV)/.measure: $(VENV)/.dev
	$(PIP) --editable '.[measure]'
	@touch $@

$(VENV)/.lowest: $(VENV)/.dev
	$(PYTHON) -m venv $(VENV)-lowest
	$(BIN)/python tests/lowest.py > $(OUT)/lowest.txt
	$(VENV)-lowest/bin/python -m pip install --quiet --constraint $(OUT)/lowest.txt --editable . pytest hypothesis
	@touch $@

$(VENV)/.bench: $(VENV)/.dev
	$(PIP) --editable '.[bench]'
	@touch $@

$(VENV)/.docs: $(VENV)/.dev
	$(PIP) --editable '.[docs]'
	@touch $@
