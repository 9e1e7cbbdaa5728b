# `make demo` and `make test` set up what they need in .venv and then run. uv is used where it is installed.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
UV := $(shell command -v uv 2>/dev/null)
STAMPS := $(VENV)/.stamps

.PHONY: help demo test test-slow lint unit benchmark screenshots clean

help:
	@echo "make demo         set up and run the scenario planter_turns"
	@echo "make test         set up for development; lint, types, import layers and tests"
	@echo "make test-slow    the tests that take longer"
	@echo "make benchmark    where the time goes, beside the bare pybullet step"
	@echo "make screenshots  pictures of the demo's recording (needs a Vulkan driver, e.g. mesa-vulkan-drivers)"

demo: $(STAMPS)/runtime
	$(BIN)/twin run planter_turns

test: lint unit

lint: $(STAMPS)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell --skip './.venv,./.git,./runs' .
	$(BIN)/mypy
	$(BIN)/lint-imports

unit: $(STAMPS)/dev
	$(BIN)/pytest -n 2 --dist worksteal

test-slow: $(STAMPS)/dev
	$(BIN)/pytest -m slow -n 2 --dist worksteal

benchmark: $(STAMPS)/dev
	$(BIN)/pytest tests/benchmarks -m 'slow or not slow' --benchmark-enable --benchmark-only

screenshots: $(STAMPS)/dev
	$(BIN)/twin run planter_turns
	$(BIN)/python -m viz.screenshot runs/planter_turns/seed1_run0/run.rrd screenshots

clean:
	rm -rf $(VENV) runs screenshots twin/__pycache__/kernels-*

# --- set-up --------------------------------------------------------------------------------------------------------

$(VENV)/pyvenv.cfg:
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
	  echo "Python 3.11 is needed: pybullet has prebuilt Linux wheels for 3.9 to 3.11 and numpy 2.4 needs 3.11,"; \
	  echo "so on other versions pybullet would be compiled from source. '$(PYTHON)' was not found."; \
	  echo "Install Python 3.11 (Debian: apt install python3.11-venv) or name yours: make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
	  echo "Python 3.11 is needed, '$(PYTHON)' is $$($(PYTHON) --version)."; \
	  echo "pybullet has prebuilt Linux wheels for 3.9 to 3.11 and numpy 2.4 needs 3.11: make PYTHON=/path/to/python3.11"; exit 1; }
ifeq ($(UV),)
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	  echo "This Python has no ensurepip: install it (Debian: apt install python3.11-venv) or install uv."; exit 1; }
	$(PYTHON) -m venv $(VENV)
else
	$(UV) venv --quiet --allow-existing --python $$($(PYTHON) -c 'import sys; print(sys.executable)') $(VENV)
endif

ifeq ($(UV),)
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check
else
INSTALL = VIRTUAL_ENV=$(VENV) $(UV) pip install --quiet
endif

$(STAMPS)/runtime: $(VENV)/pyvenv.cfg pyproject.toml
	$(INSTALL) --editable .
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/dev: $(VENV)/pyvenv.cfg pyproject.toml
	$(INSTALL) --editable '.[dev]'
	@mkdir -p $(STAMPS) && touch $@ $(STAMPS)/runtime
