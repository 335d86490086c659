# `make train` and `make test` are the two commands; both set up .venv first.
PYTHON ?= python3
PIP_CONSTRAINTS ?= -c constraints-cpu.txt
BIN := .venv/bin
# The lowest Gymnasium that pyproject.toml allows: alone in a folder, it stands before the newest on the path.
FLOOR := $(shell sed -n 's/.*"gymnasium>=\(.*\)".*/\1/p' pyproject.toml)
FLOOR_PATH := $(CURDIR)/.venv/floor
FLOOR_TESTS := env vector_env wrapper recorder autoreset vector_wrappers safety_gymnasium sb3_vec

.PHONY: setup train test test-floor lint docs clean

setup: .venv/ready

.venv/ready: pyproject.toml constraints-cpu.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet $(PIP_CONSTRAINTS) --editable . --group dev
	touch $@

train: setup
	$(BIN)/python train.py --progress

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

test: setup lint
	$(BIN)/python -m pytest --numprocesses 2
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -m interpreted --cov --cov-report=term

test-floor: setup
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(FLOOR_PATH) "gymnasium==$(FLOOR)"
	PYTHONPATH=$(FLOOR_PATH) $(BIN)/python -m pip show gymnasium | grep "^Version: $(FLOOR)"
	PYTHONPATH=$(FLOOR_PATH) $(BIN)/python -m pytest --numprocesses 2 $(FLOOR_TESTS:%=tests/test_%.py)

docs: setup
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/mkdocs build --strict

clean:
	rm -rf .venv logs build dist *.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +
