# `make hop` and `make test` need Python 3.11 or later, git and make; everything else goes into .venv.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
GOAL ?= 0.30

.DEFAULT_GOAL := help
.PHONY: help hop hops test test-slow test-realtime cad cad-test lint wheel benchmarks pictures studies mutants clean opengl browser micropython

help:  ## what the targets do
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

hop: $(VENV)/installed  ## the shipped controller hops on the emulated lamp (GOAL=0.30)
	$(BIN)/robolamp dry-run hop --goal $(GOAL) --open

test: $(VENV)/developed lint opengl browser micropython  ## lint, types, import floors and all tests but the slow ones
	$(BIN)/python -m pytest -m "not slow" -n auto --dist loadfile

test-slow: $(VENV)/developed opengl browser  ## the tests that take long
	$(BIN)/python -m pytest -m slow

# Twelve busy processes beside them; they end with the target, however it ends. Only files that have such tests are loaded.
test-realtime: $(VENV)/developed  ## the tests against the real clock, three times on a machine made busy
	@busy=; for each in 1 2 3 4 5 6 7 8 9 10 11 12; do while :; do :; done & busy="$$busy $$!"; done; \
	trap "kill $$busy" EXIT; trap 'exit 130' INT; trap 'exit 143' TERM HUP; \
	for each in 1 2 3; do $(BIN)/python -m pytest -m realtime -n 2 --dist loadfile $$(grep -rl mark.realtime tests --include='test_*.py') || exit 1; done

cad: $(VENV)/cad opengl  ## hardware/cad: the printed parts, their checks, masses and pictures
	$(BIN)/python hardware/cad/build.py

cad-test: $(VENV)/developed $(VENV)/cad  ## the parts built again from their sources, and lamps with other arms
	$(BIN)/python -m pytest -m slow tests/cad

lint: $(VENV)/developed  ## ruff, pyright, import floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

wheel: $(VENV)/developed  ## dist/: wheel and source distribution
	$(BIN)/python -m build

benchmarks: $(VENV)/developed  ## the figures of the README
	for each in $(filter-out benchmarks/hops.py benchmarks/mutants.py,$(wildcard benchmarks/*.py)); do echo "== $$each"; $(BIN)/python $$each || exit; done

pictures: $(VENV)/installed opengl  ## docs/: the pictures of the README
	$(BIN)/python docs/pictures.py

hops: $(VENV)/installed  ## evolve the shipped hops again with the calibration as it is, and ship them if they score
	$(BIN)/python benchmarks/hops.py

studies: $(VENV)/installed  ## the convergence studies of the 1997 paper, in full: half a day; stop and start as you like
	$(BIN)/robolamp study all -o runs/studies

mutants: $(VENV)/developed opengl  ## 400 small faults, planted one by one: which the tests find; two hours, stop and start as you like
	$(BIN)/python benchmarks/mutants.py

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis

# Pictures are rendered headless through EGL; without it they are drawn as side views, so nothing fails here.
opengl:
	@ldconfig -p 2>/dev/null | grep -q 'libEGL.so.1' || \
	  { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
	    apt-get update -qq && apt-get install -y -qq libegl1 libgl1-mesa-dri >/dev/null; } || \
	  echo "No OpenGL here: pictures are drawn as side views (Debian: apt install libegl1 libgl1-mesa-dri)."

# The pages are tested in a real browser; without one those tests are skipped and say so.
browser:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || \
	  { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
	    apt-get update -qq && apt-get install -y -qq chromium >/dev/null; } || \
	  echo "No browser here: the pages are not tested (Debian: apt install chromium)."

# The firmware's tests run on Debian's MicroPython, else on its WebAssembly port in node; without either they skip.
micropython: $(VENV)/installed
	@command -v micropython >/dev/null || [ -d $(VENV)/node/node_modules/@micropython ] || \
	  { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get install -y -qq micropython >/dev/null 2>&1; } || \
	  { command -v npm >/dev/null && npm install --silent --no-fund --no-audit --prefix $(VENV)/node \
	    @micropython/micropython-webassembly-pyscript@1.27 >/dev/null 2>&1; } || \
	  echo "No MicroPython here: the firmware is tested on CPython alone (Debian: apt install micropython)."

$(VENV)/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "robolamp needs Python 3.11 or later; this is " + sys.version.split()[0] + ". Try: make PYTHON=python3.12 " )'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/cad: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[cad]'
	@touch $@

$(VENV)/developed: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@
