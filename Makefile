# SPDX-License-Identifier: BSD-3-Clause
# The README's commands. All install missing Debian packages first and build Release.
PRESET ?= release
BUILD  := build/release
JOBS   ?= $(shell nproc)

.PHONY: demo test build configure packages package

# The program alone, and a first calibration.
demo: configure
	cmake --build $(BUILD) -j $(JOBS) --target rangecal
	$(BUILD)/apps/rangecal compare notebooks_data/field-layout

test: build
	RANGECAL_MUTANTS=$${RANGECAL_MUTANTS-$$(git rev-parse HEAD 2>/dev/null)} \
	  ctest --test-dir $(BUILD) --output-on-failure -j $(JOBS)

configure: packages
	@if [ -f $(BUILD)/CMakeCache.txt ]; then cmake --preset $(PRESET); \
	 else cmake --preset $(PRESET) $$(command -v ninja >/dev/null && echo -G Ninja); fi

build: configure
	cmake --build $(BUILD) -j $(JOBS)

packages:
	@.ci/install

# Debian packages of this build: rangecal_*.deb and librangecal-dev_*.deb in build/packages.
package: build
	cpack --config $(BUILD)/CPackConfig.cmake -B build/packages

# Measurements, not tests: minutes each. The tables in docs/ come from these.
.PHONY: benchmarks
benchmarks: build
	cmake --build $(BUILD) -j $(JOBS) --target benchmarks

.PHONY: bench-accuracy bench-speed bench-peers bench-study studies prove
bench-accuracy: benchmarks
	$(BUILD)/benchmarks/joint_accuracy 1000 200 notebooks_data/scenes

bench-speed: benchmarks
	$(BUILD)/benchmarks/joint_speed
	$(BUILD)/benchmarks/pairs_speed

# Against SciPy, R, Octave, NLopt and plain Ceres on the same data, about 8 minutes.
bench-peers: benchmarks
	@.ci/install benchmarks/peers/packages
	python3 benchmarks/peers/run.py $(BUILD)/benchmarks/peers_compiled

# What outliers do to calibrate as it is by default, about ten minutes: docs/robust.md.
.PHONY: bench-robust
bench-robust: benchmarks
	$(BUILD)/benchmarks/robust_study 50 notebooks_data/scenes/field-layout.yaml

# What outliers do to streams, a minute or two: docs/track.md.
.PHONY: bench-streams
bench-streams: benchmarks
	$(BUILD)/benchmarks/stream_study 20

# The time of a study point: 1000 repeats of the 2021 setting, all four methods; then milliseconds per repeat of each.
bench-study: build
	rm -rf build/study-speed
	$(BUILD)/apps/rangecal study notebooks_data/studies/speed.yaml -o build/study-speed
	cat build/study-speed/timing.csv

# The studies of docs/reproduction.md and docs/which-estimator.md, about ten minutes on two idle cores; a run that was
# stopped goes on. notebooks_data/studies/draw.py then draws the figures.
studies: build
	for csv in notebooks_data/studies/results/*.csv; do name=$$(basename $$csv .csv); \
	  $(BUILD)/apps/rangecal study notebooks_data/studies/$$name.yaml -o build/studies/$$name --resume \
	  && cp build/studies/$$name/results.csv $$csv || exit 1; done
	cd notebooks_data/studies && LC_ALL=C sha256sum *.yaml scenes/*.yaml results/*.csv > SHA256SUMS

# Every reader fed by libFuzzer under AddressSanitizer and UBSan for SECONDS, from the shipped files; clang-14 builds it.
.PHONY: fuzz hostile soak
SECONDS ?= 60
fuzz: build
	cmake build/release -DRANGECAL_FUZZ=ON
	cmake --build $(BUILD) -j $(JOBS) --target fuzz_readers write_bag write_bags
	tests/fuzz/run.sh $(BUILD) $(SECONDS) $(JOBS)

# Input of hostile size: lines of 2 GB, 10^8 rows, nested and aliased YAML. Some ten minutes and 6 GB of disk.
hostile: benchmarks
	benchmarks/hostile.py $(BUILD)

# One process at work for SECONDS (an hour: make soak SECONDS=3600), which may hold no more memory at the end.
soak: benchmarks
	$(BUILD)/benchmarks/soak $(SECONDS) notebooks_data

# All tests under AddressSanitizer and UBSan: an error ends its test. Optimised a little, for -O0 takes hours.
.PHONY: sanitize
sanitize: packages
	cmake --preset debug -B build/sanitize -DCMAKE_CXX_FLAGS_DEBUG="-O1 -g1" -DRANGECAL_UNITY=ON -DRANGECAL_BUILD_BENCHMARKS=OFF \
	  -DRANGECAL_INSTALL=OFF
	cmake --build build/sanitize -j $(JOBS)
	ctest --test-dir build/sanitize -j $(JOBS) --output-on-failure -E Ranks
	ASAN_OPTIONS=detect_leaks=0 ctest --test-dir build/sanitize --output-on-failure -R Ranks  # Open MPI keeps what it took

# Every sign, exponent, factor and index of the likelihoods changed, one at a time: each change has to fail a test.
.PHONY: mutants tidy
mutants:
	$(MAKE) build PRESET=dev BUILD=build/dev
	tests/mutation/mutate.py build/dev --jobs $(JOBS)

# Every C++ file laid out by .clang-format.
.PHONY: format
format:
	git ls-files '*.cpp' '*.hpp' | xargs clang-format-14 -i

# clang-tidy-14 by .clang-tidy, which reads files one by one.
tidy: packages
	cmake --preset dev -B build/tidy -DRANGECAL_PRECOMPILE=OFF -DCMAKE_EXPORT_COMPILE_COMMANDS=ON
	run-clang-tidy-14 -quiet -extra-arg=-Wno-unknown-warning-option -p build/tidy -j $(JOBS) '$(CURDIR)/(core|problems|solvers|ingest|report|apps|python)/.*'

# Lines of core, problems and solvers that no test runs: a table, and a page in build/coverage/report. Tests that keep the program
# from writing files would keep its counters from being written.
.PHONY: coverage valgrind
coverage: packages
	@.ci/install tests/coverage/packages
	cmake --preset coverage
	cmake --build build/coverage -j $(JOBS)
	find build/coverage -name '*.gcda' -delete
	GCOV_ERROR_FILE=$(CURDIR)/build/coverage/gcov.log ctest --test-dir build/coverage -j $(JOBS) --output-on-failure -E 'FullDisk|WithoutPermission'
	tests/coverage/report.sh build/coverage

# The smoke set under valgrind: tests of core and problems, and a command of each kind.
valgrind: build
	@.ci/install tests/valgrind/packages
	tests/valgrind/run.sh $(BUILD)

# The same numbers from -O2 as from -O3? Builds the program a second time.
.PHONY: o2-o3
o2-o3: build
	cmake --preset release -B build/o2 -DCMAKE_CXX_FLAGS_RELEASE=-O2 -DRANGECAL_BUILD_TESTS=OFF -DRANGECAL_BUILD_BENCHMARKS=OFF \
	  -DRANGECAL_BUILD_PYTHON=OFF
	cmake --build build/o2 -j $(JOBS) --target rangecal
	benchmarks/same_numbers.py $(BUILD)/apps/rangecal build/o2/apps/rangecal

prove: build
	$(BUILD)/apps/rangecal prove notebooks_data/concealed -o build/answers.json

# docs/effects.md: the catalogue of effects in full.
.PHONY: catalogue
catalogue: build
	$(BUILD)/apps/rangecal effects --markdown > build/effects.md
	mv build/effects.md docs/effects.md

# docs/gallery.md: what each effect of the catalogue leaves behind when it is left out.
.PHONY: gallery
gallery: build
	rm -rf build/gallery
	$(BUILD)/report/rangecal_gallery build/gallery
	node docs/make_gallery.mjs build/gallery $(BUILD)/report/web/node_modules report/page/page.css docs

# The picture of README.md: residuals of one recording with several causes in it, before and after.
.PHONY: picture release-check
picture: build
	$(BUILD)/apps/rangecal simulate notebooks_data/scenes/several-causes.yaml -o build/several --seed 5
	$(BUILD)/apps/rangecal diagnose build/several --report build/several.html
	node docs/make_picture.mjs build/several.html $(BUILD)/report/web/node_modules report/page/page.css 1 2 > docs/images/diagnosis.svg

# Before a release: what measures compiles, and no printed table may be older than the sources that it depends on.
release-check: benchmarks
	python3 benchmarks/stale.py --check

# docs/reliability.md: ten thousand hard problems (a run that was stopped goes on), ten thousand worlds of the intervals, the ranks
# of a thousand truths in what is reported of them in each of 27 settings, and the diagnosis's p-values on clean worlds.
.PHONY: hard-problems coverage-study rank-study p-value-study
hard-problems: benchmarks
	$(BUILD)/benchmarks/hard_problems 10000 build/hard-problems.csv

coverage-study: benchmarks
	$(BUILD)/benchmarks/coverage_study 10000

rank-study: benchmarks
	$(BUILD)/benchmarks/rank_study 1000 notebooks_data/scenes build/ranks.csv
	python3 benchmarks/rank_figure.py build/ranks.csv docs/images/ranks.png calibrate correct

p-value-study: benchmarks
	$(BUILD)/benchmarks/p_value_study 200
