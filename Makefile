# Every target sets up what it needs; `make help` lists them.
TIER ?= paper
OUT ?= results/out
CARRIED ?= carried
PYTHON := .venv/bin/python

# DEVICE=part chooses the OpenCL device: a part of "platform / name", as `defray doctor` prints them.
ifdef DEVICE
export DEFRAY_DEVICE := $(DEVICE)
endif
# DEFRAY_SCENES=folder holds the real scenes' files; without it stand-ins are generated.
ifdef DEFRAY_SCENES
export DEFRAY_SCENES
endif

.PHONY: help setup packages second-device reproduce carry test test-all bench lint figures check-figures lock clean
.DEFAULT_GOAL := help

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo "  figNN          draw one figure of OUT again, by its number in the report"
	@echo "variables: TIER=smoke|paper|full  DEVICE=part-of-a-name  OUT=folder  CARRIED=folder  DEFRAY_SCENES=folder"

setup: ## make .venv and find or install an OpenCL device
	@bash scripts/setup.sh

second-device: ## add Intel's OpenCL runtime to .venv, to test on two implementations
	@bash scripts/setup.sh --with-intel

reproduce: setup ## measure, check the claims and draw the report: TIER=smoke, paper or full
	@.venv/bin/defray reproduce "$(TIER)" --out "$(OUT)"

carry: setup ## pack wheels, source and SCENES=a,b for a machine without a network; its run.sh measures there
	@bash scripts/carry.sh --to "$(CARRIED)" $(if $(SCENES),--scenes "$(SCENES)")

test: lint ## quick tests, in a process a core, four at most
	@$(PYTHON) -m pytest -q -m "not slow" --benchmark-skip --numprocesses logical --maxprocesses 4 --dist loadfile

test-all: lint ## every test
	@$(PYTHON) -m pytest -q --benchmark-skip

bench: setup ## time the stages with pytest-benchmark
	@$(PYTHON) -m pytest -q tests/bench --benchmark-only

lint: setup ## style, and imports that go down the floors
	@$(PYTHON) -m ruff check --quiet .
	@$(PYTHON) -m ruff format --check --quiet .
	@broken=$$(.venv/bin/lint-imports --no-cache --no-logo 2>&1) || { echo "$$broken" >&2; exit 1; }

packages: ## make .venv alone, without a device: enough to draw
	@bash scripts/setup.sh --without-device

figures: packages ## draw OUT's figures, tables and report again from its records, without a device
	@.venv/bin/defray report "$(OUT)"

fig%: packages # one figure of OUT, by its number; the report refuses one that it lacks
	@.venv/bin/defray report "$(OUT)" --only $@

check-figures: packages ## see that the reference's figures are drawn again to the same bytes
	@$(PYTHON) -m pytest -q tests/report/test_reference_figures.py

lock: setup ## pin the newest versions of everything in requirements.txt and scripts/runtimes
	@bash scripts/lock.sh

clean: ## remove .venv and results/out
	@rm -rf .venv results/out
