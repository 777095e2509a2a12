// SPDX-License-Identifier: BSD-3-Clause
// Are the diagnosis battery's p-values uniform where nothing is amiss? Clean worlds of the seed model in
// several designs, noise levels and numbers of readings; of each the corrected p-value of the whole battery,
// and per channel the p-value of one question drawn at random. Kolmogorov-Smirnov against the uniform law;
// `alarms`: corrected p-values below 2 %.
//
//   p_value_study WORLDS [THREADS]
//
// WORLDS for recordings of up to 1000 readings; a fifth at 10 000, a thirtieth at 100 000.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "bent_path.hpp"
#include "diagnosis/battery.hpp"
#include "diagnosis/search.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "threads.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::diagnosis;

struct Case {
  const char* name;
  int stops, landmarks, repeats;
  double spread, sigma_theta, sigma_s;  ///< sigma_e [1/m] of f^2; [rad]; [m]
  bool headings = false, walk = false, pairs = false;
};
const Case cases[] = {
    {"60 readings, 6 x 5 x 2", 6, 5, 2, 0.01, 0.0087, 0.01},
    {"60 readings, 20 x 3 x 1", 20, 3, 1, 0.01, 0.0087, 0.01},
    {"100 readings, 20 x 5 x 1", 20, 5, 1, 0.01, 0.0087, 0.01},
    {"100 readings, noise x 5", 20, 5, 1, 0.05, 0.035, 0.05},
    {"100 readings, noise / 5", 20, 5, 1, 0.002, 0.002, 0.002},
    {"500 readings, 10 x 5 x 10", 10, 5, 10, 0.01, 0.0087, 0.01},
    {"500 readings, headings free", 20, 5, 5, 0.01, 0.0087, 0.01, true},
    {"500 readings, random walk", 20, 5, 5, 0.01, 0.0087, 0.01, true, true},
    {"1000 pairs, 20 distances", 20, 1, 50, 0.01, 0.0087, 0.0, false, false, true},
    {"1000 readings, 20 x 5 x 10", 20, 5, 10, 0.01, 0.0087, 0.01},
    {"10000 readings, 50 x 10 x 20", 50, 10, 20, 0.01, 0.0087, 0.01},
    {"100000 readings, 100 x 10 x 100", 100, 10, 100, 0.01, 0.0087, 0.01},
    {"3000 readings, 200 x 5 x 3", 200, 5, 3, 0.01, 0.0087, 0.01},
    {"3000 readings, poor bearings", 200, 5, 3, 0.02, 0.05, 0.01},
};

Scene scene_of(const Case& c, Random& r) {
  Scene scene;
  scene.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  scene.noise.law = NoiseLaw::f_squared;
  scene.noise.parameters = Eigen::VectorXd::Constant(1, c.spread);
  scene.sigma_theta_rad = c.sigma_theta;
  scene.sigma_xy_m = c.sigma_s;
  if (c.headings) scene.sigma_heading_rad = 0.01;
  if (c.walk) scene.stop_error = StopErrorModel::random_walk;
  if (c.pairs) {
    scene.kind = RecordingKind::pairs;
    for (int k = 0; k < c.stops; ++k) scene.batches.push_back({0.4 + 4.0 * k / c.stops, c.repeats});
    return scene;
  }
  add_bent_path(scene, c.stops, c.landmarks, 0.4, c.headings, r);
  scene.repeats = c.repeats;
  return scene;
}

struct World {
  bool ok = false;
  double corrected = 1.0;
  std::map<std::string, double> of_channel;
};

World run_world(int index, int number) {
  const Case& c = cases[index];
  Random r(seed_from("p values", {static_cast<std::uint64_t>(index), static_cast<std::uint64_t>(number)}));
  const Recording recording = simulate(scene_of(c, r), r.bits());
  World world;
  try {
    const Rows rows = make_rows({&recording, 1});
    RefitOptions refit_options;
    const Fit fit = fit_baseline(rows, {}, refit_options);
    Battery battery(rows, {}, fit.state);
    battery.calibrate(600, 1);
    world.ok = true;
    world.corrected = battery.corrected(battery.strongest());
    std::map<std::string, std::vector<double>> all;
    for (const Question& q : battery.questions) all[q.channel].push_back(std::exp(q.log_p));
    for (const auto& [channel, values] : all) world.of_channel[channel] = values[r.index(values.size())];
  } catch (const std::exception&) {
  }
  return world;
}

/// Kolmogorov's distance to the uniform law and its p-value (Stephens' form of the asymptotic law).
std::pair<double, double> kolmogorov(std::vector<double> p) {
  std::sort(p.begin(), p.end());
  const double n = static_cast<double>(p.size());
  double distance = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i)
    distance = std::max({distance, static_cast<double>(i + 1) / n - p[i], p[i] - static_cast<double>(i) / n});
  const double lambda = (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n)) * distance;
  double q = 0.0;
  for (int k = 1; k <= 100; ++k) q += (k % 2 ? 2.0 : -2.0) * std::exp(-2.0 * k * k * lambda * lambda);
  return {distance, std::clamp(lambda < 0.2 ? 1.0 : q, 0.0, 1.0)};
}

}  // namespace

int main(int count, char** arguments) {
  const int worlds = count > 1 ? std::atoi(arguments[1]) : 300,
            threads = count > 2 ? std::atoi(arguments[2]) : 0;
  const tbb::global_control limit = at_most(threads);
  for (int index = 0; index < static_cast<int>(std::size(cases)); ++index) {
    const Case& c = cases[index];
    const long readings = static_cast<long>(c.stops) * c.landmarks * c.repeats;
    const int number = std::max(10, readings > 50000 ? worlds / 30 : readings > 5000 ? worlds / 5 : worlds);
    std::vector<World> results(static_cast<std::size_t>(number));
    tbb::parallel_for(0, number, [&](int i) { results[static_cast<std::size_t>(i)] = run_world(index, i); });
    std::vector<double> corrected;
    std::map<std::string, std::vector<double>> of_channel;
    for (const World& world : results) {
      if (!world.ok) continue;
      corrected.push_back(world.corrected);
      for (const auto& [channel, p] : world.of_channel) of_channel[channel].push_back(p);
    }
    const auto [distance, p] = kolmogorov(corrected);
    const long alarms =
        std::count_if(corrected.begin(), corrected.end(), [](double value) { return value < 0.02; });
    std::printf("%s: %zu worlds\n  %-22s D %.3f  p %.4f   alarms %ld, %.1f %%\n", c.name, corrected.size(),
                "whole battery", distance, p, alarms,
                100.0 * static_cast<double>(alarms) / static_cast<double>(corrected.size()));
    for (const auto& [channel, values] : of_channel) {
      const auto [d, q] = kolmogorov(values);
      std::printf("  %-22s D %.3f  p %.4f\n", channel.c_str(), d, q);
    }
    std::fflush(stdout);
  }
  return 0;
}
