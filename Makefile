# Everything runs in .venv, made on first use. What else can be measured, written or tried: docs/contributing.md.
SHELL := /bin/bash
PYTHON ?= python3.11
BIN := .venv/bin
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --require-hashes
COMPILE = $(BIN)/python -m eigenfail_workers.compiler
# Processes that tests start by the hundred would otherwise compile every module anew.
unexport PYTHONDONTWRITEBYTECODE
# Each folder of plugins/ is a distribution of its own, which the others do without.
PROJECTS := $(wildcard plugins/*/pyproject.toml)
PLUGIN_PACKAGES := $(notdir $(patsubst %/__init__.py,%,$(wildcard plugins/*/*/__init__.py)))
# conftest.py puts the files first that take longest.
SPREAD = --numprocesses $(PROCESSES) --dist loadfile --no-loadscope-reorder
PROCESSES ?= 3

.DEFAULT_GOAL := help
.PHONY: help setup demo test quick lint format bench docs

help:
	@awk -F':.*## ' '/^[a-z]+:.*## /{printf "  make %-7s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# What a user needs: service, workers, client and plug-ins. Python compiles a module when it is first imported;
# pip would compile all modules, which doubles the time and adds a quarter to the space. pip refuses whatever has
# another hash than the lock files say. PyPI has no CPU build of torch: it is installed first, from an index that
# pip is configured with or else from TORCH_INDEX.
.venv/product: pyproject.toml $(PROJECTS) $(wildcard deploy/locks/*.txt)
	@echo "Installing packages into .venv. This takes a minute or two, once."
	$(PYTHON) -m venv .venv
	@$(INSTALL) --no-deps --requirement deploy/locks/torch_cpu.txt 2>.venv/torch.log \
		|| $(INSTALL) --no-deps --requirement deploy/locks/torch_cpu.txt --index-url $(TORCH_INDEX) \
		|| { echo "Before that, from the index that pip is configured with:"; cat .venv/torch.log; false; } >&2
	$(INSTALL) --no-deps $(foreach lock,server compiler build,--requirement deploy/locks/$(lock).txt)
	$(BIN)/python -m pip install --quiet --no-deps --no-index --no-build-isolation \
		--editable . $(PROJECTS:%/pyproject.toml=--editable %)
	@touch $@

# What developers need besides: tools of tests and documents, stacks of the examples, exports.
.venv/installed: .venv/product constraints.txt
	@echo "Installing the tools of tests and documents. This takes some minutes, once."
	$(INSTALL) --requirement constraints.txt
	@# Some packages warn when they are compiled, which would fail a test. Some bring files for other Pythons.
	@$(BIN)/python -W ignore -m compileall -qq -j 0 .venv/lib || true
	@touch $@

setup: .venv/installed ## the virtual environment, with the tools of all tests
	@deploy/test_tools.sh
	@$(COMPILE)

demo: .venv/product ## a short campaign of each method, analysed, replayed, priced
	@$(COMPILE)
	$(BIN)/python examples/demo.py

test: setup lint ## every check and every test
	$(BIN)/python -m pytest -q tests/test_full_loop.py
	$(BIN)/python -m pytest tests plugins $(SPREAD)
	$(BIN)/python deploy/without_plugins.py

quick: setup ## the tests that start no services and no browser; a third of the time
	$(BIN)/python -m pytest tests plugins -m "not service and not browser" $(SPREAD)

lint: .venv/installed ## style, types, who may import whom, known flaws of packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(if $(PLUGIN_PACKAGES),$(BIN)/mypy $(PLUGIN_PACKAGES:%=--package %))
	$(BIN)/lint-imports
	$(BIN)/python deploy/structure.py
	$(BIN)/python deploy/audit.py

format: .venv/installed ## put the sources into the house's style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: setup ## measure speed; ONLY=hub measures the figures whose names begin like this
	$(BIN)/python -m benchmarks.run $(if $(ONLY),--only $(ONLY))

docs: .venv/installed ## write what documents take from the code, and build them as a site in .site/
	$(BIN)/python tests/docs/rest_table.py
	$(BIN)/python tests/docs/measure_tables.py
	$(BIN)/python tests/docs/fault_table.py
	$(BIN)/python tests/support/cli_reference.py docs/cli.md
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build
	@echo "Open .site/index.html, or serve it: $(BIN)/python -m http.server --directory .site"
