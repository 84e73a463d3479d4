# `make` alone lists the targets. Every target sets up what it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
UV := $(BIN)/uv
HIDDEN := studies/hidden_effect_demo
# Files of tests, each whole, as its tests share what they have solved; in their order, as the long ones come early.
SIDE_BY_SIDE := --numprocesses=auto --dist=loadfile --no-loadscope-reorder
# One process for each core, each with one thread: more of them wait for each other, and take twice as long.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo example test coverage benchmark peers trial verification error-bars slow docs wheel-test lint format lock clean clean-venv

help: ## Show this list
	@echo "make TARGET [PYTHON=python3.12]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/.ready ## Validate the bridge amplifier, then diagnose recordings with a hidden effect
	$(BIN)/flexdesign validate bridge_amplifier --out reports/bridge_amplifier
	$(BIN)/flexdesign diagnose $(HIDDEN)/model.toml $(HIDDEN)/runs --out reports/hidden_effect_demo

example: $(VENV)/.ready ## Make the kept example reports anew; README's tables and pictures are theirs
	$(BIN)/flexdesign validate bridge_amplifier --out reports/examples/bridge_amplifier
	$(BIN)/flexdesign simulate lin2019_stage lin2019_experiments --out reports/examples/lin2019_experiments
	$(BIN)/flexdesign reproduce lin2019 --out reports/examples/lin2019
	$(BIN)/flexdesign sweep hinge_thickness --out reports/examples/hinge_thickness
	$(BIN)/python -m studies.lin2019_gains --out reports/examples/lin2019_gains
	$(BIN)/flexdesign diagnose $(HIDDEN)/model.toml $(HIDDEN)/runs --out reports/examples/hidden_effect_demo

test: $(VENV)/.ready ## Run the tests
	$(PYTEST) $(SIDE_BY_SIDE)

coverage: $(VENV)/.ready ## Run the tests, and list the lines that none of them runs
	$(PYTEST) --cov $(SIDE_BY_SIDE)

benchmark: $(VENV)/.ready ## Measure the performance table: each task and its peer, as ratios; half an hour
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.benchmarks

peers: $(VENV)/.ready ## Time the finite elements, NGSolve, gmsh with scikit-fem, and CalculiX; several minutes
	$(BIN)/python -m studies.benchmarks.fem_peers

trial: $(VENV)/.ready ## Diagnose 680 recordings with hidden effects; hours, goes on where it stopped
	$(BIN)/python -m studies.hidden_effect_trial

verification: $(VENV)/.ready ## Solve problems with known answers; half a minute
	$(BIN)/python -m studies.verification

error-bars: $(VENV)/.ready ## Try the error estimates on designs with a known answer; an hour, goes on where it stopped
	$(BIN)/python -m studies.error_bars

slow: $(VENV)/.ready ## Run the long studies that `test` leaves out
	$(BIN)/python -m pytest -m slow

docs: $(VENV)/.ready ## Build the documentation site in build/docs; it executes the notebooks
	OMP_NUM_THREADS=1 $(BIN)/sphinx-build --builder html --fresh-env --fail-on-warning --keep-going --quiet docs build/docs
	@echo "build/docs/index.html"

wheel-test: $(VENV)/.ready ## Build sdist and wheel, and follow the tutorial with the wheel outside of here
	.ci/wheel-test $(BIN)/python

lint: $(VENV)/.ready ## Check style, types and the packages
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.ready ## Rewrite the code in the house format
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

lock: $(VENV)/.ready ## Bring requirements.lock up to date (FLAGS=--upgrade for newer versions)
	$(UV) pip compile pyproject.toml --output-file requirements.lock \
		--quiet --universal --fork-strategy fewest --generate-hashes \
		--all-extras --group build --group windows --custom-compile-command "make lock" $(FLAGS)

clean: clean-venv ## Remove everything that can be made again, except reports
	rm -rf build dist .coverage .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

clean-venv: ## Remove the environment, so that the next target sets it up again
	rm -rf $(VENV)

# --- The environment ------------------------------------------------------------------------------

# Made anew when another PYTHON is asked for.
MADE := $(VENV)/.made-with-$(notdir $(PYTHON))

$(MADE):
	@sh .ci/system-libraries $(PYTHON)
	$(PYTHON) -m venv --clear $(VENV)
	@touch $@

# The lock holds all that its packages need, the build backend and uv: nothing is fetched that has no hash. uv takes half a
# minute where pip takes three; where it cannot reach the packages, as it does not read the settings of pip, pip does.
# Nothing is resolved, or the newest version of what an extra needs would be looked at, which the lock does not have.
$(VENV)/.ready: $(MADE) requirements.lock pyproject.toml
	@echo "Installing the packages of requirements.lock; the first time takes about a minute"
	@sed -n '/^uv==/,/# via/p' requirements.lock >$(VENV)/uv.lock
	@$(PIP) install --quiet --no-deps --require-hashes --requirement $(VENV)/uv.lock
	@$(UV) pip install --quiet --python $(BIN)/python --no-deps --require-hashes --requirement requirements.lock || \
		$(PIP) install --quiet --no-deps --require-hashes --requirement requirements.lock
	@$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	@touch $@
