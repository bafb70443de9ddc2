# The project's own commands. `make setup` needs only python3 (3.11 or newer), pip and make.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

MEASURED   := $(VENV)/benchmark
MEASURE    := $(BIN)/python -m pytest -q -m benchmark tests/bench/bench_regression.py \
              --benchmark-timer=time.process_time --benchmark-json=$(MEASURED)
REGRESSION := $(BIN)/python -m tactsim.bench.regression

# What `make mutants` is given, such as MUTANTS="--all tactsim/press/clip.py".
MUTANTS ?=
MUTATION := tests/mutants/requirements.lock

DOCS := docs/requirements.lock

.PHONY: run test check docs setup lock test-slow mutants bench-check bench-baseline clean help

help:            ## list these commands
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

run: $(READY)    ## set up, then press, map, recognise and score five letters
	@$(BIN)/bench run --estimator histogram --bins 10000

test: $(READY)   ## set up, then run the tests
	@$(BIN)/python -m pytest -n 2 --dist loadfile

check: $(READY)  ## lint, types and import directions
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo

docs: $(READY) $(VENV)/.docs  ## build the documentation as a site, docs/_build/html/index.html
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -d docs/_build/doctrees docs docs/_build/html
	@echo "docs/_build/html/index.html"

$(VENV)/.docs: $(DOCS) | $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r $(DOCS)
	@touch $@

test-slow: $(READY)  ## the longer tests
	@$(BIN)/python -m pytest -m slow

mutants: $(READY) $(VENV)/.mutation  ## break formulas in a copy: do the tests notice? an hour or two
	@nice $(BIN)/python tests/mutants/mutate.py $(MUTANTS)

$(VENV)/.mutation: $(MUTATION) | $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r $(MUTATION)
	@touch $@

bench-check: $(READY)  ## compare times (as ratios) and errors with results/baseline.json
	@$(MEASURE)-1.json
	@$(REGRESSION) check results/baseline.json $(MEASURED)-1.json || { \
	  echo "measuring again: the machine may have been busy"; $(MEASURE)-2.json; \
	  $(REGRESSION) check results/baseline.json $(MEASURED)-1.json $(MEASURED)-2.json; }

bench-baseline: $(READY)  ## renew results/baseline.json
	@$(MEASURE)-1.json
	@$(MEASURE)-2.json
	@$(REGRESSION) write results/baseline.json $(MEASURED)-1.json $(MEASURED)-2.json

setup: $(READY)  ## create .venv with the locked dependencies

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else "tactsim needs Python 3.11 or newer; this is %d.%d. Try: make setup PYTHON=python3.12" % v[:2])'
	@echo "setting up $(VENV) (a minute or so) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@$(BIN)/python -c 'import tactsim.estimators.filters.information, tactsim.estimators.field.kernels, tactsim.estimators.field.state_kernels'  # compiles them, once
	@touch $@

PIN := $(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
       --no-annotate --upgrade --quiet --custom-compile-command "make lock"

lock: $(READY)   ## pin the newest versions that pyproject.toml allows
	@$(BIN)/python -m pip install --quiet uv
	@$(PIN) pyproject.toml --all-extras --group dev --output-file requirements.lock
	@$(PIN) --group mutation --constraint requirements.lock --output-file $(MUTATION)
	@$(PIN) --group docs --constraint requirements.lock --output-file $(DOCS)

clean:           ## remove .venv and what tools left behind
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks build *.egg-info docs/_build
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
