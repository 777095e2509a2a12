// SPDX-License-Identifier: BSD-3-Clause
// Speed of corrections: roots of f(d) = y, posteriors by integrals, posteriors from a table.
//
//   correction_speed

#include <benchmark/benchmark.h>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/correction/posterior.hpp"

namespace {

rangecal::Calibration calibration_of(bool turns) {
  rangecal::Calibration c;
  c.outcome = rangecal::Outcome::converged;
  c.alpha = turns ? Eigen::Vector3d(0.0, 2.0, -0.25) : Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  c.alpha_covariance = 1e-6 * Eigen::Matrix3d::Identity();
  c.noise.parameters[0] = 0.01;
  c.range_min_m = 0.5;
  c.range_max_m = turns ? 7.0 : 5.0;
  return c;
}

std::vector<double> readings(bool turns) {
  rangecal::Random random(1);
  std::vector<double> y(1 << 16);
  for (double& value : y) value = turns ? random.uniform(1.0, 4.0) : random.uniform(0.6, 5.9);
  return y;
}

void table(benchmark::State& state, bool turns) {
  const rangecal::PosteriorTable corrected(calibration_of(turns));
  const std::vector<double> y = readings(turns);
  double sum = 0.0;
  for (auto _ : state) {
    for (const double value : y) sum += corrected(value).mean_m;
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(y.size()));
  state.counters["exact_share"] = corrected.exact_share();
}
BENCHMARK_CAPTURE(table, monotone, false);
BENCHMARK_CAPTURE(table, turning, true);

void integrals(benchmark::State& state, bool turns) {
  const rangecal::Calibration calibration = calibration_of(turns);
  const rangecal::EffectCorrector corrector(calibration, {});
  const std::vector<double> y = readings(turns);
  std::size_t i = 0;
  for (auto _ : state)
    benchmark::DoNotOptimize(rangecal::distance_posterior(corrector, y[i++ % y.size()], {}));
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_CAPTURE(integrals, monotone, false);
BENCHMARK_CAPTURE(integrals, turning, true);

void roots(benchmark::State& state) {
  const rangecal::Calibration calibration = calibration_of(false);
  const std::vector<double> y = readings(false);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(rangecal::correct(calibration, y[i++ % y.size()]));
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(roots);

}  // namespace

BENCHMARK_MAIN();
