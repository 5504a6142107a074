# Two commands do everything on a fresh machine: `make fly` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SURVEY ?= examples/survey.yaml
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help setup fly test check long transcripts bench format lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(STAMP): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit("flightstack needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ...") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@touch $@

setup: $(STAMP) ## install everything into .venv

fly: $(STAMP) ## fly a whole simulated survey, show it, write its report
	$(BIN)/simvehicle fly $(SURVEY)

check: $(STAMP) ## format, lint, types, import arrows, fast tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest tests/unit tests/contract tests/fuzz -q -n 2

test: $(STAMP) ## all tests, with real processes, sockets and clients
	$(BIN)/python -m pytest tests -n 2 --dist loadfile

long: $(STAMP) ## damaged files and messages by the million, and other tests that take hours
	$(BIN)/python -m pytest tests -m long -n 2 --timeout 21600 --durations 0

transcripts: $(STAMP) ## fly the named scenarios and write their transcripts anew, for review
	for file in tests/data/scenarios/*.yaml; do $(BIN)/simvehicle scenario run $$file --transcript $${file%.yaml}.txt; done

bench: $(STAMP) ## the figures of the documentation, measured on this machine
	$(BIN)/python -m benchmarks

format: $(STAMP) ## rewrite the code in the project's format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock: $(STAMP) ## resolve requirements.lock anew
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --no-header --no-emit-index-url --no-emit-find-links --extra ground --extra sim --extra cluster --extra dev --output-file requirements.lock pyproject.toml

clean: ## remove the environment and caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache build dist *.egg-info
