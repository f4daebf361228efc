# Everything runs in .venv, made on first use. `make help` lists what there is.
SHELL := /bin/bash
PYTHON ?= python3.11
BIN := .venv/bin
SOURCES := sdk api services workers migrations deploy tests examples benchmarks
MINUTES ?= 5
SECONDS ?= 600
PROCESSES ?= 2

.DEFAULT_GOAL := help
.PHONY: help image-steps setup chromium headers tools demo test coverage lint format bench volume claims intervals pictures openapi screens vendor soak explore overload lock clean

help: ## this list
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.venv/installed: pyproject.toml constraints.txt
	@echo "Fetching packages into .venv: some minutes, once."
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

setup: .venv/installed ## the virtual environment, with everything in it

chromium: ## Debian's browser, for the browser tests
	@command -v chromium >/dev/null || (apt-get update -qq && apt-get install -y -qq chromium >/dev/null) \
		|| (echo "The browser tests need chromium: install it with your package manager." && false)

headers: ## Debian's g++ and ZeroMQ for C++, for the tests of the C++ bridge
	@echo '#include <zmq.h>' | g++ -x c++ -fsyntax-only - 2>/dev/null \
		|| (apt-get update -qq && apt-get install -y -qq g++ libzmq3-dev >/dev/null) \
		|| (echo "The C++ bridge needs g++ and zmq.h: install them with your package manager." && false)

tools: ## Debian's strace, iproute2 and curl, for the tests of faults and of texts to copy
	@{ command -v strace && command -v ip && command -v curl; } >/dev/null \
		|| (apt-get update -qq && apt-get install -y -qq strace iproute2 curl >/dev/null) \
		|| echo "No strace, ip or curl: the tests that need them are skipped, and told at the end."

demo: setup ## a short campaign of each method, analysed, replayed, priced
	$(BIN)/python examples/demo.py

test: setup chromium headers tools lint ## every check and every test
	$(BIN)/python -m pytest -q tests/test_full_loop.py
	$(BIN)/python -m pytest tests --numprocesses $(PROCESSES) --dist loadfile

coverage: setup chromium headers tools ## which lines the tests reach; takes half as long again
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest tests --numprocesses $(PROCESSES) --dist loadfile
	@$(BIN)/coverage combine --quiet
	@$(BIN)/coverage report

lint: setup ## style, types, who may import whom, known flaws of packages
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python deploy/audit.py

format: setup ## put the sources into the house's style
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

bench: setup ## measure, and write benchmarks/latest.json
	$(BIN)/python benchmarks/run.py

volume: setup ## a million episodes in SQLite and PostgreSQL; half an hour, 15 GB of disk
	$(BIN)/python benchmarks/volume.py

claims: setup ## find the figures that the documents state, and write docs/claims.json
	$(BIN)/python benchmarks/claims.py

intervals: setup ## how often the failure probabilities that methods print hold the truth
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/intervals.py

pictures: setup ## draw docs/pictures
	$(BIN)/python benchmarks/pictures.py

openapi: setup ## write docs/openapi.json and the table of routes in docs/rest.md
	$(BIN)/python -m eigenfail_api.openapi --output docs/openapi.json
	$(BIN)/python tests/docs/rest_table.py

screens: setup chromium ## pictures of a running service's pages, into docs/pictures/screens
	$(BIN)/python benchmarks/screenshots.py

vendor: setup ## the dashboard's libraries anew, from npm
	$(BIN)/python deploy/vendor.py

soak: setup ## kill parts of a running service for MINUTES=5, then check that nothing was lost
	$(BIN)/python tests/soak/soak.py --minutes $(MINUTES)

explore: setup ## new lives of the state machines for MINUTES=5; SEED=N lives those of one seed again
	$(BIN)/python tests/machines/explore.py --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

overload: setup ## six workers and a learner on two cores for SECONDS=600: nobody who lives is given up
	EIGENFAIL_OVERLOAD_S=$(SECONDS) $(BIN)/python -m pytest -q tests/chaos/test_overload.py

image-steps: setup ## the steps of the container recipes without an engine, as root; see docs/deployment.md
	$(BIN)/python tests/deploy/image_steps.py

lock: setup ## constraints.txt anew, from what is installed
	$(BIN)/pip freeze --exclude-editable | sed 's/+cpu//' > constraints.txt
	@touch .venv/installed

clean: ## remove everything that was made
	rm -rf .venv .out .coverage* htmlcov dist build eigenfail-data \
		.mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
