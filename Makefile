# Two commands set up a fresh Debian or Ubuntu machine:
#
#   make demo      a robot finds a transmitter in an unknown building; writes a video, a map picture and the result
#   make test      all checks
#
# Both create a virtual environment in .venv and install missing system packages with root or sudo: python3-venv and a
# software renderer (OSMesa, or EGL where the distribution has no OSMesa; both and Chromium for the tests).
#
#   make quick     the gates, and the tests that are not marked slow
#   make gates     ruff, mypy, import contracts, spelling
#   make lint      the gates without mypy, in a few seconds
#   make coverage  lines that the tests run, on the terminal and in out/coverage
#   make docs      the documentation, in docs/_build/html; runs every example, needs no PyTorch
#   make bench     a benchmark: BENCH="render --sizes 128"; BENCH=--help lists them
#   make bench-compare   five short benchmarks here and on another commit, in turns: REF=HEAD~1
#   make linkcheck checks the external links of the documentation; needs the network
#   make faults    every command under signals, lost workers and full disks at random moments; hours
#   make fuzz      damaged files for every reader; half an hour and more
#   make dist      source archive and wheel in dist/, built twice and compared, and checked
#   make fresh-wheel   the wheel alone in bare systems: commands of README and tutorial; needs root and debootstrap
#   make fresh-container   the steps of the Containerfile in a bare system, without a container engine
#   make fresh     make demo and make test in bare Debian systems; needs root and debootstrap

VENV ?= .venv
FITS := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
  $$p -c "$(FITS)" 2>/dev/null && echo $$p && break; done)
OUT ?= out/demo
REF ?= HEAD~1
FRESH ?= demo test
SUITES ?= bookworm trixie noble forky
PAGES ?=
MOMENTS ?= 20
BIN := $(VENV)/bin
# Tests start many processes: bytecode is written, so that the second process does not compile the same modules again.
unexport PYTHONDONTWRITEBYTECODE
# Removes a distribution with the former name, robosim, which owns the same command.
INSTALL := $(BIN)/python -m pip uninstall -qq --yes robosim && \
  $(BIN)/python -m pip install --quiet --use-pep517 --editable
NEEDS := $(PYTHON) scripts/system_packages.py $(if $(wildcard $(BIN)/pip),,--venv)

.PHONY: demo quick gates types-and-loops types loops lint test coverage docs linkcheck faults fuzz bench bench-compare install python system system-all dist fresh fresh-wheel fresh-container clean

demo: install
	$(BIN)/robosim warm-up --episode
	$(BIN)/robosim episode office --seed 2 --out $(OUT)
	@echo "Replay it in a browser: $(BIN)/robosim live $(OUT)"

test: types-and-loops
	$(BIN)/pytest -n auto --dist worksteal

quick: types-and-loops
	$(BIN)/pytest -n auto --dist worksteal -m "not slow"

gates: lint types

# All loops are compiled while mypy checks types: tests would wait for each other's.
types-and-loops: lint
	@$(MAKE) --no-print-directory -j2 types loops

types:
	$(BIN)/mypy

loops:
	$(BIN)/robosim warm-up

lint: $(VENV)/.test-installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/codespell

# Warnings are errors. `make test` runs the code blocks of the pages.
docs: $(VENV)/.docs-installed
	$(BIN)/sphinx-build -j auto -W --keep-going -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

linkcheck: $(VENV)/.docs-installed
	$(BIN)/sphinx-build -b linkcheck docs docs/_build/linkcheck

# Lines of compiled loops count as not run.
coverage: $(VENV)/.test-installed
	$(BIN)/pytest -n auto --dist worksteal --cov --cov-report term --cov-report html:out/coverage

# Requires: no traceback, no hang, at most a gigabyte, and one error line with the file's name.
# `make fuzz FUZZ="--cases 500 --targets mesh"` is shorter; --help lists the options.
fuzz: $(VENV)/.test-installed
	$(BIN)/python -m tests.fuzz.run $(FUZZ)

bench: $(VENV)/.test-installed
	$(BIN)/python -m tests.benchmarks $(BENCH)

bench-compare: $(VENV)/.test-installed
	$(BIN)/python -m tests.benchmarks compare --ref $(REF)

faults: $(VENV)/.test-installed
	$(BIN)/pytest tests/faults -n 2 --long --moments $(MOMENTS) -p no:cacheprovider -rA

# Digests of two builds in two folders must be the same; metadata, contents, licences and size are checked.
dist: $(VENV)/.dist-installed
	$(BIN)/python scripts/make_dist.py

install: $(VENV)/.installed

python:
	@test -n "$(PYTHON)" || { echo "robosim needs Python 3.11 to 3.14 (apt-get install python3; on Ubuntu 22.04" \
	  "python3.11). Install one, or pass PYTHON=/path/to/python."; exit 1; }

system: python
	@$(NEEDS)

system-all: python
	@$(NEEDS) --all

# pip is installed last into a new environment, so an environment without pip is incomplete and is recreated.
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

$(VENV)/.dist-installed: pyproject.toml | system $(BIN)/pip
	$(INSTALL) '.[dist]'
	@touch $@ $(VENV)/.installed

# Debian 12; 13; forky with Python 3.14; 12 with EGL in addition to OSMesa; without OSMesa; and as a user with sudo.
fresh:
	scripts/fresh-root.sh bookworm make $(FRESH)
	scripts/fresh-root.sh trixie make $(FRESH)
	scripts/fresh-root.sh forky make $(FRESH)
	PACKAGES="libegl1 libegl-mesa0 libgl1-mesa-dri" scripts/fresh-root.sh bookworm make $(FRESH)
	WITHOUT=libosmesa6 scripts/fresh-root.sh bookworm make $(FRESH)
	AS_USER=1 scripts/fresh-root.sh bookworm make demo

# Pages of tasks too: PAGES="docs/tasks/*.md". noble is Ubuntu's; it needs a mirror, see the script.
fresh-wheel: dist
	set -e; for suite in $(SUITES); do scripts/fresh-root.sh $$suite scripts/try-wheel.sh $(PAGES); done

# COPY, WORKDIR, ENV and RUN as shell.
STEPS = sed -e ':a;/\\$$/{N;s/\\\n//;ba}' -e 's/^COPY/cp -r/' -e 's/^WORKDIR \(.*\)/mkdir -p \1; cd \1/' \
  -e 's/^ENV /export /' -e 's/^RUN //' -e '/^\(\#\|FROM\|ENTRYPOINT\)/d' Containerfile
fresh-container:
	scripts/fresh-root.sh bookworm bash -ec "$$($(STEPS)); robosim episode flat --seed 1 --max-steps 20 --no-video"

clean:
	rm -rf $(VENV) out runs docs/_build docs/_static/recordings docs/examples docs/reference/api docs/reference/commands
