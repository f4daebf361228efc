# Everything runs in .venv, made on first use. `make help` lists what there is.
SHELL := /bin/bash
PYTHON ?= python3.11
BIN := .venv/bin
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes
# Processes that tests start by the hundred would otherwise compile every module anew.
unexport PYTHONDONTWRITEBYTECODE
# Runlevel 1 keeps packages from starting services, such as nginx at port 80.
apt = { apt-get update -qq && RUNLEVEL=1 apt-get install -y -qq $(1); } >/dev/null 2>&1
SOURCES := sdk api services workers plugins migrations deploy tests examples benchmarks conftest.py
# Each folder of plugins/ is a distribution of its own, which the others do without.
PROJECTS := $(wildcard plugins/*/pyproject.toml)
PLUGIN_PACKAGES := $(notdir $(patsubst %/__init__.py,%,$(wildcard plugins/*/*/__init__.py)))
MINUTES ?= 5
SECONDS ?= 600
# conftest.py puts the files first that take longest.
SPREAD = --numprocesses $(PROCESSES) --dist loadfile --no-loadscope-reorder
PROCESSES ?= 3
REQUESTS ?= 25000

.DEFAULT_GOAL := help
.PHONY: help image-steps setup compiled chromium headers javascript tools demo test quick coverage lint format bench volume claims intervals pictures site openapi faults screens vendor soak explore hostile overload lock clean

help: ## this list
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# pip refuses whatever has another hash than the lock files say. PyPI has no CPU build of torch: it is
# installed first, from an index that pip is configured with or else from TORCH_INDEX.
.venv/installed: pyproject.toml $(PROJECTS) constraints.txt deploy/locks/torch_cpu.txt
	@echo "Installing packages into .venv. This takes some minutes, once."
	$(PYTHON) -m venv .venv
	@$(INSTALL) --no-deps --requirement deploy/locks/torch_cpu.txt 2>.venv/torch.log \
		|| $(INSTALL) --no-deps --requirement deploy/locks/torch_cpu.txt --index-url $(TORCH_INDEX) \
		|| { echo "Before that, from the index that pip is configured with:"; cat .venv/torch.log; false; } >&2
	$(INSTALL) --requirement constraints.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-index --no-build-isolation \
		--editable . $(PROJECTS:%/pyproject.toml=--editable %)
	@$(BIN)/python -m eigenfail_workers.compiler || echo "The episode loop stays interpreted. Results are the same."
	@touch $@

setup: .venv/installed ## the virtual environment, with everything in it

compiled: setup ## the episode loop compiled again after a change, if there is a C compiler
	@$(BIN)/python -m eigenfail_workers.compiler

chromium: ## Debian's browser without a window, for the browser tests
	@command -v chromium-headless-shell >/dev/null || $(call apt,chromium-headless-shell) \
		|| command -v chromium >/dev/null || $(call apt,chromium) \
		|| echo "No chromium: the tests that need it are skipped, and told at the end."

headers: ## Debian's g++ and ZeroMQ for C++, for the tests of the C++ bridge
	@echo '#include <zmq.h>' | g++ -x c++ -fsyntax-only - 2>/dev/null \
		|| $(call apt,g++ libzmq3-dev) \
		|| echo "No g++ with zmq.h: the tests of the C++ bridge are skipped, and told at the end."

javascript: ## the npm packages of the JavaScript bridge, for its tests
	@{ command -v npm >/dev/null && npm ci --prefix examples/bridge/javascript --ignore-scripts --silent; } \
		|| echo "No npm: the tests of the JavaScript bridge are skipped, and told at the end."

tools: ## Debian's strace, iproute2, curl and nginx, for the tests of faults and of texts to copy
	@{ command -v strace && command -v ip && command -v curl && test -x /usr/sbin/nginx; } >/dev/null \
		|| $(call apt,strace iproute2 curl nginx-light) \
		|| echo "No strace, ip, curl or nginx: the tests that need them are skipped, and told at the end."

