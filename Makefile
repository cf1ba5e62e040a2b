# The verbs of this project; `make` alone lists them.
# Needs git, make and a Python of 3.11 or newer; everything else comes into .venv. A C compiler is welcome and
# not needed: the package `ziglang` brings one.
#   make setup PYTHON=/path/to/python3.12    names the Python to use

VENV := .venv
BIN := $(VENV)/bin
BASE := $(VENV)/.base
STAMP := $(VENV)/.ready
OUTPUT := output
PEERS := $(VENV)/.peers
PEER_PACKAGES := mujoco numba jax scikit-sundae control pandas xarray pyarrow nbclient ipykernel fmpy dask distributed vtk
DOCS := $(VENV)/.docs
DOCS_PACKAGES := sphinx myst-parser numpydoc furo
# program:Debian package; tests of films, of other processors, of memory, of pages
TOOLS := ffprobe:ffmpeg qemu-x86_64:qemu-user valgrind:valgrind chromium:chromium
WORKERS ?= 2
COMMA := ,
PYTEST = $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

SCENE := tensegrity_codegen/scene/examples/prism.toml
TENSEGRITY := $(BIN)/tensegrity-codegen

# The first of these that is new enough, asked only when an environment has to be made.
CANDIDATES := python3 python3.13 python3.12 python3.11 python
NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for python in $(CANDIDATES); do \
	if "$$python" -c '$(NEW_ENOUGH)' 2>/dev/null; then command -v "$$python"; break; fi; done)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test check lint types contracts test-all bench figures examples docs wheel golden format clean

help: ## list these verbs
	@awk -F ':.*## ' '/^[a-z][a-z-]*:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

setup: $(STAMP) ## make .venv with the package and its tools; again only when pyproject.toml changes

# What the demo needs: the package, pictures, and a C compiler where there is none. Python compiles the modules
# that are used when they are imported; pip would compile all of them, which takes longer than the demo itself.
$(BASE): pyproject.toml
	@python='$(PYTHON)'; \
	if [ -z "$$python" ]; then \
	  echo "Python 3.11 or newer is needed, and none of these is: $(CANDIDATES)."; \
	  echo "Install one, or name it: make $(or $(MAKECMDGOALS),setup) PYTHON=/path/to/python3.12"; exit 1; \
	elif ! "$$python" -c '$(NEW_ENOUGH)'; then \
	  echo "PYTHON=$$python is $$("$$python" --version 2>&1); Python 3.11 or newer is needed."; exit 1; \
	elif ! "$$python" -m venv $(VENV); then \
	  echo "$$python cannot make a virtual environment; on Debian and Ubuntu install python3-venv."; exit 1; \
	fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable \
	  '.[plot$(if $(shell command -v cc gcc clang),,$(COMMA)cc)]'
	@touch $@

$(STAMP): $(BASE)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[plot,cc,sweep,dev]'
	@touch $@

demo: $(BASE) ## simulate the prism in C made for it; writes a picture, a film and the library to output/
	@mkdir -p $(OUTPUT)
	$(TENSEGRITY) build $(SCENE) --out $(OUTPUT)/prism --overwrite
	$(TENSEGRITY) simulate $(SCENE) --t-end 2 --samples 201 --out $(OUTPUT)/prism.npz --overwrite
	$(TENSEGRITY) show $(SCENE) --trajectory $(OUTPUT)/prism.npz --out $(OUTPUT)/prism.png --overwrite
	$(TENSEGRITY) show $(SCENE) --trajectory $(OUTPUT)/prism.npz --out $(OUTPUT)/prism.gif --overwrite
	@echo
	@echo "picture  $(CURDIR)/$(OUTPUT)/prism.png"
	@echo "film     $(CURDIR)/$(OUTPUT)/prism.gif"
	@echo "motion   $(CURDIR)/$(OUTPUT)/prism.npz"
	@echo "library  $(CURDIR)/$(OUTPUT)/prism (C source, header, manifest, example and shared library)"

test: $(STAMP) ## the tests, in about five minutes of two idle cores
	@echo "lint, types and import contracts are apart: make check"
	$(PYTEST) -m "not thorough and not peers"

check: lint types contracts ## lint, types and import contracts

test-all: test $(PEERS) $(DOCS) ## the same, then the thorough tests, with the packages and tools that they need
	@for tool in $(TOOLS); do command -v $${tool%:*} >/dev/null \
	  || echo "$${tool%:*} is missing, its tests are skipped; on Debian and Ubuntu: apt install $${tool#*:}"; done
	$(BIN)/python -m pytest -m peers
	$(PYTEST) -m "thorough and not peers"

lint: $(STAMP) ## ruff: rules and layout
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(STAMP) ## mypy --strict over the package and a script of a user
	$(BIN)/mypy

contracts: $(STAMP) ## import-linter: which module may import which
	$(BIN)/lint-imports

bench: $(STAMP) $(PEERS) ## measure every emitter beside other tools; BENCH=--quick is short
	$(BIN)/python benchmarks/bench.py --scripts --out $(OUTPUT)/bench $(BENCH)

figures: $(STAMP) $(PEERS) ## write all pages of measurements, in about 70 minutes; FIGURES='stiff_bars --dirty' is a part
	$(BIN)/python benchmarks/write_figures.py $(FIGURES)

examples: $(STAMP) ## build and run examples/ in each language whose tools are here; compare with Python
	$(BIN)/python examples/run.py --out $(OUTPUT)/examples $(EXAMPLES)

# What is compared with. Nothing that is installed changes its version for it; where a package cannot be
# installed, its tests are skipped and its rows in tables say so.
$(PEERS): $(STAMP)
	@$(BIN)/python -m pip freeze --exclude-editable > $@.installed
	@for package in $(PEER_PACKAGES); do echo "installing $$package into $(VENV)"; \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint $@.installed "$$package" \
	    || echo "$$package cannot be installed here: what needs it says so"; done
	@touch $@

docs: $(DOCS) ## write the documentation site (Sphinx, then live pages) to output/site
	$(BIN)/python docs/build_site.py --out $(OUTPUT)/site

$(DOCS): $(STAMP)
	@echo "installing $(DOCS_PACKAGES) into $(VENV)"
	@$(BIN)/python -m pip freeze --exclude-editable > $@.installed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint $@.installed $(DOCS_PACKAGES)
	@touch $@

wheel: $(STAMP) ## build the sdist, and from it the wheel, into dist/; both contain three.js of a pinned hash
	$(BIN)/python -c "from tensegrity_codegen.live.three_module import write_three; write_three()"
	$(BIN)/python -m build --no-isolation

golden: $(STAMP) ## rewrite the committed files in generated/
	$(BIN)/python -m pytest tests/test_golden.py --update-golden

format: $(STAMP) ## let ruff lay out the code and mend what it can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean: ## remove what the verbs have made, .venv included
	rm -rf $(VENV) .cache $(OUTPUT) dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	rm -rf examples/rust/Cargo.lock examples/rust/target templates/live/three
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
