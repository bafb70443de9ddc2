# The project's own commands. `make setup` needs only python3 (3.11 or newer), pip and make.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# Python compiles what it imports when it first does: to compile all of the packages takes longer than to unpack them.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

# One .venv; each of these files says that one more group of packages is in it.
READY     := $(VENV)/.ready
DEVELOP   := $(VENV)/.ready-dev
MUTATION  := $(VENV)/.ready-mutation
PACKAGING := $(VENV)/.ready-packaging
DOCS      := $(VENV)/.ready-docs
REFEREES  := build/referees/.ready
MUTATION_LOCK  := tests/mutants/requirements.lock
PACKAGING_LOCK := tests/packaging/requirements.lock
DOCS_LOCK      := docs/requirements.lock

# The commit that `make bench-check` compares with; that of the newest release in results/benchmarks unless it is given.
BASE ?=

# For how long `make soak` reads.
MINUTES ?= 30

# Anything, for `make test` to run what `make test-long` does, too.
LONG ?=

# The file whose formulas `make mutants` breaks, and the tests that should notice.
FILE  ?= tactsim/press/clip.py
TESTS ?= tests/press/test_clip.py
COPY  := build/mutants

.PHONY: run test test-long check docs setup lock test-slow soak mutants bench bench-check tables tutorials renew leaderboard references stress referees release-check image clean help

help:            ## list these commands
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

run: $(READY)    ## set up, then press, map, recognise and score five letters
	@$(BIN)/bench run --estimator histogram --bins 10000

test: $(DEVELOP)   ## set up, then run the tests; LONG=1: with those of `make test-long`
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(if $(LONG),3,2) --dist loadfile $(if $(LONG),-m 'not slow and not benchmark and not soak')

test-long: $(DEVELOP)  ## the tests that take longest: kills, full disks, clusters, browsers, whole campaigns
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m long -n 3 --dist loadfile

check: $(DEVELOP)  ## lint, types and import directions
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo

docs: $(DOCS)    ## build the documentation as a site, docs/_build/html/index.html
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -d docs/_build/doctrees docs docs/_build/html
	@echo "docs/_build/html/index.html"

$(DOCS): $(DOCS_LOCK) | $(DEVELOP)
	@echo "setting up $(VENV): fetching what builds the documentation ..."
	@$(INSTALL) -r $<
	@touch $@

test-slow: $(PACKAGING)  ## the tests that are minutes long
	@$(BIN)/python -m pytest -m slow

soak: $(DEVELOP)   ## read two devices under random faults for MINUTES (30)
	@nice $(BIN)/python -m pytest -q -s -m soak tests/hardware/test_soak.py --soak-minutes $(MINUTES)

mutants: $(MUTATION)  ## break the formulas of FILE in a copy, one after another: do TESTS notice? minutes to hours
	@rm -rf $(COPY) && mkdir -p $(COPY)
	@git ls-files -z | xargs -0 cp -P --parents -t $(COPY)
	@sed 's|"FILE"|"$(FILE)"|; s|TESTS"|$(TESTS)"|' tests/mutants/cosmic-ray.toml > $(COPY)/mutants.toml
	@cd $(COPY) && export PATH="$(CURDIR)/$(BIN):$$PATH" PYTHONPATH="$$PWD" NUMBA_CACHE_DIR="$$PWD/kernels" && \
	cosmic-ray init mutants.toml mutants.sqlite && cr-filter-operators mutants.sqlite mutants.toml && \
	cosmic-ray baseline mutants.toml && nice cosmic-ray exec mutants.toml mutants.sqlite && \
	cr-report --surviving-only --show-diff mutants.sqlite

bench: $(DEVELOP)  ## time presses, maps, estimators and a run; keep it as results/benchmarks/VERSION.json, and draw the history
	@mkdir -p build && for turn in 1 2 3; do \
		OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -m benchmark --benchmark-only tests/benchmarks \
			--benchmark-json=build/timed-$$turn.json || exit; done
	@$(BIN)/python tests/benchmarks/history.py \
		results/benchmarks/$$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml).json build/timed-*.json

bench-check: $(DEVELOP)  ## is anything slower than at the newest release, or at BASE=COMMIT, or an error another one?
	@$(BIN)/python tests/benchmarks/check.py $(BASE)

# The sweeps that the tables of the documentation are made of.
TABLES := better paper-better robustness slip open-set active paper paper-like tilt pareto presses regions

tables: $(DEVELOP)  ## do the sweeps that are not done yet, and fill the tables of the documentation from them
	@for suite in $(TABLES); do $(BIN)/bench sweep $$suite || exit; done
	@$(BIN)/python docs/tools/page_tables.py README.md docs/results.md docs/method.md docs/estimators.md
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/tools/page_default.py results/sweeps/default docs/results.md docs/recordings.md
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/tools/page_performance.py docs/performance.md

tutorials: $(DOCS)  ## run the tutorials, and keep in the notebooks what they print and show
	@$(BIN)/python docs/tools/tutorial_outputs.py docs/tutorials/*.ipynb

renew: $(DEVELOP)  ## do every method of results/leaderboard again with this commit, and check it: half an hour; then `leaderboard`
	@$(BIN)/python docs/tools/renew_leaderboard.py results/leaderboard $(VENV)/renewed
	@$(MAKE) --no-print-directory leaderboard

leaderboard: $(DEVELOP)  ## make the site of results/leaderboard, the best known results, and the tables of docs/leaderboard.md
	@$(BIN)/python docs/tools/best_known_results.py results/leaderboard
	@$(BIN)/bench leaderboard results/leaderboard
	@$(BIN)/python docs/tools/page_standings.py results/leaderboard docs/leaderboard.md

references: $(DEVELOP)  ## how far every estimator is from the reference posteriors: fill the table of docs/bound.md
	@$(BIN)/python docs/tools/reference_posteriors.py --fill docs/bound.md

stress: $(DEVELOP)  ## do every stress case, 6 to 20 minutes: fill the table of docs/stress.md
	@$(BIN)/python docs/tools/page_stress.py docs/stress.md

referees: $(REFEREES)  ## press eight bodies with other people's solvers, ten minutes: fill the table of docs/attach.md
	@OPENBLAS_NUM_THREADS=1 nice build/referees/bin/python docs/tools/page_referees.py docs/attach.md

$(REFEREES): docs/tools/referees.txt requirements.lock
	@echo "setting up build/referees: fetching ContactMechanics, tamaas and Drake, another 1.2 GB ..."
	@$(PYTHON) -m venv build/referees
	@build/referees/bin/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	@build/referees/bin/python -m pip install --quiet --disable-pip-version-check -r docs/tools/referees.txt
	@build/referees/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

release-check: $(PACKAGING)  ## what a release lacks; then build it into dist/, check it and install it
	@$(BIN)/python tests/packaging/release_check.py
	@rm -rf dist && mkdir dist && PYTHONPATH=tests/support $(BIN)/python -m building dist
	@$(BIN)/python -m twine check --strict dist/*
	@$(BIN)/python -m pytest -q -m "slow or not slow" tests/packaging

image:           ## build the container image `tactsim`
	@docker build --tag tactsim .

setup: $(DEVELOP)  ## create .venv with all that work on the project needs

# What `make run` needs: the package, what it depends on, and its inner loops, compiled.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else "tactsim needs Python 3.11 or newer; this is %d.%d. Try: make setup PYTHON=python3.12" % v[:2])'
	@start=$$(date +%s) && \
	echo "setting up $(VENV): fetching and unpacking packages, 0.6 GB on disk ..." && \
	$(PYTHON) -m venv $(VENV) && $(INSTALL) -r requirements.lock && \
	$(INSTALL) --no-deps --no-build-isolation -e . && \
	echo "setting up $(VENV): compiling the inner loops, a minute or more, after $$(($$(date +%s) - start)) s ..." && \
	$(BIN)/python -m tactsim.bench.compile_kernels && \
	echo "ready for bench after $$(($$(date +%s) - start)) s"
	@touch $@

# What tests and checks need besides.
$(DEVELOP): $(READY) requirements-dev.lock
	@start=$$(date +%s) && \
	echo "setting up $(VENV): fetching and unpacking the tools for tests and checks, another 0.7 GB ..." && \
	$(INSTALL) -r requirements-dev.lock && \
	echo "ready for make test and make check after $$(($$(date +%s) - start)) s more"
	@touch $@

$(MUTATION): $(MUTATION_LOCK) | $(DEVELOP)
	@$(INSTALL) -r $<
	@touch $@

$(PACKAGING): $(PACKAGING_LOCK) | $(DEVELOP)
	@echo "setting up $(VENV): fetching a second type checker, another 0.3 GB ..."
	@$(INSTALL) -r $<
	@touch $@

# All groups are pinned together, so that no two lock files disagree; each then lists its own share with hashes.
# `make lock UPGRADE=` keeps the versions that are pinned and adds what is new in pyproject.toml.
UPGRADE ?= --upgrade
ALL     := $(VENV)/all.lock
COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-annotate --no-emit-index-url \
           --custom-compile-command "make lock"
PIN     := $(COMPILE) --generate-hashes --constraint $(ALL)

lock: $(READY)   ## pin the newest versions that pyproject.toml allows
	@$(INSTALL) uv
	@cat requirements-dev.lock $(DOCS_LOCK) $(MUTATION_LOCK) $(PACKAGING_LOCK) > $(ALL)
	@$(COMPILE) $(UPGRADE) pyproject.toml --all-extras --group dev --group docs --group mutation --group packaging -o $(ALL)
	@$(PIN) pyproject.toml --group build -o requirements.lock
	@$(PIN) pyproject.toml --all-extras --group dev -o requirements-dev.lock
	@$(PIN) --group docs -o $(DOCS_LOCK)
	@$(PIN) --group mutation -o $(MUTATION_LOCK)
	@$(PIN) --group packaging -o $(PACKAGING_LOCK)

clean:           ## remove .venv and what tools left behind
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks build *.egg-info docs/_build
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
