# The commands that people type. Each one works on a fresh Debian machine with make, a C++ compiler and Python 3.11 or
# newer, and installs what is missing; the second time it needs no network. `make help` lists them.

PYTHON ?= python3
# A preset of CMakePresets.json: the build that `make test` tests.
PRESET ?= dev

export PYTHON
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# What a compiler made is kept for when the same is compiled again, in any checkout, if ccache is here and nothing else was asked for.
ifneq ($(shell command -v ccache),)
export CMAKE_C_COMPILER_LAUNCHER ?= ccache
export CMAKE_CXX_COMPILER_LAUNCHER ?= ccache
export CCACHE_BASEDIR ?= $(CURDIR)
export CCACHE_NOHASHDIR ?= 1
endif
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:

# What has been done already is a stamp file, as old as the doing.
SYSTEM := build/stamps/system
VENV := .venv/stamps
PIP_INSTALL := .venv/bin/python -m pip install --quiet
# The tests run on all processors; a test stays with those of its file for as long as others have work.
PYTEST_SPREAD := --numprocesses=auto --maxprocesses=8 --dist=worksteal
CPP_SOURCES = $(shell find cpp python/bindings tests -name '*.hpp' -o -name '*.cpp' -o -name '*.[ch]')
# What includes all of the library.
TIDY_SOURCES := tests/cpp/freestanding/flight_core.cpp
PACKAGE_SOURCES = CMakeLists.txt pyproject.toml README.md LICENSE \
  $(shell find cmake cpp/include python -type f -not -path '*/__pycache__/*')

.PHONY: help
help: ## List these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' Makefile

.PHONY: test
test: test-cpp test-python ## Install what is missing, build, run the C++ and the Python tests

.PHONY: test-cpp
test-cpp: $(SYSTEM)-test $(if $(filter aarch64,$(PRESET)),$(SYSTEM)-aarch64) ## The C++ tests alone
	cmake --preset $(PRESET)
	cmake --build --preset $(PRESET)
	ctest --preset $(PRESET)

.PHONY: coverage
coverage: $(SYSTEM)-test $(SYSTEM)-clang ## Lines and branches of the C++ core that the C++ tests run
	$(PYTHON) tools/coverage.py

.PHONY: test-flight
test-flight: $(SYSTEM)-test ## The core as flight software takes it: no exceptions, no heap; its C interface in float
	cmake --preset $(PRESET)
	cmake --build --preset $(PRESET) --target test_no_allocation forbidden_symbols c_interface_in_float
	ctest --preset $(PRESET) --tests-regex '^(freestanding|test_no_allocation|C interface in float):'

.PHONY: test-python
test-python: $(VENV)/package $(VENV)/test ## The Python tests alone
	.venv/bin/python -m pytest $(PYTEST_SPREAD)

.PHONY: requirements
requirements: $(VENV)/test $(VENV)/dev $(VENV)/compare $(VENV)/docs $(VENV)/rerun ## Install all that any test needs, so that none is skipped

FUZZ_SECONDS ?= 600
FUZZ_PRESET ?= fuzz
# 0 is another seed each time.
FUZZ_SEED ?= 0
# All, unless some are named.
FUZZ_TARGETS ?=
.PHONY: fuzz
fuzz: $(SYSTEM)-clang $(VENV)/package $(VENV)/test $(VENV)/fuzz ## Fuzz the core and the readers of files, each target for FUZZ_SECONDS (600)
	cmake --preset $(FUZZ_PRESET)
	cmake --build --preset $(FUZZ_PRESET) --target fuzz_targets
	.venv/bin/python tools/fuzz.py build/$(FUZZ_PRESET) $(FUZZ_TARGETS) --seconds $(FUZZ_SECONDS) --seed $(FUZZ_SEED)

# The kind of processor that the wheel is for: this machine's, or aarch64, where QEMU runs what tries it.
MACHINE ?= $(shell uname -m)
EMULATED := $(if $(filter-out $(shell uname -m),$(MACHINE)),build/wheel/emulated/python)
.PHONY: wheel
wheel: $(VENV)/wheel $(EMULATED) ## Build a wheel for any Linux since glibc 2.17 in dist/, and try it where there is no compiler
	tools/build_wheel.sh .venv/bin $(MACHINE)
	rm -rf build/wheel/alone
	PYTHON=$(or $(EMULATED),.venv/bin/python) ELLIPTUDE_WHEEL_SECONDS=$(if $(EMULATED),,30) tests/packaging/wheel.sh \
	  "$$(ls -t dist/elliptude-*_$(MACHINE).whl | head -n 1)" build/wheel/alone