demo: setup compiled ## a short campaign of each method, analysed, replayed, priced
	$(BIN)/python examples/demo.py

test: setup compiled chromium headers javascript tools lint ## every check and every test
	$(BIN)/python -m pytest -q tests/test_full_loop.py
	$(BIN)/python -m pytest tests plugins $(SPREAD)
	$(BIN)/python deploy/without_plugins.py

quick: setup compiled ## the tests that start no services and no browser; a third of the time
	$(BIN)/python -m pytest tests plugins -m "not service and not browser" $(SPREAD)

coverage: setup chromium headers javascript tools ## which lines the tests reach; takes half as long again
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest tests plugins $(SPREAD)
	@$(BIN)/coverage combine --quiet
	@$(BIN)/coverage report

lint: setup ## style, types, who may import whom, known flaws of packages
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/mypy
	$(if $(PLUGIN_PACKAGES),$(BIN)/mypy $(PLUGIN_PACKAGES:%=--package %))
	$(BIN)/lint-imports
	$(BIN)/python deploy/structure.py
	$(BIN)/python deploy/audit.py

format: setup ## put the sources into the house's style
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

bench: setup compiled ## measure, and write benchmarks/latest.json
	$(BIN)/python benchmarks/run.py

volume: setup ## a million episodes in SQLite and PostgreSQL; half an hour, 15 GB of disk
	$(BIN)/python benchmarks/volume.py

claims: setup ## find the figures that the documents state, and write docs/claims.json
	$(BIN)/python benchmarks/claims.py

intervals: setup ## how often the failure probabilities that methods print hold the truth
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/intervals.py

pictures: setup ## draw docs/pictures
	$(BIN)/python benchmarks/pictures.py

site: setup ## the documents as a site that can be searched, in .site/; needs no network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build
	@echo "Open .site/index.html, or serve it: $(BIN)/python -m http.server --directory .site"

openapi: setup ## write docs/openapi.json and the tables of routes, measures and columns in docs
	$(BIN)/python tests/docs/rest_table.py
	$(BIN)/python tests/docs/measure_tables.py

faults: setup ## write the tables of faults in docs/faults.md from the marks of the tests
	$(BIN)/python tests/docs/fault_table.py
	$(BIN)/python benchmarks/claims.py --only faults.kinds

screens: setup chromium ## pictures of a running service's pages, into docs/pictures/screens
	$(BIN)/python benchmarks/screenshots.py

vendor: setup ## fetch the dashboard's libraries and the axe-core of its tests from npm
	$(BIN)/python deploy/vendor.py

soak: setup ## kill parts of a running service for MINUTES=5, then check that nothing was lost
	$(BIN)/python tests/soak/soak.py --minutes $(MINUTES)

explore: setup ## new lives of the state machines for MINUTES=5; SEED=N lives those of one seed again
	$(BIN)/python tests/machines/explore.py --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

hostile: setup ## REQUESTS=25000 hostile requests to a service of its own; SEED=N sends those of one seed again
	$(BIN)/python tests/fuzz/hostile_requests.py --requests $(REQUESTS) $(if $(SEED),--seed $(SEED))

overload: setup ## six workers and a learner on two cores for SECONDS=600: nobody who lives is given up
	EIGENFAIL_OVERLOAD_S=$(SECONDS) $(BIN)/python -m pytest -q tests/chaos/test_overload.py

image-steps: setup ## the steps of the container recipes without an engine, as root; see docs/deployment.md
	$(BIN)/python tests/deploy/image_steps.py

lock: setup ## the lock files anew, with hashes; UPGRADE="numpy ray" takes newer ones of these
	$(BIN)/python deploy/lock.py $(UPGRADE)

clean: ## remove everything that was made
	rm -rf .venv .out workers/eigenfail_workers/__compiled__ .coverage* htmlcov dist build eigenfail-data \
		.mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
