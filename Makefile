# `make train` and `make test` are the two commands; both set up .venv first.
PYTHON ?= python3
PIP_CONSTRAINTS ?= -c constraints-cpu.txt
BIN := .venv/bin

.PHONY: setup train test lint docs clean

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

docs: setup
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/mkdocs build --strict

clean:
	rm -rf .venv logs build dist *.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +
