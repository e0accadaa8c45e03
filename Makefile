# Thin door to CMake. BUILD is the build folder, JOBS the parallelism.
BUILD ?= build
JOBS ?= $(shell nproc)
SCENE ?= atrium
ENV ?=
SHELL := /bin/bash
CONFIGURE = cmake --preset release -B $(BUILD)

.PHONY: all deps build check demo deb docs install test sweeps sanitize bench benches references lint format clean

all: build

deps:
	@deploy/install-deps

build: deps
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE) > $(BUILD).log 2>&1 || { cat $(BUILD).log; exit 1; }
	@ninja -C $(BUILD) -j $(JOBS) gobo gobod gobo_texts python_client

# Programs, texts, the Python client and the library (cmake/install.cmake) -> PREFIX (CMake's own: /usr/local)
install: build
	@cmake --install $(BUILD) $(if $(PREFIX),--prefix $(PREFIX))

demo: build
	@BUILD=$(BUILD) SCENE='$(SCENE)' ENV='$(ENV)' deploy/demo

test: deps
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE)
	@ninja -C $(BUILD) -j $(JOBS)
	@cd $(BUILD) && ctest --output-on-failure -j $$(($(JOBS) + 1)) --repeat until-pass:2 \
	  || { ctest --rerun-failed --output-on-failure; exit 1; }   # what failed stands at the end; one more than cores: many tests wait; a test that kills processes may meet a busy machine; ctest says which ran twice

# The same tests with all cases of their sweeps, of which `make test` runs a share (tests/support/thorough.h).
sweeps: export GOBO_THOROUGH = 1
sweeps: test

# What to run between two edits: the unit tests of the renderer that take less than some seconds (tests/costs.txt has the others), without the daemon.
DEAR = $(shell awk '/^unit/ {split($$1, part, "."); printf "%s%s.*", separator, part[3]; separator = ":"}' tests/costs.txt)
CHECKED = unit_base unit_scene unit_trace unit_terms unit_filters unit_measure unit_plan render_replies
check: deps
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE)
	@ninja -C $(BUILD) -j $(JOBS) $(CHECKED:%=test_%)
	@printf '%s\n' $(CHECKED) | xargs -P $(JOBS) -I{} $(SHELL) -c '$(BUILD)/tests/test_{} --gtest_brief=1 --gtest_filter=-$(DEAR) > $(BUILD)/check_{}.log 2>&1 && echo "{}: $$(grep PASSED $(BUILD)/check_{}.log)" || { cat $(BUILD)/check_{}.log; exit 255; }'

# Tests under sanitizers, each preset in a build folder of its own (CMakePresets.json; deploy/sanitize).
# TIER=all for every test, PRESETS=asan for one, PRESETS=debug for unoptimised code with the library's assertions (the sanitizers' builds have them too).
PRESETS ?= asan tsan
TIER ?= fast
sanitize: deps
	@for preset in $(PRESETS); do deploy/sanitize $$preset $(TIER) $(JOBS) || exit 1; done

# The benchmarks' programs, for CI: compiled, not run.
benches: deps
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE)
	@ninja -C $(BUILD) -j $(JOBS) benches

bench: deps
	@deploy/install-deps --bench
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE)
	@ninja -C $(BUILD) -j $(JOBS) gobo gobod benches
	@BUILD=$(BUILD) bench/run

# API pages: headers, documents, the protocol field by field -> $(BUILD)/docs/html/index.html
docs: deps
	@deploy/install-deps --docs
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE)
	@ninja -C $(BUILD) -j $(JOBS) python_client
	@mkdir -p $(BUILD)/docs && PYTHONPATH=$(BUILD)/clients/python /usr/bin/python3 docs/api/fields.py > $(BUILD)/docs/protocol_fields.md
	@API_OUT=$(BUILD)/docs API_FIELDS=$(BUILD)/docs/protocol_fields.md doxygen docs/api/Doxyfile
	@echo "$(BUILD)/docs/html/index.html"

# Debian packages (cmake/package.cmake; docs/operations.md) -> $(BUILD)/packages
deb: build
	@cpack --config $(BUILD)/CPackConfig.cmake > $(BUILD)/packages.log 2>&1 || { cat $(BUILD)/packages.log; exit 1; }
	@ls $(BUILD)/packages/*.deb

references: build
	@BUILD=$(BUILD) bench/references

format:
	@deploy/install-deps --lint
	@git ls-files '*.cpp' '*.h' ':!*_data.h' | xargs clang-format -i

lint: deps
	@deploy/install-deps --lint
	@[ -f $(BUILD)/build.ninja ] || $(CONFIGURE) > /dev/null
	@deploy/lint $(BUILD)

clean:
	@rm -rf $(BUILD) $(BUILD).log out
