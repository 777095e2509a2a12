# SPDX-License-Identifier: BSD-3-Clause
# The README's two commands. Both install missing Debian packages first and build Release.
PRESET ?= release
BUILD  := build/release
JOBS   ?= $(shell nproc)

.PHONY: demo test build packages package

demo: build
	$(BUILD)/apps/rangecal compare notebooks_data/field-layout

test: build
	ctest --test-dir $(BUILD) --output-on-failure -j $(JOBS)

build: packages
	@if [ -f $(BUILD)/CMakeCache.txt ]; then cmake --preset $(PRESET); \
	 else cmake --preset $(PRESET) $$(command -v ninja >/dev/null && echo -G Ninja); fi
	cmake --build $(BUILD) -j $(JOBS)

packages:
	@.ci/install

# Debian packages of this build: rangecal_*.deb and librangecal-dev_*.deb in build/packages.
package: build
	cpack --config $(BUILD)/CPackConfig.cmake -B build/packages

# Measurements, not tests: minutes each. The tables in docs/ come from these.
.PHONY: bench-accuracy bench-speed bench-peers prove
bench-accuracy: build
	$(BUILD)/benchmarks/joint_accuracy 1000 200 notebooks_data/scenes

bench-speed: build
	$(BUILD)/benchmarks/joint_speed
	$(BUILD)/benchmarks/pairs_speed

# Against SciPy, R, Octave, NLopt and plain Ceres on the same data, about 8 minutes.
bench-peers: build
	@.ci/install benchmarks/peers/packages
	python3 benchmarks/peers/run.py $(BUILD)/benchmarks/peers_compiled

prove: build
	$(BUILD)/apps/rangecal prove notebooks_data/concealed -o build/answers.json
