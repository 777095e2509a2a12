// SPDX-License-Identifier: BSD-3-Clause
// Speed of the recursive calibrator: one pair taken, with and without forgetting; one full estimate; and the batch for
// comparison.
//
//   recursive_speed

#include <benchmark/benchmark.h>

#include "pairs_programs.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

namespace {

using rangecal::RecursiveCalibrator;

RecursiveCalibrator filled(const rangecal::PairsProblem& pairs, double forget) {
  rangecal::RecursiveOptions options;
  options.forget = forget;
  RecursiveCalibrator calibrator(options);
  for (std::size_t i = 0; i < pairs.size(); ++i) calibrator.add(pairs.true_m[i], pairs.mean_m[i]);
  return calibrator;
}

void take_a_pair(benchmark::State& state, double forget) {
  const rangecal::PairsProblem pairs = rangecal::benchmark::simulate_pairs(4096);
  RecursiveCalibrator calibrator = filled(pairs, forget);
  std::size_t i = 0;
  for (auto _ : state) {
    calibrator.add(pairs.true_m[i], pairs.mean_m[i]);
    i = (i + 97) % pairs.size();
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_CAPTURE(take_a_pair, remembers_all, std::numeric_limits<double>::infinity());
BENCHMARK_CAPTURE(take_a_pair, forgets, 10000.0);

void estimate(benchmark::State& state, bool approximate) {
  const rangecal::PairsProblem pairs = rangecal::benchmark::simulate_pairs(100000);
  RecursiveCalibrator calibrator = filled(pairs, std::numeric_limits<double>::infinity());
  for (auto _ : state) {
    calibrator.add(2.0, 2.05);
    benchmark::DoNotOptimize(approximate ? calibrator.approximate() : calibrator.full());
  }
}
BENCHMARK_CAPTURE(estimate, full, false);
BENCHMARK_CAPTURE(estimate, approximate, true);

}  // namespace

BENCHMARK_MAIN();
