# Two commands are all the set-up there is, on a fresh Debian or Ubuntu machine:
#
#   make demo      a robot finds a transmitter in a building it does not know; a video, a map picture and the result are written
#   make test      all checks
#
# Both make a virtual environment in .venv, and install what is missing of the system's packages: a software renderer
# (OSMesa; EGL where the distribution has no OSMesa; both for the tests, and Chromium) and python3-venv. That takes root
# or sudo.
#
#   make coverage  which lines the tests run, on the terminal and in out/coverage; longer than the tests alone
#   make docs      the documentation, in docs/_build/html; some three minutes the first time, as every example is run.
#                  PyTorch is not needed
#   make bench     a benchmark: BENCH="render --sizes 128"; BENCH=--help lists them
#   make linkcheck whether the pages that it links to are there; needs the network
#   make faults    every command disturbed by signals, lost workers and full disks at random moments; hours
#   make fresh     both of them in bare Debian systems, as a newcomer would run them; needs root and debootstrap

VENV ?= .venv
FITS := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
  $$p -c "$(FITS)" 2>/dev/null && echo $$p && break; done)
OUT ?= out/demo
FRESH ?= demo test
MOMENTS ?= 20
BIN := $(VENV)/bin
# What was installed under the former name, robosim, goes first: it owns the same command.
INSTALL := $(BIN)/python -m pip uninstall -qq --yes robosim && \
  $(BIN)/python -m pip install --quiet --use-pep517 --editable
NEEDS := $(PYTHON) scripts/system_packages.py $(if $(wildcard $(BIN)/pip),,--venv)

.PHONY: demo test coverage docs linkcheck faults fuzz bench install python system system-all fresh clean

demo: install
	$(BIN)/robosim episode office --goal fused --seed 2 --out $(OUT)
	@echo "Look back on it in a browser: $(BIN)/robosim live $(OUT)"

test: $(VENV)/.test-installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n auto --dist worksteal

# Warnings are errors. The blocks of its pages run with `make test`.
docs: $(VENV)/.docs-installed
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

linkcheck: $(VENV)/.docs-installed
	$(BIN)/sphinx-build -b linkcheck docs docs/_build/linkcheck

# Lines of loops that numba compiles count as not run.
coverage: $(VENV)/.test-installed
	$(BIN)/pytest -n auto --dist worksteal --cov --cov-report term --cov-report html:out/coverage

# Damaged files for every reader: no traceback, no hang, no more than a gigabyte, each refusal one line with the name.
# A quarter of an hour; `make fuzz FUZZ="--cases 500 --targets mesh"` is shorter, and --help says the rest.
fuzz: $(VENV)/.test-installed
	$(BIN)/python -m tests.fuzz.run $(FUZZ)

bench: $(VENV)/.test-installed
	$(BIN)/python -m tests.benchmarks $(BENCH)

faults: $(VENV)/.test-installed
	$(BIN)/pytest tests/faults -n 2 --long --moments $(MOMENTS) -p no:cacheprovider -rA

install: $(VENV)/.installed

python:
	@test -n "$(PYTHON)" || { echo "robosim needs Python 3.11 to 3.13 (apt-get install python3; on Ubuntu 22.04" \
	  "python3.11). Install one, or pass PYTHON=/path/to/python."; exit 1; }

system: python
	@$(NEEDS)

system-all: python
	@$(NEEDS) --all

# pip is what comes last into a new environment: one that was broken off is made anew.
$(BIN)/pip: | system
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | system $(BIN)/pip
	$(INSTALL) '.[live]'
	@touch $@

$(VENV)/.test-installed: pyproject.toml | system-all $(BIN)/pip
	$(INSTALL) '.[test]'
	@touch $@ $(VENV)/.installed

$(VENV)/.docs-installed: pyproject.toml | system $(BIN)/pip
	$(INSTALL) '.[docs]'
	@touch $@ $(VENV)/.installed

# Debian 12; 13; 12 with EGL, where OSMesa is added; without OSMesa; and as a user with sudo.
fresh:
	scripts/fresh-root.sh bookworm make $(FRESH)
	scripts/fresh-root.sh trixie make $(FRESH)
	PACKAGES="libegl1 libegl-mesa0 libgl1-mesa-dri" scripts/fresh-root.sh bookworm make $(FRESH)
	WITHOUT=libosmesa6 scripts/fresh-root.sh bookworm make $(FRESH)
	AS_USER=1 scripts/fresh-root.sh bookworm make demo

clean:
	rm -rf $(VENV) out runs docs/_build docs/_static/recordings docs/examples docs/reference/api docs/reference/commands
