# Two commands are all the set-up there is, on a fresh Debian or Ubuntu machine:
#
#   make demo    a robot finds a transmitter in a building it does not know; a video, a map picture and the result are written
#   make test    all checks
#
# Both make a virtual environment in .venv, and install the system's software renderer if it is missing.

VENV ?= .venv
FITS := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
  $$p -c "$(FITS)" 2>/dev/null && echo $$p && break; done)
OUT ?= out/demo
APT := $(if $(filter 0,$(shell id -u)),,sudo) apt-get
BIN := $(VENV)/bin

.PHONY: demo test fuzz install system clean

demo: install
	$(BIN)/robosim episode office --goal fused --seed 2 --out $(OUT)

test: $(VENV)/.test-installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest -n auto

# Damaged files for every reader: no traceback, no hang, no more than a gigabyte, each refusal one line with the name.
# An hour or so; `make fuzz FUZZ="--cases 500 --targets mesh"` is shorter, and --help says the rest.
fuzz: $(VENV)/.test-installed
	$(BIN)/python -m tests.fuzz.run $(FUZZ)

install: $(VENV)/.installed

# OSMesa renders without a display; newer distributions that dropped it have EGL.
system:
	@if ! ldconfig -p | grep -q -E 'libOSMesa\.so|libEGL_mesa'; then \
	  echo "Installing the software renderer (OSMesa)"; \
	  $(APT) update -qq && { $(APT) install -y -qq libosmesa6 || $(APT) install -y -qq libegl1 libgl1-mesa-dri; }; \
	fi

$(BIN)/python: | system
	@test -n "$(PYTHON)" || { echo "robosim needs Python 3.11 to 3.13. Install one, or pass PYTHON=/path/to/python."; exit 1; }
	@$(PYTHON) -m venv $(VENV) 2>/dev/null || \
	  { $(APT) update -qq && $(APT) install -y -qq python3-venv && $(PYTHON) -m venv $(VENV); }

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.test-installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	@touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) out runs
