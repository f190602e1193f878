# Everything that a fresh Debian machine with Python and make needs. `make help` lists the targets.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -q
APT := $(shell [ "$$(id -u)" = 0 ] && echo apt-get || echo sudo apt-get)
SOURCES := $(shell find src -name '*.py' 2>/dev/null)

export PIP_CONSTRAINT := $(CURDIR)/requirements.lock
# Else every process would compile every module that it imports to byte code again, which takes longer than many tests.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help install dev demo kernels lint test test-wheel test-clients versions check bench soak docs clean

help:
	@echo 'make demo     set up, map the vessels of a real eye with 300 particles, write a film, a player and figures to ./demo'
	@echo 'make test     set up, run all tests (installs Chromium from Debian if there is none)'
	@echo 'make install  set up .venv with the command .venv/bin/shoal'
	@echo 'make dev      set up .venv with all that tests and checks need, and run none of them'
	@echo 'make kernels  after a change of kernels: lower them ahead of time, for the first commands of all users'
	@echo 'make test-firefox  run the tests of the studio and the players in Firefox'
	@echo 'make test-wheel  build wheel and sdist, run a sample of the tests against the installed wheel, outside the checkout'
	@echo 'make test-clients  install libraries for reinforcement learning into .venv-clients, and train with each in the environments'
	@echo 'make versions  run a sample of the tests with the lowest and the highest declared versions of all dependencies, and in each Python found'
	@echo 'make check    ruff, mypy --strict, import-linter, eslint, tsc and prettier (with npm), all tests, documentation'
	@echo 'make bench    measure speed against the plain reference, in one run'
	@echo 'make soak     long checks: 10,000 episodes of elect-particle, 20,000 with noise, 100,000 of planners, 100,000 searches, 100,000 hostile files, 50 kills, 20 full disks, 1000 plans deconflicted, each flow of the studio in four forms'
	@echo 'make docs     build the documentation into ./site'

# The virtual environment. Debian ships Python without the part that makes one; then its package is installed.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	  || { echo 'Shoal needs Python 3.11, 3.12 or 3.13; try make PYTHON=python3.11'; exit 1; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || { rm -rf $(VENV); \
	  echo 'installing python3-venv ...'; $(APT) update -qq && $(APT) install -y -qq python3-venv >/dev/null; \
	  $(PYTHON) -m venv $(VENV); }

# --no-compile: what is used is compiled to byte code when first imported; doing it for all takes half of the set-up.
# The lock holds all that development needs, so nothing has to be resolved for it (`pip check` tells whether it is whole), and two
# processes can install every other line of it at the same time: pip itself uses one core.
$(VENV)/.run-installed: pyproject.toml requirements.lock | $(BIN)/python
	@echo 'installing Shoal into $(VENV) ...'
	@$(PIP) install --no-compile -e '.[imaging,studio]'
	@touch $@

$(VENV)/.dev-installed: pyproject.toml requirements.lock | $(BIN)/python
	@echo 'installing Shoal and its tools into $(VENV) ...'
	@split -n r/2 requirements.lock $(VENV)/lock-
	@$(PIP) install --no-compile --no-deps -r $(VENV)/lock-aa & half=$$!; \
	  $(PIP) install --no-compile --no-deps -r $(VENV)/lock-ab && wait $$half
	@$(PIP) install --no-compile --no-deps --no-build-isolation -e .
	@touch $@ $(VENV)/.run-installed

install: $(VENV)/.run-installed
	@echo 'Shoal is installed. Let this terminal find the command shoal:  . $(BIN)/activate'
	@echo 'Then try:  shoal --help  or  shoal studio  or a tutorial in docs/tutorials'

dev: $(VENV)/.dev-installed
	@echo 'Shoal and its tools are installed. Run some tests:  $(BIN)/python -m pytest tests/unit/swarm -k noise'

demo: $(VENV)/.run-installed
	@$(BIN)/shoal demo --out demo

# Kernels and the tests' byte code are compiled once, before several test processes would do it at the same time.
$(VENV)/.kernels-compiled: $(SOURCES) $(VENV)/.dev-installed
	@$(BIN)/python -m pytest --collect-only -q >/dev/null & collected=$$!; \
	  $(BIN)/python -m benchmarks.first_calls steering jit >/dev/null & rest=$$!; \
	  $(BIN)/python -m benchmarks.first_calls swarm search lab views && wait $$rest && wait $$collected
	@touch $@

# What is committed of the kernels beside their sources, so that a first command has little to compile. Makes what is missing.
kernels: $(VENV)/.dev-installed
	@$(BIN)/python -m benchmarks.first_calls --archives

# The browser tests need Debian's Chromium, and the program that drives it a small library; it is fetched while kernels are compiled.
.PHONY: chromium
chromium:
	@{ command -v chromium-headless-shell || command -v chromium; } >/dev/null && /sbin/ldconfig -p | grep -q libatomic.so.1 \
	  || { echo 'installing Chromium for the browser tests ...'; \
	  $(APT) update -qq && $(APT) install -y -qq chromium-headless-shell libatomic1 >/dev/null; }

