# Two commands on a fresh machine do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
SCALE  ?= 0.01
SEED   ?= 0
JOBS   ?= 2
# of the tests: one more than cores, since some of them wait for a clock
WORKERS ?= 3

.PHONY: demo test test-full mutation lint bench clean

demo: $(VENV)/.demo
	$(BIN)/stopproof demo --force
	@echo "next: . $(BIN)/activate && stopproof --help"

test: $(VENV)/.test
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --scale $(SCALE) --seed $(SEED)

test-full: $(VENV)/.test
	$(BIN)/python -m tests.full --seed $(SEED)
	$(BIN)/python -m tests.adversary --seed $(SEED)

mutation: $(VENV)/.test
	$(BIN)/python -m tests.mutation --seed $(SEED) --jobs $(JOBS) --out docs/results/mutation.md

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.test
	$(BIN)/python -m bench.replay

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "stopproof needs Python 3.11 or newer; $(PYTHON) is older. Try: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { echo "On Debian: apt install python3-venv" >&2; rm -rf $(VENV); exit 1; }

$(VENV)/.demo: $(BIN)/python pyproject.toml
	@echo "installing into $(VENV): about 1.5 GB, some minutes, the first time only"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[plot]'
	@touch $@

$(VENV)/.test: $(BIN)/python pyproject.toml
	@echo "installing into $(VENV): about 2 GB, some minutes, the first time only"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,plot]'
	@touch $@

$(VENV)/.lint: $(VENV)/.test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,plot,lint]'
	@touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
