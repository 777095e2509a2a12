// SPDX-License-Identifier: BSD-3-Clause
// Speed of the recursive calibrators: one pair taken, with and without forgetting; one estimate; one reading
// of a landmark taken, the summing up of its stop shared out, and one watched; one estimate from stops summed
// up and 16 held.
//
//   recursive_speed

#include <benchmark/benchmark.h>

#include "pairs_programs.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/change/landmark_change_detector.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

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

/// Reading i of a drive among five landmarks, seen from every stop `repeats` times; stops off by 1 cm.
rangecal::LandmarkReading landmark_reading(std::int64_t i, int repeats, rangecal::Random& random) {
  static const Eigen::Vector2d axes[] = {{-2.6, 0.3}, {2.7, -0.5}, {0.2, 2.3}, {-1.4, -2.4}, {1.6, 2.2}};
  const std::int64_t stop = i / (5 * repeats);
  const auto landmark = static_cast<std::size_t>(i / repeats % 5);
  rangecal::LandmarkReading reading;
  reading.stop.label = std::to_string(stop);
  const double k = static_cast<double>(stop);
  reading.stop.commanded = {2.0 * std::sin(0.37 * k), 1.5 * std::sin(0.53 * k + 0.4), 0.0};
  reading.landmark = std::string(1, static_cast<char>('A' + landmark));
  reading.radius_m = 0.12;
  rangecal::Random place(rangecal::seed_from("stop", {static_cast<std::uint64_t>(stop)}));
  const Eigen::Vector2d sight =
      axes[landmark] - Eigen::Vector2d(reading.stop.commanded.x_m + place.normal(0.0, 0.01),
                                       reading.stop.commanded.y_m + place.normal(0.0, 0.01));
  const double d = sight.norm() - 0.12, f = 0.0525 + 0.8838 * d + 0.0584 * d * d;
  reading.range_m = random.normal(f, 0.01 * f * f);
  reading.bearing_rad = rangecal::wrap_angle(std::atan2(sight.y(), sight.x()) + random.normal(0.0, 0.0087));
  return reading;
}

void take_a_landmark_reading(benchmark::State& state, bool walk) {
  const int repeats = static_cast<int>(state.range(0));
  rangecal::Random random(1);
  rangecal::RecursiveLandmarksOptions options;
  options.random_walk = walk;
  rangecal::RecursiveLandmarks calibrator(options);
  std::vector<rangecal::LandmarkReading> block;
  std::int64_t i = 0;
  for (auto _ : state) {
    state.PauseTiming();  // a block of 32 stops is drawn
    block.clear();
    for (int k = 0; k < 32 * 5 * repeats; ++k) block.push_back(landmark_reading(i++, repeats, random));
    state.ResumeTiming();
    for (const rangecal::LandmarkReading& reading : block) calibrator.add(reading);
  }
  state.SetItemsProcessed(i);
}
BENCHMARK_CAPTURE(take_a_landmark_reading, independent, false)->Arg(1)->Arg(20)->Iterations(100);
BENCHMARK_CAPTURE(take_a_landmark_reading, random_walk, true)->Arg(1)->Arg(20)->Iterations(100);

/// The curve of landmark_reading, as a calibration made of landmarks has it.
void watch_a_landmark_reading(benchmark::State& state) {
  rangecal::Calibration known;
  known.outcome = rangecal::Outcome::converged;
  known.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  known.alpha_covariance = Eigen::Vector3d(1e-6, 1e-6, 1e-7).asDiagonal();
  known.noise.parameters[0] = 0.01;
  known.sigma_theta_rad = rangecal::Estimate{0.0087, std::nullopt};
  known.range_min_m = 0.5;
  known.range_max_m = 4.5;
  rangecal::LandmarkChangeDetector watch(known);
  rangecal::Random random(1);
  std::vector<rangecal::LandmarkReading> readings;
  for (std::int64_t i = 0; i < 20000; ++i) {
    readings.push_back(landmark_reading(i, 1, random));
    readings.back().stop.sigma_xy_m = 0.01;
  }
  for (auto _ : state)
    for (const rangecal::LandmarkReading& reading : readings) watch.add(reading);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(readings.size()));
}
BENCHMARK(watch_a_landmark_reading)->Iterations(10);

void estimate_landmarks(benchmark::State& state) {
  rangecal::Random random(1);
  rangecal::RecursiveLandmarks calibrator;
  for (std::int64_t i = 0; i < 5 * (32 * 30 + 16); ++i) calibrator.add(landmark_reading(i, 1, random));
  for (auto _ : state) benchmark::DoNotOptimize(calibrator.estimate());
}
BENCHMARK(estimate_landmarks);

}  // namespace

BENCHMARK_MAIN();
