# One command for each habit. Set-up happens by itself, once, in .venv.
PYTHON ?= python3
BIN := .venv/bin

unexport PYTHONDONTWRITEBYTECODE # or each of the processes that tests start compiles the package again

.PHONY: demo test quick nightly lowest wheel docs notebooks lint bench setup clean

demo: .venv/.ready  ## the main job: from examples/quickstart.toml to cad_out/quickstart/report.html
	@$(BIN)/lensforge design examples/quickstart.toml

# Three processes on two cores: tests wait, too, for children, browsers and clocks, a fifth of their time.
test: setup  ## the whole test suite
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Light, its definitions and the spec, where a wrong number hides best: 81 s on two idle cores, 154 s of processor time.
QUICK := $(addprefix tests/,definitions light optics kernels spec test_architecture.py test_vocabulary.py)

quick: setup  ## between edits: the tests that see most, in under 90 seconds
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder $(QUICK)

nightly: setup  ## what takes longer than the suite, step by step; the outcomes go to build/nightly: hours
	$(BIN)/python .ci/nightly.py

lowest:  ## a draft and all stages with the lowest version of each dependency that pyproject.toml declares
	$(PYTHON) -m venv --clear build/lowest
	$(PYTHON) .ci/lowest.py > build/lowest.txt
	build/lowest/bin/python -m pip install --quiet --constraint constraints.txt --constraint build/lowest.txt '.[all]'
	build/lowest/bin/lensforge design examples/quickstart.toml --accuracy draft --out build/lowest_run
	for stage in "export --schema AP242" check "verify --stray" handover photometry report; do \
		build/lowest/bin/lensforge $$stage build/lowest_run || exit 1; \
	done

wheel:  ## the wheel, tried in an empty environment outside the checkout, without make
	PYTHON=$(PYTHON) .ci/wheel

docs: setup  ## the site in build/site, warnings as errors
	$(BIN)/sphinx-build -W --keep-going -n -q docs build/site

notebooks: setup  ## every notebook of examples/, executed into build/notebooks: minutes
	$(BIN)/python docs/run_notebooks.py

lint: setup  ## style and types
	$(BIN)/ruff check --no-cache .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	mkdir -p build && $(BIN)/python tests/library/specs_in_python.py build/specs_in_python.py
	$(BIN)/mypy --strict --config-file= build/specs_in_python.py

bench: setup  ## a gradient step taken apart, as ratios within one run
	$(BIN)/python benchmarks/gradient_step.py

setup: .venv/.ready-dev  ## .venv with all that tests and pages need

# Python compiles a module when it is first imported: to compile all that is installed would take half of the set-up.
INSTALL = $(PYTHON) -m venv .venv && $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt

.venv/.ready: pyproject.toml setup.py constraints.txt
	$(INSTALL) --editable '.[all]'
	touch $@

.venv/.ready-dev: pyproject.toml setup.py constraints.txt
	$(INSTALL) --editable '.[dev]'
	touch .venv/.ready $@

clean:
	rm -rf .venv build *.egg-info