.PHONY: single-header
single-header: ## Write the C++ core as one header, build/single_header/elliptude.hpp, which needs Eigen alone
	$(PYTHON) tools/single_header.py build/single_header/elliptude.hpp

.PHONY: site
site: $(VENV)/package $(VENV)/test $(VENV)/docs ## Build the documentation's site in build/site, and run its notebooks
	tools/build_site.sh .venv/bin/python build/site

.PHONY: demo
demo: $(VENV)/package ## Estimate attitudes of a simulated spacecraft, a pendulum and the Fermi spacecraft: pictures in build/demo
	.venv/bin/elliptude demo --out build/demo

.PHONY: bench
bench: $(SYSTEM)-test $(SYSTEM)-bench ## Build and run the benchmarks
	cmake --preset bench
	cmake --build --preset bench
	for program in build/bench/cpp/benchmarks/benchmark_*; do "$$program"; done

.PHONY: instructions
instructions: $(SYSTEM)-test $(SYSTEM)-bench ## Count the instructions of each operation and compare with the limits (x86-64)
	cmake --preset bench
	cmake --build --preset bench --target instructions_core
	tools/count_instructions.sh build/bench/cpp/benchmarks/instructions_core

# Programs of cpp/examples/bare_metal, such as m7/paper; all, unless some are named.
FLIGHT ?=
.PHONY: flight
flight: $(SYSTEM)-test $(SYSTEM)-flight ## Filters on two bare microcontrollers, in QEMU: their bits as here, what they cost within limits
	$(PYTHON) tools/flight.py $(if $(FLIGHT),--only $(FLIGHT))

.PHONY: compare
compare: $(SYSTEM)-test $(SYSTEM)-bench $(SYSTEM)-peers $(VENV)/package $(VENV)/test $(VENV)/peers ## Measure beside what a user would take instead, as ratios: docs/performance.md
	cmake --preset bench
	cmake --build --preset bench
	.venv/bin/python benchmarks/compare_peers.py --programs build/bench/cpp/benchmarks --page docs/performance.md

.PHONY: mutate
mutate: $(SYSTEM)-test $(VENV)/package $(VENV)/test ## Change the source as a person might by mistake, place by place, and see whether a test notices
	.venv/bin/python tools/mutate.py

.PHONY: lint
lint: $(VENV)/package $(VENV)/test $(VENV)/dev $(SYSTEM)-lint ## Check style and types: ruff, mypy, clang-format, clang-tidy, the lists of mutations
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/clang-format --dry-run --Werror $(CPP_SOURCES)
	.venv/bin/python tools/mutate.py --check
	cmake --preset $(PRESET)
	clang-tidy -p build/$(PRESET) --quiet --warnings-as-errors='*' --extra-arg=-std=c++17 --extra-arg=-Wno-unknown-warning-option $(TIDY_SOURCES)

.PHONY: format
format: $(VENV)/dev ## Format the C++ and the Python sources
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .
	.venv/bin/clang-format -i $(CPP_SOURCES)

.PHONY: clean
clean: ## Remove all that these commands made here
	rm -rf build dist .venv

# --- stamps ------------------------------------------------------------------------------------------------------------

$(SYSTEM)-%: tools/install_system_packages.sh
	tools/install_system_packages.sh $*
	mkdir -p $(@D) && touch $@

# What the package and its commands need; what tests need beside that is not for who wants a demo. The virtual environment
# holds the build requirements too, so that the package can be built again without the network.
$(VENV)/requirements: pyproject.toml tools/requirements.py | $(SYSTEM)-test
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py build runtime cli ulog ros igrf report)
	mkdir -p $(@D) && touch $@

$(VENV)/test: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py test)
	touch $@

$(VENV)/dev: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py dev)
	touch $@

$(VENV)/compare: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py compare)
	touch $@

$(VENV)/docs: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py docs)
	touch $@

$(VENV)/rerun: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py rerun)
	touch $@

$(VENV)/peers: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py best peers)
	touch $@

$(VENV)/wheel: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py wheel)
	touch $@

build/wheel/emulated/python: tests/packaging/aarch64_python.sh | $(SYSTEM)-aarch64
	tests/packaging/aarch64_python.sh $(@D)

$(VENV)/fuzz: $(VENV)/requirements
	$(PIP_INSTALL) --requirement <($(PYTHON) tools/requirements.py fuzz)
	touch $@

$(VENV)/package: $(VENV)/requirements $(PACKAGE_SOURCES)
	$(PIP_INSTALL) --no-index --no-deps --no-build-isolation --config-settings=build-dir=build/python .
	touch $@
