# Every target makes the environment it needs; nothing but Python 3.11+, git and make is assumed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# One BLAS thread a test process: the processes share the cores already.
# Tests differ a hundredfold in length: who is done takes from the other.
TEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal
STAMP := $(VENV)/.installed
PIP := bin/python -m pip install --quiet --disable-pip-version-check
# Beside what mjfish needs, in an environment that runs the fast tests and nothing else.
TOOLS := pytest pytest-timeout pytest-xdist hypothesis jsonschema gymnasium 'mujoco[sysid]'

.PHONY: env demo test test-slow test-oldest test-newest real check docs format bench clean

env: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

demo: env
	$(BIN)/mjfish demo

test: env
	$(TEST)

test-slow: env
	$(TEST) -m slow

# The oldest of every dependency that is promised, and the newest that there is, in environments of their own.
test-oldest:
	$(PYTHON) -m venv $(VENV)-oldest
	$(VENV)-oldest/$(PIP) -r requirements-oldest.lock
	$(VENV)-oldest/$(PIP) --no-deps --editable .
	OPENBLAS_NUM_THREADS=1 $(VENV)-oldest/bin/python -m pytest -n 2 --dist worksteal

test-newest:
	$(PYTHON) -m venv $(VENV)-newest
	$(VENV)-newest/$(PIP) --upgrade $(TOOLS) --editable .
	OPENBLAS_NUM_THREADS=1 $(VENV)-newest/bin/python -m pytest -n 2 --dist worksteal

# Measured robots: MJFISH_FISHSIM names the folder of the marker files of srl-ethz/fishsim, MJFISH_TAILFISH that of the runs of
# giorgosmamakoukas/DerivativeBasedKoopman, which are left out where it is not set.
real: env
	$(BIN)/python -m studies.measured_fish
	if [ -n "$$MJFISH_TAILFISH" ]; then $(BIN)/python -m studies.tail_fish; fi

check: env
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/measure.py

# Pages in out/docs; the notebooks among them are run, and a warning is an error.
docs: env
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs

format: env
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: env
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tools/bench.py

clean:
	rm -rf $(VENV) $(VENV)-oldest $(VENV)-newest out build dist
