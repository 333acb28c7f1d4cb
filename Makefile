# One command for each habit. Set-up happens by itself, once, in .venv.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test nightly lint bench setup clean

demo: setup  ## the main job: from examples/quickstart.toml to cad_out/quickstart/report.html
	$(BIN)/lensforge design examples/quickstart.toml

test: setup  ## the whole test suite
	$(BIN)/python -m pytest -n 2

nightly: setup  ## the suite with 500 times as many random cases, and the shipped script with all its functions: hours
	LENSFORGE_FUZZ=500 $(BIN)/python -m pytest -n 2

lint: setup  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: setup  ## a gradient step taken apart, as ratios within one run
	$(BIN)/python benchmarks/gradient_step.py

setup: .venv/.ready

.venv/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf .venv build *.egg-info