# Files in their order, so that small ones come last. Tests that wait most of the time, for a browser, a rig, a radio or another process,
# run beside all others, in a process of their own, before which the others stand back (nice): what it waits for answers at once, and the
# others compute meanwhile. Three workers beside them were slower than two, measured on two cores.
WAITING := tests/unit/robots tests/unit/search/test_live.py tests/unit/swarm/test_cameras.py tests/unit/swarm/test_coils.py \
  tests/unit/swarm/test_resume.py tests/unit/swarm/test_rigs.py tests/unit/test_strange_stores.py tests/unit/test_sweep.py tests/browser
WAITING_LOG := $(VENV)/waiting-tests.txt
test: $(VENV)/.dev-installed
	@$(MAKE) --no-print-directory -j 2 $(VENV)/.kernels-compiled chromium
	@$(BIN)/python -m pytest --durations=8 $(WAITING) >$(WAITING_LOG) 2>&1 & waiting=$$!; code=0; \
	  nice $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --durations=15 $(WAITING:%=--ignore=%) || code=$$?; \
	  wait $$waiting || code=$$?; cat $(WAITING_LOG); exit $$code

# Playwright speaks with Debian's Firefox by its standard protocol. Versions of Playwright after this one ask for more than it knows.
FIREFOX := $(VENV)/firefox
test-firefox: $(VENV)/.dev-installed $(VENV)/.kernels-compiled
	@command -v firefox-esr >/dev/null || { echo 'installing Firefox ...'; $(APT) update -qq && $(APT) install -y -qq firefox-esr >/dev/null; }
	@[ -d $(FIREFOX) ] || env -u PIP_CONSTRAINT $(PIP) install --target $(FIREFOX) playwright==1.60.0
	@SHOAL_BROWSER=firefox PYTHONPATH=$(FIREFOX) $(BIN)/python -m pytest tests/browser

# What people install: the wheel, in an environment of its own, away from the checkout; the tests come from the sdist.
WHEEL_SAMPLE := tests/golden/test_reach_counts.py tests/golden/test_tours.py tests/unit/swarm/test_map_files.py tests/unit/search/test_mission_lint.py
test-wheel: $(VENV)/.dev-installed
	@rm -rf dist && $(BIN)/python -m hatchling build >/dev/null
	@set -e; folder=$$(mktemp -d); trap 'rm -rf "$$folder"' EXIT; wheel=$$(ls $(CURDIR)/dist/*.whl); \
	  tar -xzf dist/*.tar.gz -C $$folder --strip-components=1; rm -r $$folder/src; \
	  $(BIN)/python -m venv $$folder/environment; cd $$folder; \
	  environment/bin/python -m pip --disable-pip-version-check -q install "$$wheel[imaging]" pytest hypothesis; \
	  environment/bin/python -m pytest -q $(WHEEL_SAMPLE)

# Libraries for reinforcement learning, in an environment of their own: they need gigabytes, and other versions than the lock has.
CLIENTS := .venv-clients
TORCH ?= 2.13.0
$(CLIENTS)/.installed: pyproject.toml
	@$(PYTHON) -m venv $(CLIENTS)
	@env -u PIP_CONSTRAINT $(CLIENTS)/bin/python -m pip --disable-pip-version-check -q install torch==$(TORCH)
	@env -u PIP_CONSTRAINT $(CLIENTS)/bin/python -m pip --disable-pip-version-check -q install -e '.[clients]'
	@touch $@
test-clients: $(CLIENTS)/.installed
	@$(CLIENTS)/bin/python -m pytest -W default --durations=5 tests/clients

# Only here do versions other than those of the lock run. uv finds the lowest versions; nothing else needs it.
versions: $(VENV)/.dev-installed
	@$(PIP) install uv
	@$(BIN)/python -m tests.versions

# Nothing that runs needs npm; where there is none, `make lint` says what it left out.
node_modules/.package-lock.json: package.json package-lock.json
	@npm ci --silent --no-audit --no-fund && touch $@

.PHONY: lint-javascript
ifeq ($(shell command -v npm),)
lint-javascript:
	@echo 'There is no npm: the JavaScript of the studio and the players was not checked.'
else
lint-javascript: node_modules/.package-lock.json
	@npm run --silent check
endif

lint: $(VENV)/.dev-installed lint-javascript
	@$(BIN)/python -m pip check -q
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

check: lint docs test

bench: $(VENV)/.dev-installed $(VENV)/.kernels-compiled
	@$(PIP) install -e '.[bench]'
	@$(BIN)/python -m benchmarks

soak: $(VENV)/.dev-installed $(VENV)/.kernels-compiled
	@$(BIN)/python -m tests.hostile 100000
	@$(BIN)/python -m benchmarks.kills 50 20
	@$(BIN)/python -m benchmarks.deconfliction 1000
	@$(BIN)/python -m benchmarks.livelock
	@$(BIN)/python -m benchmarks.noise --endings 20000
	@$(BIN)/python -m benchmarks.termination
	@$(BIN)/python -m benchmarks.studio --attacks
	@SHOAL_SOAK=100000 $(BIN)/python -m pytest -q -n 2 tests/properties/test_soak.py -k random_searches
	@SHOAL_SOAK=1 $(BIN)/python -m pytest -q -n 2 $$(grep -rl "from tests.soak import" tests --include='*.py')
	@SHOAL_FORMS=all $(BIN)/python -m pytest -q tests/browser -k studio

docs: $(VENV)/.dev-installed
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet --site-dir site

clean:
	rm -rf $(VENV) $(CLIENTS) site demo build dist node_modules .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find src tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
