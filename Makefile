# One command for each habit. Set-up happens by itself, once, in .venv.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test nightly lowest lint bench setup clean

demo: setup  ## the main job: from examples/quickstart.toml to cad_out/quickstart/report.html
	$(BIN)/lensforge design examples/quickstart.toml

test: setup  ## the whole test suite
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

nightly: setup lowest  ## the suite with 500 times as many random cases, all slow tests, the lowest versions: hours
	LENSFORGE_FUZZ=500 $(BIN)/python -m pytest -n 2 --dist loadfile
	$(BIN)/python benchmarks/fuzz.py --cases 100000 --foreign 2000

lowest:  ## a draft and all stages with the lowest version of each dependency that pyproject.toml declares
	$(PYTHON) -m venv --clear build/lowest
	$(PYTHON) .ci/lowest.py > build/lowest.txt
	build/lowest/bin/python -m pip install --quiet --constraint constraints.txt --constraint build/lowest.txt .
	build/lowest/bin/lensforge design examples/quickstart.toml --accuracy draft --out build/lowest_run
	for stage in "export --schema AP242" check "verify --stray" handover photometry report; do \
		build/lowest/bin/lensforge $$stage build/lowest_run || exit 1; \
	done

lint: setup  ## style and types
	$(BIN)/ruff check --no-cache .
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
