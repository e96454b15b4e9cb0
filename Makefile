# Everything a target needs, it makes first: the virtual environment, the installation, the parsed networks.
PYTHON ?= python3
REPORT ?= report.html

VENV := .venv
BIN := $(VENV)/bin
PACKAGES := $(VENV)/.packages
INSTALLED := $(VENV)/.installed
EXTRAS ?= dev
# A stamp without words is of an older Makefile, whose extras were `dev` at least.
HAS := $(if $(wildcard $(PACKAGES)),$(or $(shell cat $(PACKAGES)),dev))
RESULTS := out/quickstart
SYSTEM_PACKAGES := libgl1 libx11-6 libxext6 libxrender1 libatomic1

.DEFAULT_GOAL := help
.PHONY: help setup demo test lint bench docs picture image release clean further-extras
.DELETE_ON_ERROR:

help:  ## List the targets
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' Makefile | expand -t 16

setup: $(INSTALLED)  ## Make .venv, install dohyo and its tools, parse the networks

demo: $(INSTALLED)  ## Evaluate two agents on a real city junction and write report.html
	@$(BIN)/dohyo evaluate --agent autopilot --benchmark quickstart --out $(RESULTS)/autopilot
	@$(BIN)/dohyo evaluate --agent reckless --benchmark quickstart --out $(RESULTS)/reckless
	@$(BIN)/dohyo report $(RESULTS)/autopilot $(RESULTS)/reckless --out $(REPORT)

# Six processes keep two cores busy, since tests of the service wait at times; torch has one thread in each. They are
# copies of one that has collected the tests; those of a file stay in one process, which starts what they share once.
test: $(INSTALLED)  ## Run the whole test suite in six processes
	@OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q --processes 6

lint: $(INSTALLED)  ## Check style, types, the four floors and the Dockerfile
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/mypy --no-error-summary
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/hadolint Dockerfile

bench: $(INSTALLED)  ## Measure speed against bare SUMO, peers and a calibration kernel; one table, and bench.json
	@$(BIN)/python -m tests.performance

docs: $(INSTALLED)  ## Build the documentation site in build/docs; every warning is an error
	@$(BIN)/python -m sphinx -q -W --keep-going -b html -d build/doctrees docs build/docs
	@echo "documentation: build/docs/index.html"

picture: $(INSTALLED)  ## Draw the README's picture from a drive of each demo agent
	@$(BIN)/python docs/pictures/picture.py

image:  ## Build the container's image by buildah and try it, as root
	@.ci/image

release: $(INSTALLED)  ## Make dist/VERSION from the commit: wheel, sdist, notes and checksums
	@$(BIN)/python .ci/release.py

clean:  ## Remove the virtual environment, the report and caches; results in out/ stay
	@rm -rf $(VENV) report.html bench.json build *.egg-info .pytest_cache .mypy_cache .ruff_cache \
		.hypothesis .import_linter_cache
	@find agents evaluation examples service sumo_networks tests -name __pycache__ -prune -exec rm -rf {} +

# The stamps are younger than pyproject.toml exactly when what it asks for is installed; the first one holds the extras.
# Further extras are added to those: without them, `make test` leaves all as it is.
$(INSTALLED): $(PACKAGES)
	@$(BIN)/python -c 'import libsumo' || \
		{ echo "dohyo: libsumo cannot be loaded (Debian: apt-get install $(SYSTEM_PACKAGES))" >&2; exit 2; }
	@$(BIN)/python -m dohyo.sumo_networks.networks.catalog
	@touch $@

$(PACKAGES): pyproject.toml $(if $(filter-out $(HAS),$(EXTRAS)),further-extras)
	@command -v $(PYTHON) >/dev/null || \
		{ echo "dohyo: no '$(PYTHON)' here; expected Python 3.11 or newer (make PYTHON=... $(MAKECMDGOALS))" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "dohyo: expected Python 3.11 or newer, '$(PYTHON)' is $$($(PYTHON) -V 2>&1)" \
		"(make PYTHON=python3.12 $(MAKECMDGOALS))" >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo "dohyo: '$(PYTHON)' has no venv module (Debian: apt-get install python3-venv)" >&2; exit 2; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@$(BIN)/python .ci/install.py $(sort $(HAS) $(EXTRAS))
	@echo $(sort $(HAS) $(EXTRAS)) >$@

further-extras:
