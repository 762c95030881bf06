# Two doors. `make run` sets up, flies the main scenario and compares; `make test` sets up and runs the checks of every change (under 10 min).
# `make test-long` runs the long tests (under 45 min): fuzz, damaged files, kills, notebooks, wheel, lowest permitted versions.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
COMPILED := $(VENV)/.compiled

.PHONY: run test test-long setup clean

run: $(COMPILED)
	$(BIN)/flightbed run nominal --out runs/nominal
	$(BIN)/flightbed run elevator-loss --out runs/elevator-loss
	$(BIN)/flightbed run elevator-loss-fixed --out runs/elevator-loss-fixed
	$(BIN)/flightbed compare runs/nominal runs/elevator-loss runs/elevator-loss-fixed --out comparisons/elevator-loss
	@echo
	@echo "The same loss twice: corrected by 1/K the aircraft is kept, with the fixed law it departs."
	@echo "Look:  $(BIN)/flightbed view comparisons/elevator-loss   or open runs/elevator-loss/report.html"

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/flightbed compile & compiling=$$!; $(BIN)/mypy || { kill $$compiling; exit 1; }; wait $$compiling
	$(BIN)/pytest -n auto --dist loadfile -m "not long"

test-long: setup
	$(BIN)/flightbed compile
	$(BIN)/pytest -n auto --dist worksteal -m long

setup: $(READY)

# Only for the time: a flight compiles by itself what is missing.
$(COMPILED): $(READY) $(shell find flightbed scenarios -name '*.py' -o -name '*.toml')
	$(BIN)/flightbed compile
	@touch $@

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "flightbed needs Python 3.11 or newer: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
