PYTHON ?= python3.11
BIN := .venv/bin
# Threads of numerical libraries fight with the processes of the cell for two cores.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

# Which fake cell: default, or one of the paper's two, sampler and fruit.
CELL ?= default

# PAGE=1: the operator's page at 127.0.0.1:8080, buttons that move the fake arm and table at 8081.
PAGE ?=
SHOWN := $(if $(PAGE),--page 8080)

.PHONY: install demo cell paper test test-robust soak lint bench run screenshots format clean

.venv: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	$(BIN)/python -m vgrd.vision
	touch .venv

# On a cell computer, as root, before anything else: docs/service.md. ARGS="--cell my-cell.toml".
install:
	python3 -m vgrd.installing install $(ARGS)

# With PAGE=1 nobody teaches: the cell stays up until Ctrl-C, for a person who does.
demo: .venv
	$(BIN)/python -m fakes $(if $(PAGE),cell --untaught --folder build/page-cell $(SHOWN),demo) --cell $(CELL)

cell: .venv
	$(BIN)/python -m fakes cell --cell $(CELL) $(SHOWN)

# Every figure and table of the paper beside ours: build/paper.html, about ten minutes on two cores.
paper: .venv
	$(BIN)/python -m fakes paper $(ARGS)

run: .venv
	$(BIN)/vgrd run $(CONFIG)

# Tests of the running daemon want both cores for themselves.
test: .venv
	$(BIN)/pytest -n 2 -m "not system"
	$(BIN)/pytest -m system

# The mathematics as other processors would round it.
test-robust: .venv
	$(BIN)/python -m tests.robust -n 2

# A simulated day of the cell under faults, ten million reads: see docs/invariant.md.
soak: .venv
	$(BIN)/python -m tests.invariant $(ARGS)

lint: .venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: .venv
	$(BIN)/python -m tests.benchmarks $(ARGS)

# Every page in both themes and three sizes, taught on the way; needs Debian's chromium.
screenshots: .venv
	$(BIN)/python -m tests.page.screenshots build/screenshots $(ARGS)

clean:
	rm -rf .venv build
