// SPDX-License-Identifier: BSD-3-Clause
// Few readings: the laws of sums have not set in, and the battery's p-values stand on what it simulates.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/search.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "support/paper_scene.hpp"

namespace rangecal::diagnosis {
namespace {

/// Six stops on a bent path, five cylinders, two readings of each: 60 in all.
Recording sixty_readings(std::uint64_t world) {
  Scene scene = testing::paper_scene();
  scene.sigma_xy_m = 0.01;
  scene.repeats = 2;
  for (int k = 0; k < 6; ++k) testing::add_stop(scene, testing::on_the_drive(k, 0.7 * k));
  testing::add_cylinders(scene);
  return simulate(scene, seed_from("battery null", {world}));
}

TEST(BatteryNull, SixtyCleanReadingsGiveUniformPValues) {
  constexpr int worlds = 150;
  std::vector<double> p;
  for (int world = 0; world < worlds; ++world) {
    const Recording recording = sixty_readings(static_cast<std::uint64_t>(world));
    const Rows rows = make_rows({&recording, 1});
    RefitOptions refit_options;
    const Fit fit = fit_baseline(rows, {}, refit_options);
    Battery battery(rows, {}, fit.state);
    battery.calibrate(600, 1);
    p.push_back(battery.corrected(battery.strongest()));
  }
  // Of 150 at 3 % each, 13 or more come once in a thousand.
  EXPECT_LT(std::count_if(p.begin(), p.end(), [](double x) { return x < 0.02; }), 13);
  // Kolmogorov's distance beyond 1.95 / sqrt(n) comes once in a thousand.
  std::sort(p.begin(), p.end());
  double distance = 0.0;
  for (int i = 0; i < worlds; ++i)
    distance = std::max({distance, (i + 1.0) / worlds - p[static_cast<std::size_t>(i)],
                         p[static_cast<std::size_t>(i)] - static_cast<double>(i) / worlds});
  EXPECT_LT(distance, 1.95 / std::sqrt(static_cast<double>(worlds)));
}

}  // namespace
}  // namespace rangecal::diagnosis
